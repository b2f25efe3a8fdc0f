import sys

import numpy as np
import pytest

from ggcnn_net2net.errors import SimulationError
from ggcnn_net2net.simulation.object_sets import ObjectModel
from ggcnn_net2net.simulation.world import GRAVITY, TIME_STEP, Bin, World


def test_free_fall_takes_the_time_it_should(world, box_scene):
    world.reset()
    body = world.add_object(box_scene.model, (0, 0, 2.04), (0, 0, 0, 1))
    while not world.client.getContactPoints(body):
        world.step()
    assert world.steps * TIME_STEP == pytest.approx(np.sqrt(2 * 2.0 / -GRAVITY), rel=0.02)


def test_same_steps_after_reset_give_the_same_bits(world, box_scene):
    def drop():
        world.reset()
        body = world.add_object(box_scene.model, (0, 0, 0.3), (0.3, 0.4, 0.5, 0.7))
        world.run(0.7)
        return world.pose_of(body)

    assert drop() == drop()


def test_settle_reports_a_body_that_keeps_moving(world, box_scene):
    world.reset()
    body = world.add_object(box_scene.model, (0, 0, 50.0), (0, 0, 0, 1))
    assert not world.settle(body, timeout=1.0)
    assert world.steps == 1000


def test_body_frame_is_the_centre(world, model):
    corners = np.array([(x, y, z) for x in (0, 2) for y in (0, 4) for z in (0, 6)], dtype=float)
    item = model("brick", [corners], scale=0.01)
    assert item.centre == pytest.approx((0.01, 0.02, 0.03))
    assert item.mass == item.longest_side == pytest.approx(0.06)
    world.reset()
    body = world.add_object(item, (0.5, 0, 1), (0, 0, 0, 1))
    low, high = np.array(world.client.getAABB(body))
    np.testing.assert_allclose((low + high) / 2, (0.5, 0, 1), atol=1e-3)
    assert world.client.getDynamicsInfo(body, -1)[0] == pytest.approx(0.06)


def test_a_mesh_that_pybullet_cannot_load_is_named(world, tmp_path):
    world.reset()
    ghost = ObjectModel("ghost", "ghost", tmp_path / "ghost.obj", 1.0, (0, 0, 0), 0.1)
    with pytest.raises(SimulationError, match=r"ghost\.obj"):
        world.add_object(ghost, (0, 0, 1), (0, 0, 0, 1))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux names its display in the environment")
def test_a_window_without_display_is_refused(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(SimulationError, match="DISPLAY"):
        World(gui=True)


def test_bin_holds_what_falls_in(world, box_scene):
    world.reset()
    world.add_bin(Bin())
    inside = world.add_object(box_scene.model, (1.2, 1.7, 0.5), (0, 0, 0, 1))
    world.settle(inside)
    position = world.pose_of(inside)[0]
    assert Bin().contains(position)
    assert position[2] == pytest.approx(0.02 + 0.04, abs=2e-3)  # on the bin's floor, not through it


@pytest.mark.parametrize(
    ("point", "inside"),
    [((1.5, 1.5, 0.05), True), ((1.97, 1.5, 0.05), True), ((1.99, 1.5, 0.05), False), ((1.5, 1.5, 0.25), False)],
)
def test_bin_contains(point, inside):
    assert Bin().contains(point) is inside


def test_horizontal_distance_ignores_height():
    assert Bin().horizontal_distance((1.5 + 0.3, 1.5 + 0.4, 7)) == pytest.approx(0.5)


def test_the_papers_world():
    assert (GRAVITY, TIME_STEP) == (-10.0, 1e-3)
    assert (Bin().centre[:2], Bin().side) == ((1.5, 1.5), 1.0)
