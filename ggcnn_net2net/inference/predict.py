"""Run a GG-CNN on depth images."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.grasping import RSS_2018, Decoding, Grasp
from ggcnn_net2net.grasping.decoding import best_grasp
from ggcnn_net2net.inference.network import compiled_network

if TYPE_CHECKING:
    import keras


def predict_maps(model: keras.Model, inputs: Iterable[npt.NDArray[np.floating]]) -> Iterator[npt.NDArray[np.float32]]:
    """Yield the four maps of each image, one image at a time, so that a result does not depend on its batch.

    Args:
        model: a GG-CNN.
        inputs: n network inputs (H, W): depth in metres minus the image's mean.

    Yields:
        (4, H, W): quality, cos 2θ, sin 2θ, width / 150 px.
    """
    network = compiled_network(model)
    for image in inputs:
        yield network(image[None])[0]


def predict_grasps(
    model: keras.Model, depth: npt.NDArray[np.floating], decoding: Decoding = RSS_2018
) -> list[Grasp | None]:
    """The best grasp of each depth image.

    Args:
        model: a GG-CNN.
        depth: (n, H, W) metres, of the network's input size. Each image's mean is subtracted, as in the paper's
            simulator.
        decoding: constants of the decoding.

    Returns:
        n grasps in pixels; None where the network sees none.

    Raises:
        DepthImageError: depth of another shape.
    """
    return list(each_grasp(model, depth, decoding))


def each_grasp(
    model: keras.Model, depth: npt.NDArray[np.floating], decoding: Decoding = RSS_2018
) -> Iterator[Grasp | None]:
    """Like `predict_grasps`, but an image is looked at when its grasp is asked for.

    Args:
        model: see `predict_grasps`.
        depth: see `predict_grasps`.
        decoding: see `predict_grasps`.

    Yields:
        The best grasp of each image, or None.

    Raises:
        DepthImageError: depth of another shape.
    """
    if depth.ndim != 3:
        raise DepthImageError(f"expected depth images (n, H, W), received {depth.shape}: take depth[None] for one")
    inputs = depth - depth.mean(axis=(1, 2), keepdims=True)
    for maps in predict_maps(model, inputs):
        yield best_grasp(maps, decoding)
