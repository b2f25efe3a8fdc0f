"""What candidates are judged by: IoU rate, test loss, or success rate in simulation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.search.journal import resume_command
from ggcnn_net2net.search.settings import IOU, LOSS, SearchSettings

if TYPE_CHECKING:
    import keras

    from ggcnn_net2net.datasets.hdf5 import GraspDataset
    from ggcnn_net2net.parallel import Workers
    from ggcnn_net2net.simulation.object_sets import ObjectSet
    from ggcnn_net2net.simulation.scenes import SceneSettings

SCENES_FILE = "scenes.h5"


def score(model: keras.Model, settings: SearchSettings, data: Path, directory: Path) -> float:
    """Score a network.

    Args:
        model: the network.
        settings: of the search; the heuristic and what belongs to it.
        data: dataset file, of which the test split is used.
        directory: folder of the search, where the scenes of the simulation are (`prepare_simulation`).

    Returns:
        IoU rate or success rate in [0, 1], or the loss.
    """
    from ggcnn_net2net.datasets.hdf5 import GraspDataset

    if settings.heuristic not in (IOU, LOSS):
        return _success_rate(model, settings, directory)
    test = GraspDataset(data, "test")
    images = EvenRows(test, settings.score_images or len(test))
    if settings.heuristic == LOSS:
        from ggcnn_net2net.training import mean_loss

        return mean_loss(model, images, settings.recipe)
    from ggcnn_net2net.inference.iou_rate import iou_rate_of

    return iou_rate_of(model, images, settings.protocol).rate


class EvenRows:
    """Some rows of a dataset, spread evenly over it: rows of one scene stand together, and all scenes should count."""

    def __init__(self, data: GraspDataset, number: int) -> None:
        self._data = data
        self.rows = np.linspace(0, len(data) - 1, min(number, len(data))).round().astype(int)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def fingerprint(self) -> str:
        """Of the whole dataset, and how many rows are taken."""
        return f"{self._data.fingerprint} {len(self)}"

    def batch(self, rows: Sequence[int], epoch: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Inputs and targets, see `GraspDataset.batch`."""
        return self._data.batch(self.rows[list(rows)].tolist(), epoch)

    def depth(self, row: int) -> npt.NDArray[np.float32]:
        """One image, see `GraspDataset.depth`."""
        return self._data.depth(int(self.rows[row]))

    def rectangles(self, row: int) -> npt.NDArray[np.float64]:
        """Labelled rectangles, see `GraspDataset.rectangles`."""
        return self._data.rectangles(int(self.rows[row]))


def prepare_simulation(settings: SearchSettings, directory: Path, workers: Workers) -> None:
    """Make the scenes on which the heuristic "sim" judges, and put them into the folder of the search.

    Raises:
        SearchError: worker processes died while making them.
    """
    from ggcnn_net2net.simulation.benchmark import prepare_scenes

    objects, scene_settings = simulation_of(settings)
    scenes = prepare_scenes(directory / SCENES_FILE, objects, scene_settings, workers)
    expected = len(objects.objects) * settings.sim_poses
    if len(scenes) < expected:
        raise SearchError(
            f"expected {expected} scenes, received {len(scenes)}: worker processes died; go on with "
            f"`{resume_command(directory)}`"
        )


def simulation_of(settings: SearchSettings) -> tuple[ObjectSet, SceneSettings]:
    """What the heuristic "sim" judges on.

    Args:
        settings: of the search.

    Returns:
        The objects, and the settings of the scenes.

    Raises:
        ObjectSetError, DataNotFoundError: as `load_object_set`.
    """
    from ggcnn_net2net.simulation.object_sets import load_object_set
    from ggcnn_net2net.simulation.scenes import SceneSettings

    objects = load_object_set(settings.sim_objects, settings.protocol)
    return objects, SceneSettings.of(objects, settings.sim_poses, settings.seed)


def _success_rate(model: keras.Model, settings: SearchSettings, directory: Path) -> float:
    """One trial on every scene, in this process: the search has a process for every core already."""
    from ggcnn_net2net.inference import predict_grasps
    from ggcnn_net2net.simulation.scenes import depth_images, load_scenes
    from ggcnn_net2net.simulation.trial import decoding_of, run_trial
    from ggcnn_net2net.simulation.world import process_world

    scenes = load_scenes(directory / SCENES_FILE, *simulation_of(settings))
    grasps: Any = predict_grasps(model, depth_images(scenes), decoding_of(settings.protocol))
    trials = (
        run_trial(process_world(), scene, grasp, settings.protocol) for scene, grasp in zip(scenes, grasps, strict=True)
    )
    return sum(trial.success for trial in trials) / len(scenes)
