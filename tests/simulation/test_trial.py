"""Physics sanity: grasps chosen by hand do what a person expects."""

from dataclasses import replace

import numpy as np
import pytest

from ggcnn_net2net.grasping import RSS_2018, Grasp
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.simulation import PAPER_GRIPPER, GripperSpec, trial
from ggcnn_net2net.simulation.camera import Camera
from ggcnn_net2net.simulation.convex import box, cylinder
from ggcnn_net2net.simulation.gripper import Gripper
from ggcnn_net2net.simulation.procedural import PROCEDURAL40
from ggcnn_net2net.simulation.trial import (
    SUCCESS_DISTANCE,
    Outcome,
    WorldGrasp,
    _failure,
    _Follower,
    decoding_of,
    lifts,
    run_trial,
    run_world_grasp,
    world_grasp,
)
from ggcnn_net2net.simulation.world import Bin, World

both_protocols = pytest.mark.parametrize("protocol", [PAPER, CORRECTED], ids=lambda protocol: protocol.name)


def centred_grasp(scene, angle, opening_px):
    row, col, _ = scene.camera.pixel_from_world(scene.position)
    return Grasp(round(row), round(col), angle, opening_px)


@both_protocols
def test_box_across_its_short_side(world, box_scene, protocol):
    result = run_trial(world, box_scene, centred_grasp(box_scene, 0.0, 30), protocol)
    assert result.outcome is Outcome.SUCCESS
    assert result.in_bin
    assert result.distance < 0.3


def test_lifting_is_half_of_a_trial(world, box_scene):
    good, beside = (WorldGrasp((x, 0.0, box_scene.position[2]), 0.0, 0.12) for x in (0.0, 0.25))
    for target, expected in ((good, True), (beside, False)):
        assert lifts(world, box_scene, target) is expected
        steps = world.steps
        whole = run_world_grasp(world, box_scene, target)
        assert whole.success is expected
        assert steps < (0.7 if expected else 1.1) * whole.steps  # both end where the object is left behind


@both_protocols
def test_standing_cylinder(world, at_rest, protocol):
    scene = at_rest("cylinder", [cylinder(0.03, 0.1)])
    result = run_trial(world, scene, centred_grasp(scene, 0.8, 35), protocol)
    assert result.outcome is Outcome.SUCCESS
    assert result.in_bin


@both_protocols
def test_mug_by_its_handle(world, at_rest, protocol):
    parts = next(item for item in PROCEDURAL40 if item.name == "mug").build()
    scene = at_rest("mug", parts)
    vertices = np.concatenate(parts)
    reach = vertices[:, 0].max()  # the handle sticks out along +x
    x = reach - 0.015 - scene.model.centre[0] + scene.position[0]
    row, col, _ = scene.camera.pixel_from_world((x, 0, 0.08))
    seen = scene.camera.world_from_pixel(row, col, scene.depth[round(row), round(col)])
    grasp = WorldGrasp((x, 0.0, float(seen[2])), np.pi / 2, 0.05)
    result = run_world_grasp(world, scene, grasp, protocol)
    assert result.outcome is Outcome.SUCCESS
    assert result.in_bin


@both_protocols
def test_beside_the_object(world, box_scene, protocol):
    grasp = WorldGrasp((0.25, 0.0, 0.0), 0.0, 0.1)
    result = run_world_grasp(world, box_scene, grasp, protocol)
    assert result.outcome is Outcome.MISSED
    assert not result.success
    assert result.distance == pytest.approx(np.hypot(1.5, 1.5), abs=0.05)


@both_protocols
@pytest.mark.parametrize(
    ("x", "drops", "outcome"),
    [(0.25, False, Outcome.MISSED), (0.05, False, Outcome.MISSED), (0.0, True, Outcome.SLIPPED)],
    ids=["beside it", "a finger on it", "it falls"],
)
def test_losing_an_object_ends_a_trial(world, box_scene, monkeypatch, protocol, x, drops, outcome):
    """Going on to the bin without it changes nothing but the time."""
    body, grasp = 1, WorldGrasp((x, 0.0, 0.08), 0.0, 0.1)

    def run():
        phases, fallen = [], []

        def drop():
            if drops and not fallen and phases[-1:] == ["carry"] and world.pose_of(body)[0][2] > 0.3:
                fallen.append(True)
                world.client.resetBasePositionAndOrientation(body, box_scene.position, box_scene.orientation)
                world.client.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0))

        world.on_step = drop
        result = run_world_grasp(world, box_scene, grasp, protocol, on_phase=phases.append)
        world.on_step = None
        return result, phases

    early, phases = run()
    assert phases == ["approach", "close", "carry", "end"]
    monkeypatch.setattr(trial, "_CLEAR", np.inf)
    late, phases = run()
    assert phases == ["approach", "close", "carry", "release", "end"]
    assert early.outcome is late.outcome is outcome
    assert (early.success, early.in_bin) == (late.success, late.in_bin) == (False, False)
    assert early.distance == pytest.approx(late.distance, abs=1e-3)
    assert late.steps - early.steps > 2000


