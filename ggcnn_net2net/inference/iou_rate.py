"""Score a GG-CNN on a dataset: the network, the decoding and the IoU rule in sequence."""

from __future__ import annotations

import typing
from collections.abc import Callable, Iterator
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import DatasetError, GraspError
from ggcnn_net2net.grasping import RSS_2018, Grasp, IouRate, iou_rate
from ggcnn_net2net.grasping.decoding import best_grasp
from ggcnn_net2net.inference.predict import predict_maps
from ggcnn_net2net.parallel import Crash, run_parallel
from ggcnn_net2net.protocol import Protocol

if TYPE_CHECKING:
    import keras

_BLOCK = 16  # images a worker decodes at once; 23 MB of maps
_DECODING = RSS_2018  # its angle window of 0 is that of the published IoU rate


class TestData(typing.Protocol):
    """What `iou_rate_of` needs of a dataset, for example one split of `datasets.hdf5.GraspDataset`."""

    def __len__(self) -> int:
        """Images."""

    def depth(self, row: int) -> npt.NDArray[np.float32]:
        """(H, W) depth in metres, minus the image's mean and clipped."""

    def rectangles(self, row: int) -> npt.NDArray[np.float64]:
        """(k, 4, 2) corners (row, col) of an image's positive rectangles."""


def iou_rate_of(
    model: keras.Model,
    dataset: TestData,
    protocol: Protocol,
    workers: int = 1,
    on_progress: Callable[[str, int, int], None] = lambda _stage, _done, _total: None,
) -> IouRate:
    """IoU rate of a network on every image of a dataset.

    Args:
        model: a GG-CNN for images of the dataset's size.
        dataset: images and rectangles.
        protocol: `iou_recentres_depth` subtracts each image's mean once more before the network sees it;
            `wrapped_angle_difference` is the reading of the angle difference.
        workers: processes that decode maps while this one computes them. The result does not depend on it. 1 decodes
            here, which is the quickest where TensorFlow keeps all cores busy anyway.
        on_progress: called with (protocol name, images done, all images).

    Returns:
        Whether each image is a success, and their share.

    Raises:
        DatasetError: no images, or images of another size than the network's.
        GraspError: maps that are not finite, or a worker process that died twice on the same images.
    """
    total = len(dataset)
    if total == 0:
        raise DatasetError("expected a dataset with at least one image, received none: name another split")
    images = _inputs(model, dataset, protocol.iou_recentres_depth)
    decoded: dict[int, list[Grasp | None]] = {}
    done = 0
    on_progress(protocol.name, done, total)
    for index, found in _decode_all(predict_maps(model, images), workers):
        if isinstance(found, Crash):
            raise GraspError(
                f"a worker process died {found.attempts} times, with exit code {found.exit_code}, while it decoded "
                f"images from {index * _BLOCK} on: is memory short? Use fewer workers"
            )
        decoded[index] = found
        done += len(found)
        on_progress(protocol.name, done, total)
    return iou_rate(
        [grasp for index in sorted(decoded) for grasp in decoded[index]],
        [dataset.rectangles(row) for row in range(total)],
        wrapped_angle_difference=protocol.wrapped_angle_difference,
    )


def _inputs(model: keras.Model, dataset: TestData, recentred: bool) -> Iterator[npt.NDArray[np.float32]]:
    """Network inputs (H, W), one by one."""
    size = tuple(model.input_shape[1:3])
    for row in range(len(dataset)):
        image = dataset.depth(row)
        if None not in size and image.shape != size:
            raise DatasetError(f"expected images of {size} px, which the network takes, received {image.shape}")
        yield image - image.mean() if recentred else image


def _decode_all(maps: Iterator[npt.NDArray[np.float32]], workers: int) -> Iterator[tuple[int, Any]]:
    """Grasps of consecutive images, by the number of their block; alone, every image is a block."""
    if workers > 1:
        return run_parallel(_decode, _blocks(maps), workers)
    return ((index, _decode(one[None])) for index, one in enumerate(maps))


def _blocks(maps: Iterator[npt.NDArray[np.float32]]) -> Iterator[tuple[npt.NDArray[np.float32]]]:
    """Stack consecutive images' maps: (n, 4, H, W), n up to `_BLOCK`, as arguments of `_decode`."""
    while block := list(islice(maps, _BLOCK)):
        yield (np.stack(block),)


def _decode(maps: npt.NDArray[np.float32]) -> list[Grasp | None]:
    """The best grasp of each of n images, from their maps (n, 4, H, W)."""
    return [best_grasp(of_image, _DECODING) for of_image in maps]
