from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ggcnn_net2net.atomic import alone
from ggcnn_net2net.datasets.raw import open_scenes
from ggcnn_net2net.datasets.simulated import Simulation, simulate_folder, simulate_scene
from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.grasping import rectangle_to_grasp
from ggcnn_net2net.protocol import PAPER
from ggcnn_net2net.simulation import PAPER_GRIPPER, GripperSpec
from ggcnn_net2net.simulation.training_objects import shape_of
from ggcnn_net2net.simulation.trial import run_trial
from ggcnn_net2net.simulation.world import World


@pytest.fixture(scope="module")
def world():
    with World() as world:
        yield world


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("simulated")
    simulate_folder(path, 4, Simulation(seed=3), workers=2)
    return path


def files_of(path: Path) -> dict[str, bytes]:
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


def test_scene_depends_on_settings_and_index_alone(world):
    first = simulate_scene(world, 1, Simulation(seed=3))
    simulate_scene(world, 2, Simulation(seed=3))
    again = simulate_scene(world, 1, Simulation(seed=3))
    np.testing.assert_array_equal(first.scene.depth, again.scene.depth)
    np.testing.assert_array_equal(first.rectangles, again.rectangles)
    other = simulate_scene(world, 1, Simulation(seed=4))
    assert other.scene.model.name != first.scene.model.name or other.scene.position != first.scene.position


def test_labels_lie_on_the_object(world):
    made = simulate_scene(world, 0, Simulation(seed=3))
    assert made.scene.depth.shape == (480, 640)
    assert len(made.rectangles) >= Simulation().least_labels
    points = made.scene.camera.world_from_image(made.scene.depth)
    for corners in made.rectangles:
        grasp, jaw = rectangle_to_grasp(corners)
        x, y, z = points[round(grasp.row), round(grasp.col)]
        assert z > 0.002
        assert np.hypot(x - made.scene.position[0], y - made.scene.position[1]) < made.scene.model.longest_side
        assert jaw == pytest.approx(grasp.width_px / 3)


