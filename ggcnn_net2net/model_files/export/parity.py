"""Whether a written file computes what the Keras model computes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.errors import ExportError
from ggcnn_net2net.grasping import Grasp, iou_success, published_rectangle
from ggcnn_net2net.grasping.decoding import best_grasp
from ggcnn_net2net.model_files.export.runtime import FLOAT16, INT8, Image, Runtime

TOLERANCES = {None: 1e-4, FLOAT16: 2e-2}
"""Quantization -> largest difference from the Keras maps, in units of the largest value of the map or 1."""

LEAST_AGREEMENT = {INT8: 0.5}
"""Quantization -> least share of images with the same grasp, for what is too coarse to be judged by its maps."""

Maps = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Parity:
    """How a file compares with the Keras model."""

    images: int
    max_abs_difference: dict[str, float]
    """Output -> largest difference of a pixel on any image."""
    same_grasp: int
    """Images on which both see the same best grasp (IoU above 0.25, closing directions within 30°), or none."""
    no_grasp: int
    """Images on which the Keras model sees none."""

    @property
    def agreement(self) -> float:
        """Share of the images with the same grasp."""
        return self.same_grasp / self.images


def compare(runtime: Runtime, inputs: Sequence[Image], expected: Sequence[Maps]) -> Parity:
    """Run a file on all images and compare its maps with those of the Keras model.

    Args:
        runtime: the opened file.
        inputs: n network inputs.
        expected: the n Keras maps, (4, H, W) each.

    Raises:
        ExportError: outputs that are missing, in another order or of another shape, or values that are not finite.
    """
    if runtime.outputs != HEADS:
        raise ExportError(
            f"expected the outputs {', '.join(HEADS)} in this order, the written file has {', '.join(runtime.outputs)}"
        )
    received = [_run(runtime, image, maps.shape) for image, maps in zip(inputs, expected, strict=True)]
    differences = np.abs(np.stack(received) - np.stack(expected)).max(axis=(0, 2, 3))
    grasps = [(best_grasp(one), best_grasp(other)) for one, other in zip(received, expected, strict=True)]
    return Parity(
        images=len(inputs),
        max_abs_difference=dict(zip(HEADS, differences.tolist(), strict=True)),
        same_grasp=sum(_same(one, other) for one, other in grasps),
        no_grasp=sum(other is None for _, other in grasps),
    )


def check(parity: Parity, expected: Sequence[Maps], quantization: str | None) -> None:
    """Raise an ExportError if a file is too far from the Keras model for what it is meant to be."""
    if quantization in TOLERANCES:
        limits = TOLERANCES[quantization] * np.maximum(np.abs(np.stack(expected)).max(axis=(0, 2, 3)), 1)
        for (name, difference), limit in zip(parity.max_abs_difference.items(), limits, strict=True):
            if difference > limit:
                raise ExportError(
                    f"expected {name} to differ from the Keras model by {limit:.2g} at most, the written file differs "
                    f"by {difference:.2g} on {parity.images} images"
                )
        return
    assert quantization is not None
    least = LEAST_AGREEMENT[quantization]
    if parity.agreement < least:
        raise ExportError(
            f"expected the same grasp as the Keras model on {least:.0%} of the images, the {quantization} file gives "
            f"it on {parity.same_grasp} of {parity.images}: choose representative images like those of use, or float16"
        )


def _run(runtime: Runtime, image: Image, shape: tuple[int, ...]) -> Maps:
    """The four maps (4, H, W) of one image."""
    outputs = [np.asarray(output, np.float32) for output in runtime.run(image)]
    for name, output in zip(HEADS, outputs, strict=True):
        if output.shape != (1, *shape[1:], 1):
            raise ExportError(f"expected {name} of shape {(1, *shape[1:], 1)}, the written file gives {output.shape}")
        if not np.isfinite(output).all():
            raise ExportError(f"expected finite maps, the written file gives NaN or infinity in {name}")
    return np.stack(outputs)[:, 0, ..., 0]


def _same(one: Grasp | None, other: Grasp | None) -> bool:
    if one is None or other is None:
        return one is other
    return iou_success(one, published_rectangle(other)[None], wrapped_angle_difference=True)