@pytest.mark.parametrize(
    ("fingertips", "speed", "turn", "left"),
    [
        (0.1, (0, 0, 0), (0, 0, 0), True),
        (0.1, (2, 0, 0), (0, 0, 0), False),
        (0.1, (0, 0, 0), (0, 0, 10), False),
        (0.086, (0, 0, 0), (0, 0, 0), False),
        (0.05, (0, 0, 0), (0, 0, 0), False),
    ],
    ids=["still, below the fingers", "slides", "turns", "too near", "between the fingers"],
)
def test_when_an_object_is_left_behind(world, box_scene, fingertips, speed, turn, left):
    """The box is 0.08 m high."""
    world.reset()
    body = world.add_object(box_scene.model, box_scene.position, box_scene.orientation)
    gripper = Gripper(world)
    gripper.move_to([0.0, 0.0, fingertips + gripper.spec.reach, 0, 0, 0], tolerance=1e-3)
    world.run(0.1 - world.steps % 100 * 1e-3)
    world.client.resetBaseVelocity(body, speed, turn)
    follower = _Follower(world, body, gripper)
    for _ in range(201):
        world.step()
        follower.follow()
    assert follower.left_behind is left


def test_opening_smaller_than_the_object(world, box_scene):
    """The fingers land on top of the box instead of beside it."""
    grasp = WorldGrasp((0.0, 0.0, 0.08), np.pi / 2, 0.05)
    assert run_world_grasp(world, box_scene, grasp).outcome is Outcome.MISSED


def test_holds_a_heavy_box_through_the_transfer(world, at_rest):
    """0.3 kg: a box with a longest side of 0.3 m."""
    scene = at_rest("bar", [box((0.3, 0.05, 0.08))])
    assert scene.model.mass == pytest.approx(0.3)
    heights = []
    result = run_world_grasp(
        world,
        scene,
        WorldGrasp((0.0, 0.0, 0.08), np.pi / 2, 0.1),
        on_phase=lambda phase: heights.append((phase, world.pose_of(1)[0][2])),
    )
    assert result.outcome is Outcome.SUCCESS
    assert dict(heights)["release"] > 0.6  # it hung at carrying height until it was released


@both_protocols
def test_a_small_gripper(world, box_scene, protocol):
    """It holds the box across its 6 cm; along its 12 cm it opens as far as it can, which is not enough."""
    small = GripperSpec(palm=(0.1, 0.02, 0.01), finger_length=0.04, max_opening=0.08)
    wide = centred_grasp(box_scene, 0.0, 45)
    result = run_trial(world, box_scene, wide, protocol, small)
    assert (result.outcome, result.in_bin) == (Outcome.SUCCESS, True)
    assert result.grasp.opening > small.max_opening  # what was asked for is on record
    along = replace(wide, angle=np.pi / 2)
    assert run_trial(world, box_scene, along, protocol).outcome is Outcome.SUCCESS
    assert run_trial(world, box_scene, along, protocol, small).outcome is Outcome.MISSED


def test_outcomes_without_a_trial(world, box_scene):
    assert run_trial(world, box_scene, None).outcome is Outcome.NO_GRASP
    unstable = replace(box_scene, stable=False)
    result = run_trial(world, unstable, centred_grasp(box_scene, 0, 30))
    assert (result.outcome, result.success, result.steps) == (Outcome.UNSTABLE, False, 0)


def test_repeats_bit_for_bit(world, box_scene):
    grasp = centred_grasp(box_scene, 0.3, 33)
    assert run_trial(world, box_scene, grasp) == run_trial(world, box_scene, grasp)


def test_clearance_keeps_the_fingers_off_the_plane(world, at_rest):
    scene = at_rest("slab", [box((0.05, 0.05, 0.02))])
    grasp = centred_grasp(scene, 0, 30)
    lowest = {}

    def watch(protocol):
        fingertip = []
        world.on_step = lambda: fingertip.append(world.client.getAABB(2 + 5, 6)[0][2] if world.steps > 10 else 1)
        run_trial(world, scene, grasp, protocol)
        world.on_step = None
        lowest[protocol.name] = min(fingertip)

    watch(PAPER)
    watch(CORRECTED)
    assert lowest["CORRECTED"] > 0
    assert lowest["PAPER"] < lowest["CORRECTED"]


@pytest.mark.parametrize("angle", [-1.0, 0.0, 0.6])
def test_world_grasp_keeps_place_angle_and_opening(angle):
    camera = Camera(target=(0.0, 0.0, 0.0))
    depth = np.full((300, 300), 1.4)
    found = world_grasp(Grasp(100, 180, angle, 50), depth, camera)
    assert camera.pixel_from_world(found.point) == pytest.approx((100, 180, 1.4))
    assert found.yaw == angle
    assert found.opening == pytest.approx(50 * 1.4 / camera.focal_px)


