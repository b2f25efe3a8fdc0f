import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ggcnn_net2net.errors import SceneError
from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.parallel import LocalWorkers
from ggcnn_net2net.protocol import PAPER
from ggcnn_net2net.simulation import GripperSpec
from ggcnn_net2net.simulation.benchmark import prepare_scenes, run_trials
from ggcnn_net2net.simulation.convex import box, cylinder, ellipsoid
from ggcnn_net2net.simulation.object_sets import ObjectSet
from ggcnn_net2net.simulation.scenes import MAX_DROPS, SceneSettings, load_scenes, make_scene, save_scenes
from ggcnn_net2net.simulation.trial import Outcome


@pytest.fixture(scope="module")
def workers():
    with LocalWorkers(2) as workers:
        yield workers


@pytest.fixture
def one_worker():
    with LocalWorkers(1) as workers:
        yield workers


@pytest.fixture
def objects(model):
    return ObjectSet(
        "three",
        (
            model("brick", [box((0.06, 0.15, 0.08))]),
            model("plank", [box((0.2, 0.05, 0.02))]),
            model("can", [cylinder(0.04, 0.12)]),
        ),
    )


def same(first, second):
    return (
        (first.key, first.position, first.orientation, first.stable, first.drops)
        == (second.key, second.position, second.orientation, second.stable, second.drops)
        and np.array_equal(first.depth, second.depth)
        and np.array_equal(first.rgb, second.rgb)
    )


def centred(scene):
    row, col, _ = scene.camera.pixel_from_world(scene.position)
    return Grasp(round(row), round(col), 0.4, 40)


def test_any_number_of_workers_gives_the_same_bits(objects, one_worker, workers, tmp_path):
    settings = SceneSettings.of(objects, 2, seed=5)
    one = prepare_scenes(tmp_path / "one.h5", objects, settings, one_worker)
    two = prepare_scenes(tmp_path / "two.h5", objects, settings, workers)
    assert [scene.key for scene in one] == ["brick/0", "brick/1", "plank/0", "plank/1", "can/0", "can/1"]
    assert all(map(same, one, two))
    grasps = [centred(scene) for scene in one]
    results_one = dict(run_trials(one, grasps, PAPER, one_worker))
    results_two = dict(run_trials(two, grasps, PAPER, workers))
    assert results_one == results_two
    assert len(results_one) == 6
    assert {result.outcome for result in results_one.values()} & {Outcome.SUCCESS, Outcome.MISSED}
    wrong = GripperSpec(max_opening=0.01)  # the workers' gripper is the one that is asked for
    assert not any(result.success for _, result in run_trials(one, grasps, PAPER, workers, wrong))


def test_scenes_are_saved_and_only_missing_ones_are_made(objects, workers, tmp_path):
    path = tmp_path / "scenes.h5"
    settings = SceneSettings.of(objects, 2, seed=1)
    scenes = prepare_scenes(path, objects, settings, workers)
    assert all(map(same, scenes, load_scenes(path, objects, settings)))
    save_scenes(path, scenes[:4], settings)  # as after an interruption
    made = []
    watched = SimpleNamespace(run=lambda function, inputs: workers.run(function, remember(inputs, made)))
    again = prepare_scenes(path, objects, settings, watched)
    assert [(values[0].name, values[1]) for values in made] == [("can", 0), ("can", 1)]
    assert all(map(same, scenes, again))


def remember(inputs, made):
    for values in inputs:
        made.append(values)
        yield values


def test_seed_and_pose_decide_the_scene(world, objects):
    plank = objects.objects[1]
    first = make_scene(world, plank, 0, 0)
    assert same(first, make_scene(world, plank, 0, 0))
    assert not same(first, make_scene(world, plank, 1, 0))
    assert not same(first, make_scene(world, plank, 0, 1))


def test_scenes_look_at_a_resting_object(world, objects):
    scene = make_scene(world, objects.objects[0], 0, 3)
    assert scene.stable
    row, col, depth = scene.camera.pixel_from_world(scene.position)
    assert (row, col) == pytest.approx((149, 150))  # the camera looks at the object
    assert scene.depth[149, 150] == pytest.approx(depth, abs=0.09)
    assert scene.depth[149, 150] < scene.depth[10, 10] - 0.01


def test_an_object_that_never_rests_makes_an_unstable_scene(world, model, monkeypatch):
    ball = model("ball", [ellipsoid((0.05, 0.05, 0.05))])
    monkeypatch.setattr(type(world), "settle", lambda self, body: False)
    scene = make_scene(world, ball, 0, 0)
    assert not scene.stable
    assert scene.drops == MAX_DROPS


def test_scenes_of_other_settings_or_objects_are_refused(objects, workers, tmp_path):
    path = tmp_path / "scenes.h5"
    settings = SceneSettings.of(objects, 1, seed=1)
    prepare_scenes(path, objects, settings, workers)
    with pytest.raises(SceneError, match="seed=2"):
        load_scenes(path, objects, replace(settings, seed=2))
    fewer = ObjectSet("two", objects.objects[:2])
    with pytest.raises(SceneError, match="meshes differ"):
        load_scenes(path, fewer)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(SceneError, match="remove it"):
        load_scenes(path, objects)


@pytest.mark.parametrize(("poses", "seed"), [(0, 0), (1, -1)])
def test_impossible_settings(objects, poses, seed):
    with pytest.raises(SceneError, match="expected poses"):
        SceneSettings.of(objects, poses, seed)


def test_a_crashing_trial_is_reported_and_the_others_go_on(world, objects, workers):
    scenes = [make_scene(world, item, 0, 0) for item in objects.objects]
    broken = replace(scenes[1], model=replace(scenes[1].model, mesh=Suicide()))
    results = dict(run_trials([scenes[0], broken, scenes[2]], [centred(scene) for scene in scenes], PAPER, workers))
    assert results[1].outcome is Outcome.CRASHED
    assert not results[1].success
    assert {results[0].outcome, results[2].outcome}.isdisjoint({Outcome.CRASHED})


class Suicide:
    """Ends the worker process that asks for its name, as a segmentation fault of the physics engine would."""

    def __str__(self) -> str:
        os._exit(11)
        return ""