@pytest.mark.slow
def test_labels_can_be_executed(world):
    """benchmarks/label_quality.py measures the rate; here it only has to be far above chance."""
    results = []
    for index in range(8):
        made = simulate_scene(world, index, Simulation(seed=3))
        grasp, _ = rectangle_to_grasp(made.rectangles[len(made.rectangles) // 2])
        results.append(run_trial(world, made.scene, grasp).success)
    assert sum(results) >= 6


def test_objects_without_sure_grasps_get_labels_that_hold(world):
    """Scene 10: the first object that comes to rest has none by the usual rule."""
    settings = Simulation(tried_labels=True)
    made, passed_over = (simulate_scene(world, 10, each) for each in (settings, Simulation()))
    assert (made.tried, passed_over.tried) == (True, False)
    assert made.scene.model.name != passed_over.scene.model.name
    assert len(made.rectangles) >= settings.least_labels
    again = simulate_scene(world, 10, settings)
    np.testing.assert_array_equal(again.rectangles, made.rectangles)
    chosen = made.rectangles[:: len(made.rectangles) // 4][:4]
    grasps = [rectangle_to_grasp(rectangle)[0] for rectangle in chosen]
    assert sum(run_trial(world, made.scene, grasp).success for grasp in grasps) >= 3


def test_noise_and_missing_pixels(world):
    clean = simulate_scene(world, 0, Simulation(seed=3)).scene.depth
    noisy = simulate_scene(world, 0, Simulation(seed=3, noise=0.002)).scene.depth
    assert np.std((noisy - clean) / clean**2) == pytest.approx(0.002, rel=0.02)
    holed = simulate_scene(world, 0, Simulation(seed=3, missing=0.5)).scene.depth
    changed = holed != clean
    assert 0 < changed.mean() < 0.1
    assert np.isfinite(holed).all()


def test_folder_reads_as_cornell(folder, world):
    scenes = open_scenes(folder)
    assert scenes.form == "cornell"
    assert scenes.report == ()
    assert [scene.name for scene in scenes] == [f"pcd{index:04d}" for index in range(4)]
    made = simulate_scene(world, 2, Simulation(seed=3))
    np.testing.assert_array_equal(scenes[2].depth, made.scene.depth)
    np.testing.assert_array_equal(scenes[2].rgb, made.scene.rgb)
    np.testing.assert_allclose(scenes[2].rectangles, made.rectangles, atol=0.006)
    assert scenes.objects["pcd0002"].endswith(shape_of(made.scene.model))


def test_folder_goes_on_and_does_not_depend_on_workers(folder, tmp_path):
    simulate_folder(tmp_path, 2, Simulation(seed=3), workers=1)
    (tmp_path / "01" / "pcd0001scene.json").unlink()  # as if killed while it was written
    simulate_folder(tmp_path, 4, Simulation(seed=3), workers=1)
    assert files_of(tmp_path) == files_of(folder)
    assert len(simulate_folder(tmp_path, 2, Simulation(seed=3), workers=1)) == 2
    assert files_of(tmp_path) == files_of(folder)  # all four are still listed


def test_an_interrupted_call_lists_the_scenes_that_are_there(tmp_path, monkeypatch):
    def interrupt(done, total):
        if done == 3:
            raise KeyboardInterrupt

    simulate_folder(tmp_path, 1, Simulation(seed=3), workers=1)
    with pytest.raises(KeyboardInterrupt):
        simulate_folder(tmp_path, 4, Simulation(seed=3), 1, interrupt)
    scenes = open_scenes(tmp_path)
    assert len(scenes) >= 3
    assert scenes.report == ()


@pytest.mark.parametrize("sides", [(0.03, 0.2), (0.2, 0.1), (0.1, 0.4), (0.3, 0.32)])
def test_sides_that_no_object_can_have_are_refused(sides):
    with pytest.raises(DatasetError, match=r"sides from 0.04 to 0.32 m, the lower one first and at most 0.25 m"):
        Simulation(sides=sides)


def test_sides_belong_to_the_settings(folder):
    assert "sides" not in Simulation().as_dict()
    assert Simulation(sides=(0.2, 0.3)).as_dict()["sides"] == [0.2, 0.3]
    assert Simulation().as_dict()["protocol"] == "PAPER"
    own = replace(PAPER, object_centre="volume")
    assert Simulation(protocol=own).as_dict()["protocol"] == own.as_dict()
    with pytest.raises(DatasetError, match=r"sides \(all there, \[0.2, 0.3\] here\)"):
        simulate_folder(folder, 4, Simulation(seed=3, sides=(0.2, 0.3)), workers=1)


def test_folder_of_other_settings_is_refused(folder):
    before = files_of(folder)
    with pytest.raises(DatasetError, match=r"noise \(0.0 there, 0.001 here\)"):
        simulate_folder(folder, 4, Simulation(seed=3, noise=0.001), workers=1)
    with pytest.raises(DatasetError, match=r"tried_labels \(none there, .*'alignment': 0.7.*'tries': 12"):
        simulate_folder(folder, 4, Simulation(seed=3, tried_labels=True), workers=1)
    assert files_of(folder) == before


SMALL = GripperSpec(palm=(0.1, 0.02, 0.01), finger_length=0.04, max_opening=0.08)


def test_a_folder_that_another_process_writes_to_is_refused(tmp_path):
    busy = alone(tmp_path / "scenes.lock", RuntimeError("not busy yet"))
    with busy, pytest.raises(DatasetError, match=r"another process writes scenes there.*another folder"):
        simulate_folder(tmp_path, 1, Simulation(seed=3), workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["scenes.lock"]


def test_labels_are_for_the_gripper(world):
    made = simulate_scene(world, 0, Simulation(seed=3, gripper=SMALL))
    depth, camera = made.scene.depth, made.scene.camera
    for corners in made.rectangles:
        grasp, _ = rectangle_to_grasp(corners)
        assert grasp.width_px * depth[round(grasp.row), round(grasp.col)] / camera.focal_px <= 0.0801
    results = [
        run_trial(world, made.scene, rectangle_to_grasp(corners)[0], gripper_spec=SMALL).success
        for corners in made.rectangles[:: len(made.rectangles) // 3]
    ]
    assert sum(results) >= 2


def test_a_gripper_is_a_setting_of_a_folder(folder, tmp_path):
    assert "gripper" not in json.loads((folder / "simulation.json").read_text())  # the paper's leaves no trace
    with pytest.raises(DatasetError, match=r"gripper \(the paper's there, .*'max_opening': 0.08"):
        simulate_folder(folder, 4, Simulation(seed=3, gripper=SMALL), workers=1)
    simulate_folder(tmp_path, 1, Simulation(seed=3, gripper=SMALL), workers=1)
    assert json.loads((tmp_path / "simulation.json").read_text())["gripper"]["palm"] == [0.1, 0.02, 0.01]
    simulate_folder(tmp_path, 1, Simulation(seed=3, gripper=SMALL), workers=1)
    for other in (PAPER_GRIPPER, replace(SMALL, max_opening=0.07)):
        with pytest.raises(DatasetError, match=r"differs in gripper \(.*0.08"):
            simulate_folder(tmp_path, 1, Simulation(seed=3, gripper=other), workers=1)


def test_damaged_settings_are_named(folder, tmp_path):
    (tmp_path / "simulation.json").write_text("{")
    with pytest.raises(DatasetError, match=r"simulation.json"):
        simulate_folder(tmp_path, 1, Simulation(), workers=1)


def test_record_of_a_scene(folder):
    record = json.loads((folder / "01" / "pcd0000scene.json").read_text())
    assert record["name"] == "pcd0000"
    assert record["labels"] * 4 == len((folder / "01" / "pcd0000cpos.txt").read_text().splitlines())


@pytest.mark.parametrize(
    "wrong",
    [
        {"seed": -1},
        {"noise": -0.1},
        {"missing": 1.5},
        {"least_labels": 0},
        {"camera_heights": (1.7, 1.3)},
        {"camera_offset": 2.0},
    ],
)
def test_wrong_settings(wrong):
    with pytest.raises(DatasetError, match="expected"):
        replace(Simulation(), **wrong)


@pytest.mark.parametrize("count", [0, 10_001])
def test_wrong_number_of_scenes(tmp_path, count):
    with pytest.raises(DatasetError, match="10000 scenes"):
        simulate_folder(tmp_path, count, Simulation(), workers=1)