def test_success_distance_is_the_published_one():
    assert SUCCESS_DISTANCE == 0.7


@pytest.mark.parametrize(
    ("protocol", "clearance"),
    [(PAPER, 0.0), (CORRECTED, 0.005), (replace(PAPER, palm_clearance=0.03), 0.03)],
    ids=["PAPER", "CORRECTED", "raised"],
)
def test_the_protocol_reaches_the_simulation(world, box_scene, monkeypatch, protocol, clearance):
    """The box is taller than the fingers are long, so the palm's clearance decides how deep the gripper goes."""
    iterations, coupled, moves = [], [], []
    reset, init, move_to = World.reset, Gripper.__init__, Gripper.move_to
    monkeypatch.setattr(World, "reset", lambda self, *given: iterations.append(given) or reset(self, *given))
    monkeypatch.setattr(Gripper, "__init__", lambda *given: coupled.append(given[3]) or init(*given))
    monkeypatch.setattr(Gripper, "move_to", lambda *given, **how: moves.append(given[1]) or move_to(*given, **how))
    top = 0.08
    run_world_grasp(world, box_scene, WorldGrasp((0.0, 0.0, top), 0.0, 0.12), protocol)
    assert (iterations, coupled) == ([(protocol.solver_iterations,)], [protocol.coupled_jaws])
    above, down, _ = moves
    assert down[2] == pytest.approx(top + PAPER_GRIPPER.palm[2] / 2 + clearance)
    assert above[2] == pytest.approx(down[2] + 0.5)


def test_the_phases_last_as_long_as_the_papers(world, box_scene):
    begun = {}
    grasp = WorldGrasp((0.0, 0.0, 0.08), 0.0, 0.12)
    run_world_grasp(world, box_scene, grasp, on_phase=lambda phase: begun.update({phase: world.steps}))
    assert begun["carry"] - begun["close"] == 600  # the jaws, 0.6 s
    assert begun["end"] - begun["release"] == 1600  # the jaws, and 1 s


def test_the_object_and_not_the_palm_hangs_over_the_bins_centre(world, at_rest, monkeypatch):
    scene = at_rest("bar", [box((0.3, 0.05, 0.08))])
    moves = []
    move_to = Gripper.move_to
    monkeypatch.setattr(Gripper, "move_to", lambda *given, **how: moves.append(given[1]) or move_to(*given, **how))
    run_world_grasp(world, scene, WorldGrasp((0.1, 0.0, 0.08), np.pi / 2, 0.1))
    carry = moves[-1]
    assert carry[0] - Bin().centre[0] == pytest.approx(0.1, abs=0.02)
    assert carry[1] - Bin().centre[1] == pytest.approx(0.0, abs=0.02)
    assert carry[2] - Bin().centre[2] == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("metres", "success", "in_bin"), [(0.1, True, True), (0.65, True, False), (0.75, False, False)]
)
def test_an_object_beside_the_bin_may_count(world, box_scene, monkeypatch, metres, success, in_bin):
    phases = []
    pose_of = World.pose_of

    def placed(self, body):
        position, orientation = pose_of(self, body)
        if phases[-1:] == ["end"]:
            position = (Bin().centre[0] + metres, Bin().centre[1], 0.05)
        return position, orientation

    monkeypatch.setattr(World, "pose_of", placed)
    grasp = WorldGrasp((0.0, 0.0, 0.08), 0.0, 0.12)
    result = run_world_grasp(world, box_scene, grasp, on_phase=phases.append)
    assert (result.success, result.in_bin) == (success, in_bin)
    assert result.distance == pytest.approx(metres)
    assert result.outcome is (Outcome.SUCCESS if success else Outcome.DROPPED_OUTSIDE)


@pytest.mark.parametrize(
    ("position", "held", "lift", "outcome"),
    [
        ((0.0, 0.0, 0.0), False, 0.01, Outcome.MISSED),
        ((0.5, 0.0, 0.0), False, 0.2, Outcome.SLIPPED),
        ((2.5, 0.0, 0.0), True, 0.7, Outcome.DROPPED_OUTSIDE),
        ((0.0, -11.0, 0.0), True, 0.7, Outcome.UNSTABLE),
        ((float("nan"), 0.0, 0.0), False, 0.0, Outcome.UNSTABLE),
    ],
)
def test_reasons_of_failures(position, held, lift, outcome):
    assert _failure(position, held, lift) is outcome


def test_the_benchmark_takes_the_protocols_angle():
    assert decoding_of(PAPER) == replace(RSS_2018, angle_window=5)  # the published 11x11 window
    assert decoding_of(CORRECTED) == RSS_2018
