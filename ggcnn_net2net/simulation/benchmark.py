"""The benchmark: many scenes, one trial a scene, spread over worker processes. Same results for any number of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.parallel import Crash, run_parallel
from ggcnn_net2net.protocol import Protocol
from ggcnn_net2net.simulation.object_sets import ObjectModel
from ggcnn_net2net.simulation.scenes import Scene, make_scene
from ggcnn_net2net.simulation.trial import Outcome, TrialResult, run_trial
from ggcnn_net2net.simulation.world import Bin, World


@cache
def _process_world() -> World:
    """The one world of this worker process; connecting costs more than resetting."""
    return World()


def _make_scene(model: ObjectModel, pose: int, seed: int) -> Scene:
    return make_scene(_process_world(), model, pose, seed)


def _run_trial(scene: Scene, grasp: Grasp | None, protocol: Protocol) -> TrialResult:
    return run_trial(_process_world(), scene, grasp, protocol)


def make_scenes(jobs: Sequence[tuple[ObjectModel, int]], seed: int, workers: int) -> Iterator[Scene | Crash]:
    """Make one scene of every (object, pose), as they come.

    Args:
        jobs: objects and indices of poses.
        seed: of the whole set.
        workers: processes.

    Yields:
        A `Scene`, or a `Crash` where a worker died twice on it.
    """
    for _, scene in run_parallel(_make_scene, ((model, pose, seed) for model, pose in jobs), workers):
        yield scene


def run_trials(
    scenes: Sequence[Scene], grasps: Sequence[Grasp | None], protocol: Protocol, workers: int
) -> Iterator[tuple[int, TrialResult]]:
    """Execute one grasp on each scene.

    Args:
        scenes: n scenes.
        grasps: a grasp in the pixels of each scene's image, or None where the network found none.
        protocol: see `Protocol`.
        workers: processes.

    Yields:
        Index of the scene and result, as they come. A trial on which a worker died twice is a failure with the outcome
        `Outcome.CRASHED`.
    """
    inputs = ((scene, grasp, protocol) for scene, grasp in zip(scenes, grasps, strict=True))
    for index, result in run_parallel(_run_trial, inputs, workers):
        if isinstance(result, Crash):
            distance = Bin().horizontal_distance(scenes[index].position)
            yield index, TrialResult(Outcome.CRASHED, False, False, distance, 0)
        else:
            yield index, result
