"""What a model file holds, whatever its format."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.errors import ModelFileError

if TYPE_CHECKING:
    import keras


@dataclass(frozen=True)
class StoredModel:
    """A model file's content.

    Attributes:
        model: the network, not compiled and not yet checked to be a GG-CNN.
        format: name of the file format.
        keras_version: the version whose schema the file has; None for PyTorch.
        optimizer: class_name, learning_rate and n_weights (of its stored state); None where the file has none.
        history: the Net2Net operations that led to the network, oldest first.
    """

    model: keras.Model
    format: str
    keras_version: str | None
    optimizer: dict[str, Any] | None = None
    history: list[dict[str, Any]] = field(default_factory=list)


def optimizer_facts(config: dict[str, Any] | str | None, n_weights: int) -> dict[str, Any] | None:
    """Class and learning rate out of a stored optimizer configuration; Keras before 2.3 wrote `lr`."""
    if not config:
        return None
    if isinstance(config, str):
        config = {"class_name": config}
    settings = config.get("config", {})
    rate = settings.get("learning_rate", settings.get("lr"))
    return {
        "class_name": str(config.get("class_name")).rpartition(">")[2],
        "learning_rate": rate.get("class_name") if isinstance(rate, dict) else rate,
        "n_weights": n_weights,
    }


def parse_history(text: str | bytes) -> list[dict[str, Any]]:
    """Read a stored operation history.

    Raises:
        ModelFileError: it is not a JSON list of objects.
    """
    try:
        history = json.loads(text)
    except ValueError as error:
        raise ModelFileError(f"expected its operation history to be JSON, received {text[:80]!r}") from error
    if not (isinstance(history, list) and all(isinstance(item, dict) for item in history)):
        raise ModelFileError(f"expected its operation history to be a list of JSON objects, received {text[:80]!r}")
    return history
