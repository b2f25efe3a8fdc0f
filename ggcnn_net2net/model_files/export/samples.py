"""Depth images on which an export is compared with the Keras model."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import DatasetError, DepthImageError
from ggcnn_net2net.model_files.export.runtime import Image
from ggcnn_net2net.reference_data import data_root

_CORNELL, _SIMULATED = 8, 4  # images; a simulated one takes a second
_REPRESENTATIVE = 100

Depth = npt.NDArray[np.floating]


def default_samples(size: tuple[int, int]) -> tuple[Depth, str]:
    """Depth images (n, H, W) in metres, and where they come from.

    Cornell scenes where the folder of the reference data has them, simulated scenes of training objects otherwise.
    """
    root = data_root()
    if root is not None and (root / "cornell").is_dir():
        with suppress(DatasetError):  # no scenes there
            return scene_images(root / "cornell", _CORNELL, size), "Cornell Grasping Dataset"
    return np.stack([_crop(image, np.array(image.shape) / 2, size) for image in _simulated()]), "simulated scenes"


def scene_images(folder: Path, count: int, size: tuple[int, int]) -> Depth:
    """Depth (n, H, W) around the grasps of up to `count` scenes of a raw folder, spread evenly over it."""
    from ggcnn_net2net.datasets.raw import open_scenes

    scenes = open_scenes(folder)
    count = min(count, len(scenes))
    chosen = (scenes[index * len(scenes) // count] for index in range(count))
    return np.stack([_crop(scene.depth, scene.rectangles.mean(axis=(0, 1)), size) for scene in chosen])


def read_representative(path: Path, size: tuple[int, int]) -> Depth:
    """Depth images (n, H, W) for int8, from the training split of a dataset file or from a folder of raw scenes.

    Those of a dataset file have its size, which has to be that of the network.

    Raises:
        DatasetError: neither, or damaged.
    """
    if path.is_dir():
        return scene_images(path, _REPRESENTATIVE, size)
    from ggcnn_net2net.datasets.concatenation import splits_of

    dataset = splits_of(path)[0]
    count = min(_REPRESENTATIVE, len(dataset))
    images, _ = dataset.batch([index * len(dataset) // count for index in range(count)])
    return images[..., 0]


@cache
def _simulated() -> tuple[Depth, ...]:
    from ggcnn_net2net.datasets.simulated import Simulation, simulate_scene
    from ggcnn_net2net.simulation.world import World

    with World() as world:
        return tuple(simulate_scene(world, index, Simulation()).scene.depth for index in range(_SIMULATED))


def _crop(image: Depth, centre: npt.ArrayLike, size: tuple[int, int]) -> Depth:
    """The window of `size` around `centre`, within the image; of a smaller image its largest part, enlarged."""
    import cv2

    scale = min(1, *(side / wanted for side, wanted in zip(image.shape, size, strict=True)))
    window = [round(scale * wanted) for wanted in size]
    start = np.round(np.asarray(centre) - np.array(window) / 2).astype(int)
    top, left = np.clip(start, 0, np.array(image.shape) - window)
    crop = image[top : top + window[0], left : left + window[1]]
    return crop if crop.shape == size else np.asarray(cv2.resize(crop, size[::-1]), image.dtype)


def network_inputs(depth: Depth, size: tuple[int, int], what: str) -> list[Image]:
    """Each image as the network takes it: metres minus the image's mean.

    Args:
        depth: (n, H, W) metres.
        size: height and width that the network takes.
        what: names the images in the error.

    Raises:
        DepthImageError: none, of another size, or not finite.
    """
    images = np.asarray(depth)
    if images.ndim != 3 or not len(images) or images.shape[1:] != size:
        raise DepthImageError(
            f"expected {what} as (n, {size[0]}, {size[1]}) depth in metres, received shape {images.shape}: crop and "
            "resize them to the network's input"
        )
    if not np.isfinite(images).all():
        raise DepthImageError(f"expected finite {what}, received NaN or infinity: fill in missing pixels first")
    return list(_centred(images))


def _centred(images: Depth) -> Iterator[Image]:
    for image in images:
        yield (image - image.mean())[None, ..., None].astype(np.float32)
