"""What all formats have in common: the job of writing a file, and the runtime that opens and runs it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.architecture import INPUT_SIZE

if TYPE_CHECKING:
    import keras

INPUT = "depth"
"""Name of the input in the formats whose inputs have names."""

FLOAT16 = "float16"
INT8 = "int8"

Image = npt.NDArray[np.float32]
"""(1, H, W, 1) network input: depth in metres minus the image's mean."""


class Job(NamedTuple):
    """What is to be written."""

    model: keras.Model
    """The network, for images of one size."""
    quantization: str | None = None
    representative: Sequence[Image] = ()
    """Inputs by which int8 finds the ranges of the layers."""


class Runtime(NamedTuple):
    """A written file, opened by the software that is to run it."""

    outputs: tuple[str, ...]
    """Names of the outputs, in the file's order."""
    run: Callable[[Image], Sequence[npt.ArrayLike]]
    """The four maps of an image, in the order of `outputs`."""


def input_size(model: keras.Model) -> tuple[int, int]:
    """Height and width of a network's input in pixels; of one that takes any size, those of GG-CNN."""
    height, width = model.inputs[0].shape[1:3]
    return int(height or INPUT_SIZE), int(width or INPUT_SIZE)
