"""How to train: every setting of a training run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.errors import TrainingError
from ggcnn_net2net.protocol import PAPER, Protocol

if TYPE_CHECKING:
    import keras

KERAS_2_RMSPROP = "rmsprop-keras2"
"""The paper's optimizer: "rmsprop" as Keras 2 computes it (`training.rmsprop`)."""

SCHEDULES = (None, "cosine")


@dataclass(frozen=True)
class Recipe:
    """Settings of one training run. The defaults are the paper's."""

    epochs: int = 30
    """Passes through the data."""

    batch_size: int = 4
    """Images a step."""

    optimizer: str | keras.optimizers.Optimizer = KERAS_2_RMSPROP
    """"rmsprop-keras2", a name that Keras knows, or an optimizer, which is copied and not changed."""

    learning_rate: float = 1e-3
    """Of the first step. An optimizer that is given as such has its own, and this is not used."""

    learning_rate_schedule: str | None = None
    """None keeps the learning rate; "cosine" lets it fall to 0 over all steps, on half a cosine."""

    images_per_epoch: int | None = None
    """Images of an epoch, if it is not to see all of them."""

    seed: int = 0
    """Seed of the order of the images."""

    protocol: Protocol = PAPER
    """Chooses the loss (`masked_loss`) and the order of the images (`shuffled_rows`)."""

    def __post_init__(self) -> None:
        for name in ("epochs", "batch_size", "images_per_epoch"):
            value = getattr(self, name)
            if value is not None and (not isinstance(value, int) or value < 1):
                raise TrainingError(f"expected {name} to be an integer above 0, received {value!r}")
        if not 0 < self.learning_rate < float("inf"):
            raise TrainingError(f"expected a learning rate above 0, received {self.learning_rate}")
        if self.seed < 0:
            raise TrainingError(f"expected a seed of 0 or more, received {self.seed}")
        if self.learning_rate_schedule not in SCHEDULES:
            raise TrainingError(
                f"expected a learning rate schedule of {SCHEDULES}, received {self.learning_rate_schedule!r}"
            )

        if self.learning_rate_schedule is not None and not isinstance(self.optimizer, str):
            raise TrainingError(
                f"expected no schedule beside an optimizer object, received {self.learning_rate_schedule!r}: "
                "give the optimizer its schedule, or name the optimizer"
            )

    def new_optimizer(self, steps_per_epoch: int) -> keras.optimizers.Optimizer:
        """A fresh optimizer as this recipe wants it.

        Args:
            steps_per_epoch: what a schedule of the learning rate counts by.

        Returns:
            The optimizer, not built yet.

        Raises:
            TrainingError: Keras knows no optimizer of this name.
        """
        import keras

        from ggcnn_net2net.training.rmsprop import Keras2RMSprop

        if not isinstance(self.optimizer, str):
            return type(self.optimizer).from_config(self.optimizer.get_config())
        rate: Any = self.learning_rate
        if self.learning_rate_schedule == "cosine":
            rate = keras.optimizers.schedules.CosineDecay(rate, self.epochs * steps_per_epoch)
        if self.optimizer == KERAS_2_RMSPROP:
            return Keras2RMSprop(rate)
        try:
            return type(keras.optimizers.get(self.optimizer))(learning_rate=rate)
        except ValueError as error:
            raise TrainingError(
                f"expected {KERAS_2_RMSPROP!r} or an optimizer of Keras such as 'adam', received {self.optimizer!r}"
            ) from error

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values, for result files; `from_dict` makes the same recipe of them."""
        optimizer: Any = self.optimizer
        if not isinstance(optimizer, str):
            import keras

            optimizer = keras.optimizers.serialize(optimizer)
        return {
            "epochs": self.epochs,
            "batch_size": self.batch_size,
            "optimizer": optimizer,
            "learning_rate": self.learning_rate,
            "learning_rate_schedule": self.learning_rate_schedule,
            "images_per_epoch": self.images_per_epoch,
            "seed": self.seed,
            "protocol": self.protocol.as_dict(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Recipe:
        """The recipe that `as_dict` gave.

        Args:
            values: plain JSON values, of this version of the package.

        Returns:
            An equal recipe; an optimizer object is made anew.

        Raises:
            KeyError, TypeError, ValueError: values of another version.
        """
        optimizer = values["optimizer"]
        if not isinstance(optimizer, str):
            import keras

            optimizer = keras.optimizers.deserialize(optimizer)
        return cls(**{**values, "optimizer": optimizer, "protocol": Protocol(**values["protocol"])})

    @property
    def fingerprint(self) -> str:
        """Hash of what determines the steps. Without a schedule the epochs do not, so that a run can be prolonged."""
        settings = self.as_dict()
        protocol = settings.pop("protocol")
        settings |= {"masked_loss": protocol["masked_loss"], "shuffled_rows": protocol["shuffled_rows"]}
        if self.learning_rate_schedule is None:
            del settings["epochs"]
        return hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode()).hexdigest()
