"""The operations that made a model: its lineage, carried by the model itself."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import keras

_ATTRIBUTE = "net2net_history"


def history_of(model: keras.Model) -> list[dict[str, Any]]:
    """The operations that led to `model`, first to last.

    Args:
        model: any `keras.Model`.

    Returns:
        A copy of its history: one dict of plain JSON values an operation, with at least `operation` (as
        `Operation.parse` reads it) and `layer` (name of the layer it was applied to). Empty for a model that
        no operation was applied to.

    Example:
        >>> history_of(wider(model, 3))
        [{'operation': 'wider(3)', 'layer': 'conv2d_3', 'filters': 16, 'seed': 0, 'noise': 0.0}]
    """
    return copy.deepcopy(getattr(model, _ATTRIBUTE, []))


def set_history(model: keras.Model, history: Iterable[Mapping[str, Any]]) -> None:
    """Give `model` a history, for example one that was read from its file.

    Args:
        model: the `keras.Model` that is to carry it.
        history: what `history_of` returned for the same model.
    """
    # Set past Keras, whose own attribute tracking would wrap the list and its dicts.
    object.__setattr__(model, _ATTRIBUTE, [copy.deepcopy(dict(entry)) for entry in history])
