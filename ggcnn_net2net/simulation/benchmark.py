"""The benchmark: many scenes, one trial a scene, spread over worker processes. Same results for any number of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.parallel import Crash, Workers
from ggcnn_net2net.protocol import Protocol
from ggcnn_net2net.simulation.gripper_spec import GripperSpec
from ggcnn_net2net.simulation.object_sets import ObjectModel, ObjectSet
from ggcnn_net2net.simulation.scenes import Scene, SceneSettings, load_scenes, make_scene, save_scenes, scene_key
from ggcnn_net2net.simulation.trial import Outcome, TrialResult, run_trial
from ggcnn_net2net.simulation.world import Bin, process_world

_SAVE_EVERY = 30.0  # seconds between saves of unfinished scenes


def _make_scene(model: ObjectModel, pose: int, seed: int) -> Scene:
    return make_scene(process_world(), model, pose, seed)


def _run_trial(scene: Scene, grasp: Grasp | None, protocol: Protocol, gripper: GripperSpec | None) -> TrialResult:
    return run_trial(process_world(), scene, grasp, protocol, gripper)


def prepare_scenes(
    path: Path,
    objects: ObjectSet,
    settings: SceneSettings,
    workers: Workers,
    on_progress: Callable[[int], None] = lambda _: None,
) -> list[Scene]:
    """Scenes of every object and pose: those in `path` are read, missing ones are made and saved there.

    Args:
        path: HDF5 file of the scenes; need not exist.
        objects: the object set.
        settings: of the set of scenes.
        workers: make them. They have to see the meshes under the same paths.
        on_progress: called with the number of scenes that are there, whenever it changes.

    Returns:
        Scenes in the order of objects and poses. Scenes on which a worker died twice are left out, and made again when
        this is called again. An interrupted call keeps what it made.

    Raises:
        SceneError: `path` holds scenes of other objects or settings.
    """
    jobs = [(model, pose) for model in objects.objects for pose in range(settings.poses)]
    scenes = {scene.key: scene for scene in load_scenes(path, objects, settings)} if path.is_file() else {}
    missing = [(model, pose) for model, pose in jobs if scene_key(model.name, pose) not in scenes]
    on_progress(len(scenes))
    if not missing:
        return list(scenes.values())
    saved = time.monotonic()
    try:
        inputs = ((model, pose, settings.seed) for model, pose in missing)
        for _, scene in workers.run(_make_scene, inputs):
            if not isinstance(scene, Crash):
                scenes[scene.key] = scene
                on_progress(len(scenes))
            if time.monotonic() - saved > _SAVE_EVERY:
                save_scenes(path, scenes.values(), settings)
                saved = time.monotonic()
    finally:
        if scenes:
            save_scenes(path, scenes.values(), settings)
    return [scenes[key] for model, pose in jobs if (key := scene_key(model.name, pose)) in scenes]


def run_trials(
    scenes: Sequence[Scene],
    grasps: Iterable[Grasp | None],
    protocol: Protocol,
    workers: Workers,
    gripper: GripperSpec | None = None,
) -> Iterator[tuple[int, TrialResult]]:
    """Execute one grasp on each scene.

    Args:
        scenes: n scenes.
        grasps: a grasp in the pixels of each scene's image, or None where the network found none; each is asked for
            when a worker is about to be free for it.
        protocol: see `Protocol`.
        workers: run them. They have to see the meshes under the same paths.
        gripper: what grasps; the paper's by default.

    Yields:
        Index of the scene and result, as they come. A trial on which a worker died twice is a failure with the outcome
        `Outcome.CRASHED`.
    """
    inputs = ((scene, grasp, protocol, gripper) for scene, grasp in zip(scenes, grasps, strict=True))
    for index, result in workers.run(_run_trial, inputs):
        if isinstance(result, Crash):
            distance = Bin().horizontal_distance(scenes[index].position)
            yield index, TrialResult(Outcome.CRASHED, False, False, distance, 0)
        else:
            yield index, result
