"""What a search is asked for: every setting, as it stands in the journal."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.protocol import Protocol
from ggcnn_net2net.search.beam import BeamSearch
from ggcnn_net2net.training.recipe import Recipe

IOU, LOSS, SIM = "iou", "loss", "sim"
HEURISTICS = {IOU: "IoU rate", LOSS: "test loss", SIM: "success rate in simulation"}
"""What a candidate can be judged by, and its name."""

FROM_PARENT = "parent"
"""Stands for a teacher: the network that the operation was applied to."""


@dataclass(frozen=True)
class Budget:
    """How much data a candidate costs."""

    images_per_epoch: int | None
    """None: all of the train split."""
    score_images: int | None
    """Images of the test split that score a candidate, spread evenly over it; None: all."""


BUDGETS = {
    "quick": Budget(25, 40),
    "short": Budget(100, 100),
    "standard": Budget(1500, 500),
    "paper": Budget(None, None),
}
"""With the paper's beam and depth and 2 epochs, growing the published network to 67,644 parameters at most, on 2 cores:
minutes, a tenth of standard, 1.5 hours, the published recipe. Without a limit many times as long."""


@dataclass(frozen=True)
class SearchSettings:
    """Settings of a search. The defaults are the paper's; what goes beyond the paper is off."""

    width: int = 3
    """Beam width: nodes kept on a level."""
    depth: int = 5
    """Operations between the first and the last network."""
    lookahead: bool = True
    """Whether only one level is committed to at a time."""
    patience: int | None = None
    """Commitments without a better score after which the search stops; None: never."""
    transpose: bool = False
    """Whether transposed convolutions are changed, too."""
    max_parameters: int | None = None
    """Larger networks are not considered; None: no limit."""
    recipe: Recipe = field(default_factory=lambda: Recipe(epochs=2))
    """Of a candidate; its seed is replaced by one of each candidate's own, derived from `seed`."""
    retrain: int = 0
    """Epochs that a network is trained further when it is committed to."""
    heuristic: str = IOU
    """What a candidate is judged by: "iou", "loss" or "sim"."""
    score_images: int | None = None
    """Images of the test split that score a candidate ("iou", "loss"); None: all."""
    sim_objects: str = "training:40:1"
    """Object set of the heuristic "sim"; by default none that a benchmark judges on."""
    sim_poses: int = 1
    """Poses of each of these objects."""
    seed: int = 0
    """Of every random choice."""
    threads: int = 1
    """TensorFlow's threads in each worker process. Another number gives other last digits."""
    max_failures: int = 5
    """Failed candidates in a row at which the search stops."""
    halving: bool = False
    """Successive halving: all children of a level are trained for a fourth of the epochs, the better half goes on."""
    replicates: int = 1
    """Trainings of a candidate, each with a seed of its own; their mean score counts, the first one's weights are
    kept."""
    carry_optimizer: bool = False
    """Whether a child goes on with the optimizer state of its parent, instead of a fresh one."""
    distil: str | None = None
    """Teacher of all candidates, "parent" or a model file: its maps are mixed into the labels."""
    distil_weight: float = 0.5
    """Share of the teacher in the labels."""

    def __post_init__(self) -> None:
        _ = self.beam  # checks its own settings
        if self.heuristic not in HEURISTICS:
            raise SearchError(f"expected a heuristic of {', '.join(HEURISTICS)}, received {self.heuristic!r}")
        for name in ("max_parameters", "score_images", "sim_poses", "threads", "max_failures", "replicates"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise SearchError(f"expected {name} of 1 or more, received {value}")
        if self.retrain < 0 or self.seed < 0:
            raise SearchError(f"expected retrain and seed of 0 or more, received {self.retrain} and {self.seed}")
        if not self.lookahead and (self.retrain or self.patience):
            raise SearchError(
                "expected lookahead for retrain and patience, which act after each commitment: without it there is one "
                f"at the end, received retrain={self.retrain}, patience={self.patience}"
            )
        if not 0 < self.distil_weight <= 1:
            raise SearchError(f"expected distil_weight above 0 and at most 1, received {self.distil_weight}")
        if self.halving and self.recipe.epochs < 2:
            raise SearchError(
                "expected 2 epochs or more with successive halving, which stops some candidates on the way, received "
                f"{self.recipe.epochs}"
            )
        if self.halving and self.recipe.learning_rate_schedule is not None:
            raise SearchError(
                "expected no learning rate schedule with successive halving, which does not know in advance how long "
                f"a candidate is trained, received {self.recipe.learning_rate_schedule!r}"
            )
        if self.distil is not None and self.recipe.protocol.masked_loss:
            raise SearchError(
                "expected a protocol without masked_loss for distillation, received "
                f"{self.recipe.protocol.name}: a teacher labels every pixel; replace masked_loss by False"
            )

    @property
    def protocol(self) -> Protocol:
        """The recipe's, which decides on the search, too."""
        return self.recipe.protocol

    @property
    def beam(self) -> BeamSearch:
        """What the algorithm needs to know."""
        return BeamSearch(
            self.width,
            self.depth,
            self.lookahead,
            maximise=self.heuristic != LOSS,
            last_entry=self.protocol.last_lookahead_takes_last,
            patience=self.patience,
        )

    @property
    def rungs(self) -> tuple[int, ...]:
        """Epochs after which the children of a level are scored; all but the last let only the better half go on."""
        epochs = self.recipe.epochs
        return tuple(sorted({-(-epochs // 4), -(-epochs // 2), epochs})) if self.halving else (epochs,)

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values, from which `from_dict` makes the same settings."""
        own = {name: value for name, value in vars(self).items() if name not in _OF_BEAM and name != "recipe"}
        return {"beam": asdict(self.beam), "recipe": self.recipe.as_dict(), **own}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> SearchSettings:
        """The settings that `as_dict` gave.

        Args:
            values: plain JSON values, of this version of the package.

        Returns:
            Equal settings.

        Raises:
            SearchError: settings of another version.
        """
        own = dict(values)
        try:
            beam, recipe = own.pop("beam"), own.pop("recipe")
            return cls(**{name: beam[name] for name in _OF_BEAM}, recipe=Recipe.from_dict(recipe), **own)
        except (KeyError, TypeError, ValueError) as error:
            raise SearchError(
                f"expected settings of this version of the package, received others: {error!r}"
            ) from error


_OF_BEAM = ("width", "depth", "lookahead", "patience")
