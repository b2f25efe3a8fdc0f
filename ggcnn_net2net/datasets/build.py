"""From raw scenes to training data: a file of augmented samples, or fresh ones in every epoch."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.datasets.augmentation import Augmentation, Sample, augment
from ggcnn_net2net.datasets.hdf5 import SPLITS, DatasetWriter
from ggcnn_net2net.datasets.label_maps import targets_of
from ggcnn_net2net.datasets.raw import Problem, SceneFile, SceneFolder
from ggcnn_net2net.datasets.scene import LabelledScene
from ggcnn_net2net.datasets.splits import Split
from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.parallel import Crash, run_parallel

_DRAWS = 10
"""Samples of a scene that a worker hands over at once; bounds the memory that waiting samples take."""


def draw_sample(scene: LabelledScene, draw: int, settings: Augmentation, seed: int) -> Sample:
    """The `draw`-th random sample of a scene; it depends on the seed, the scene's name and `draw` alone."""
    return augment(scene, np.random.default_rng([seed, zlib.crc32(scene.name.encode()), draw]), settings)


@dataclass(frozen=True)
class Build:
    """What came of building a dataset."""

    rows: dict[str, int]
    """Samples in each split."""
    problems: tuple[Problem, ...]
    """What was left out: of the folder's report, and scenes that could not be read."""


def build_dataset(
    scenes: SceneFolder,
    split: Split,
    output: Path,
    settings: Augmentation,
    seed: int = 0,
    workers: int = 1,
    on_progress: Callable[[int, int], None] | None = None,
    compressed: bool = True,
) -> Build:
    """Write `settings.per_scene` samples of every scene to a file of the HDF5 layout.

    Rows follow the order of the scenes. A scene whose files are damaged is left out and reported.

    Args:
        scenes: the raw folder.
        split: side of every scene.
        output: file to write.
        settings: size, zoom, rotation and number of samples.
        seed: of the augmentation.
        workers: processes that read scenes and draw samples; the content does not depend on it.
        on_progress: called with (parts done, parts in all).
        compressed: see `DatasetWriter`.

    Returns:
        What was written: rows of each split, and what was left out.

    Raises:
        DatasetError: the split is not of these scenes, or no scene can be read.
    """
    sides = split.side_of(scenes.objects)
    problems = list(scenes.report)
    attributes = {
        "source": f"{scenes.form} {scenes.path.resolve().name}",
        **({} if scenes.depth is None else {"depth": scenes.depth}),
        "seed": seed,
        "split": split.describe(),
        "augmentation": settings.as_dict(),
        "left_out": problems,  # grows until the file is sealed
    }
    rows = dict.fromkeys(SPLITS, 0)
    starts = range(0, settings.per_scene, _DRAWS)
    jobs = [(file, range(first, min(first + _DRAWS, settings.per_scene))) for file in scenes.files for first in starts]
    with DatasetWriter(output, attributes, compressed=compressed) as writer:
        inputs = ((*job, settings, seed) for job in jobs)
        for index, result in _in_order(run_parallel(_draw_samples, inputs, workers)):
            file, draws = jobs[index]
            if isinstance(result, Crash):
                raise DatasetError(f"a worker process died on {file.name} (exit code {result.exit_code}): memory full?")
            if isinstance(result, str):
                if draws[0] == 0:  # once a scene
                    problems.append(Problem(file.name, f"scene left out: {result}"))
            else:
                for sample in result:
                    writer.add(sides[file.name], sample)
                rows[sides[file.name]] += len(result)
            if on_progress is not None:
                on_progress(index + 1, len(jobs))
        if not any(rows.values()):
            raise DatasetError(f"expected scenes that can be read in {scenes.path}, none can: {problems[-1].problem}")
    return Build(rows, tuple(problems))


def _draw_samples(file: SceneFile, draws: range, settings: Augmentation, seed: int) -> list[Sample] | str:
    """Some samples of a scene, or what is wrong with it. Runs in a worker process."""
    import cv2

    cv2.setNumThreads(1)
    try:
        scene = file.read()
        return [draw_sample(scene, draw, settings, seed) for draw in draws]
    except DatasetError as error:
        return str(error)


def _in_order(results: Iterable[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
    waiting: dict[int, Any] = {}
    following = 0
    for index, result in results:
        waiting[index] = result
        while following in waiting:
            yield following, waiting.pop(following)
            following += 1


class FreshAugmentations:
    """Training data that draws new samples of the scenes in every epoch. Nothing but the scenes is kept.

    In epoch 0 they are those that `build_dataset` writes. A `SceneFolder` is read anew for every sample, which takes
    longer than drawing it; `list(folder)` holds all its scenes in memory (2 MB each for Cornell).
    """

    def __init__(self, scenes: Sequence[LabelledScene], settings: Augmentation, seed: int = 0) -> None:
        """Prepare to draw.

        Args:
            scenes: of the split to train on.
            settings: size, zoom, rotation and number of samples of each scene in an epoch.
            seed: with the epoch and the row it determines a sample.

        Raises:
            DatasetError: no scenes.
        """
        if len(scenes) == 0:
            raise DatasetError("expected scenes to draw samples from, received none")
        self.scenes, self.settings, self.seed = scenes, settings, seed

    def __len__(self) -> int:
        return len(self.scenes) * self.settings.per_scene

    def sample(self, row: int, epoch: int = 0) -> Sample:
        """The sample of a row in an epoch; rows of one scene stand together."""
        if not 0 <= row < len(self):
            raise DatasetError(f"expected rows of 0 to {len(self) - 1}, received {row}")
        index, repetition = divmod(int(row), self.settings.per_scene)
        draw = epoch * self.settings.per_scene + repetition
        return draw_sample(self.scenes[index], draw, self.settings, self.seed)

    def batch(self, rows: Sequence[int], epoch: int = 0) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Inputs (n, H, W, 1) and targets (n, H, W, 4) of some rows in an epoch, float32.

        Args:
            rows: indices, in any order.
            epoch: chooses the augmentation; 0 gives that of `build_dataset` with the same seed.

        Returns:
            Depth in metres minus its mean, and targets (see `targets_of`).

        Raises:
            DatasetError: a row that does not exist, or a scene that cannot be read.
        """
        samples = [self.sample(row, epoch) for row in rows]
        inputs = np.stack([sample.depth for sample in samples])[..., None]
        return inputs, np.stack([targets_of(*sample.maps) for sample in samples])

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the settings, the seed and the scenes' depth and rectangles, in hex. Reads all scenes once."""
        digest = hashlib.sha256(json.dumps([self.settings.as_dict(), self.seed]).encode())
        for scene in self.scenes:
            digest.update(scene.name.encode())
            digest.update(np.asarray(scene.depth, dtype="<f4").tobytes())
            digest.update(np.asarray(scene.rectangles, dtype="<f8").tobytes())
        return digest.hexdigest()
