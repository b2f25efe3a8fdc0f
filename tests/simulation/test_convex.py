from pathlib import Path

import numpy as np
import pybullet
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pybullet_utils.bullet_client import BulletClient
from scipy.spatial import ConvexHull

from ggcnn_net2net.errors import ObjectSetError
from ggcnn_net2net.simulation.convex import (
    arc,
    box,
    chain,
    circle,
    cylinder,
    disc,
    ellipsoid,
    frustum,
    hull,
    lathe,
    level,
    obj_text,
    prism,
    rectangle,
    rod,
    rotate,
    scale,
    shell,
    sweep,
    translate,
    tube,
    write_obj,
)
from ggcnn_net2net.simulation.meshes import read_parts

lengths = st.floats(0.01, 0.3)
angles = st.floats(-360, 360)
coordinates = st.floats(-1, 1)
points = st.tuples(coordinates, coordinates, coordinates)
sides = st.integers(3, 24)
axes = st.sampled_from(["x", "y", "z"])


def volume(part):
    return ConvexHull(part).volume


def polygon_area(radius, corners):
    return corners / 2 * np.sin(2 * np.pi / corners) * radius**2


@given(st.tuples(lengths, lengths, lengths), points)
def test_box_has_its_size_and_centre(size, at):
    part = box(size, at)
    assert volume(part) == pytest.approx(np.prod(size))
    np.testing.assert_allclose(np.ptp(part, axis=0), size)
    np.testing.assert_allclose(part.mean(axis=0), at, atol=1e-12)


@given(lengths, lengths, lengths, st.floats(0, 0.49))
def test_prism_of_a_rectangle_loses_its_cut_corners(width, depth, height, cut):
    corner = cut * min(width, depth)
    part = prism(rectangle(width, depth, corner), height)
    assert volume(part) == pytest.approx((width * depth - 2 * corner**2) * height)
    np.testing.assert_allclose(np.ptp(part, axis=0), (width, depth, height))
    assert part[:, 2].min() == 0


@given(lengths, lengths, lengths, sides, points)
def test_frustum_follows_the_formula(bottom, top, height, segments, at):
    part = frustum(bottom, top, height, at, segments)
    expected = polygon_area(1, segments) * height / 3 * (bottom**2 + bottom * top + top**2)
    assert volume(part) == pytest.approx(expected)
    np.testing.assert_allclose(part[:, 2].min(), at[2])
    np.testing.assert_allclose(part[:, 0].max(), at[0] + max(bottom, top))


@given(lengths, lengths, sides)
def test_cylinder_and_cone(radius, height, segments):
    base = polygon_area(radius, segments) * height
    assert volume(cylinder(radius, height, segments=segments)) == pytest.approx(base)
    cone = frustum(radius, 0, height, segments=segments)
    assert len(cone) == segments + 1
    assert volume(cone) == pytest.approx(base / 3)


@given(st.tuples(lengths, lengths, lengths), points, st.floats(2, 6))
def test_ellipsoid_lies_on_its_surface_and_fills_its_box(radii, at, exponent):
    part = ellipsoid(radii, at, exponent)
    surface = (np.abs((part - at) / radii) ** exponent).sum(axis=1)
    np.testing.assert_allclose(surface, 1)
    np.testing.assert_allclose(np.ptp(part, axis=0), 2 * np.array(radii))
    assert len(ConvexHull(part).vertices) <= 64


@given(st.tuples(lengths, lengths, lengths))
def test_ellipsoid_approaches_the_volume_of_the_smooth_one(radii):
    smooth = 4 / 3 * np.pi * np.prod(radii)
    assert 0.8 * smooth < volume(ellipsoid(radii)) < smooth
    assert volume(ellipsoid(radii, segments=48, rings=31)) == pytest.approx(smooth, rel=0.02)
    assert volume(ellipsoid(radii, exponent=8)) > smooth


@given(points, points, st.floats(0.01, 0.1), st.floats(0.01, 0.1), sides)
def test_rod_is_a_frustum_between_its_ends(start, end, radius, end_radius, segments):
    length = np.linalg.norm(np.subtract(end, start))
    if length < 0.01:
        return
    part = rod(start, end, radius, end_radius, segments)
    assert volume(part) == pytest.approx(volume(frustum(radius, end_radius, length, segments=segments)))
    np.testing.assert_allclose(part[:segments].mean(axis=0), start, atol=1e-9)
    np.testing.assert_allclose(part[segments:].mean(axis=0), end, atol=1e-9)


@given(st.lists(st.tuples(lengths, lengths), min_size=2, max_size=6), sides)
def test_lathe_stacks_frustums(steps, segments):
    heights = np.cumsum([step for step, _ in steps])
    profile = [(radius, z) for z, (_, radius) in zip(heights, steps, strict=True)]
    parts = lathe(profile, segments)
    assert len(parts) == len(profile) - 1
    for part, (low, bottom), (high, top) in zip(parts, profile, profile[1:], strict=False):
        expected = frustum(low, high, top - bottom, (0, 0, bottom), segments)
        assert volume(part) == pytest.approx(volume(expected))
        np.testing.assert_allclose(np.ptp(part, axis=0), np.ptp(expected, axis=0))


@given(lengths, st.floats(0.1, 0.9), lengths, sides)
def test_straight_tube_is_a_difference_of_cylinders(radius, share, height, segments):
    inner = radius * share
    parts = tube([(radius, 0), (radius, height)], radius - inner, segments)
    total = sum(volume(part) for part in parts)
    assert len(parts) == segments
    assert total == pytest.approx((polygon_area(radius, segments) - polygon_area(inner, segments)) * height)


def test_wall_of_a_flared_tube_has_its_thickness_at_every_corner():
    segments = 16
    for part in tube([(0.05, 0), (0.08, 0.03), (0.09, 0.10)], wall=0.005, segments=segments):
        outer, inner = part[::2], part[1::2]
        normal = np.cross(outer[1] - outer[0], outer[2] - outer[0])
        distances = (inner - outer[0]) @ normal / np.linalg.norm(normal)
        np.testing.assert_allclose(np.abs(distances), 0.005 * np.cos(np.pi / segments), rtol=0.01)


@given(lengths, lengths, st.floats(0.1, 0.5))
def test_floor_of_a_tube_closes_it_from_below(bottom, top, share):
    *walls, floor = tube([(bottom, 0.02), (top, 0.12)], wall=0.005, floor=0.1 * share)
    assert len(walls) == 12
    np.testing.assert_allclose(floor[:, 2].min(), 0.02)
    np.testing.assert_allclose(floor[:, 2].max(), 0.02 + 0.1 * share)
    widest = np.hypot(floor[:, 0], floor[:, 1]).max()
    assert widest == pytest.approx(max(bottom, bottom + share * (top - bottom)))


@given(lengths, angles, st.floats(30, 300), st.integers(3, 12))
def test_arc_stays_at_its_radius_and_ends_where_it_should(radius, start, span, segments):
    thickness = radius / 4
    parts = arc(radius, thickness, start, start + span, segments=segments)
    assert len(parts) == segments
    vertices = np.concatenate(parts)
    distances = np.hypot(vertices[:, 0], vertices[:, 1])
    assert np.all(distances < radius + thickness / 2 + 1e-9)
    assert np.all(distances > radius - thickness / 2 - 1e-9)
    ends = [parts[0][:6].mean(axis=0), parts[-1][6:].mean(axis=0)]
    for end, degrees in zip(ends, (start, start + span), strict=True):
        direction = (np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0)
        np.testing.assert_allclose(end, np.multiply(radius, direction), atol=1e-9)


def test_sweep_turns_half_at_each_corner():
    first, second = sweep([(0, 0, 0), (1, 0, 0), (1, 1, 0)], (0.1, 0.2, 0.1), 8)
    joint = first[8:]
    np.testing.assert_array_equal(joint, second[:8])
    np.testing.assert_allclose(joint.mean(axis=0), (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose((joint - (1, 0, 0)) @ (1, 1, 0), 0, atol=1e-12)


def test_shell_goes_once_around():
    outer = [level(rectangle(4, 2), z) for z in (0, 3)]
    inner = [level(rectangle(2, 1), z) for z in (0, 3)]
    parts = shell(outer, inner)
    assert len(parts) == 4
    assert sum(volume(part) for part in parts) == pytest.approx((8 - 2) * 3)


def test_chain_and_hull_span_their_sections():
    sections = [disc(1, (0, 0, z)) for z in (0, 1, 3)]
    low, high = chain(sections)
    assert volume(high) == pytest.approx(2 * volume(low))
    assert volume(hull(*sections)) == pytest.approx(volume(low) + volume(high))


@given(axes, angles, points, st.tuples(lengths, lengths, lengths))
def test_transforms_keep_or_multiply_volumes(axis, degrees, offset, factors):
    part = frustum(0.2, 0.1, 0.3, (0.1, 0.2, 0.3))
    assert volume(translate(rotate(part, axis, degrees), offset)) == pytest.approx(volume(part))
    assert volume(scale(part, factors)) == pytest.approx(volume(part) * np.prod(factors))
    np.testing.assert_allclose(rotate(rotate(part, axis, degrees), axis, -degrees), part, atol=1e-12)


def test_transforms_of_a_list_are_those_of_its_parts():
    parts = [box((1, 2, 3)), cylinder(1, 2)]
    for transform, value in ((translate, (1, 2, 3)), (scale, (2, -1, 1))):
        for result, part in zip(transform(parts, value), parts, strict=True):
            np.testing.assert_array_equal(result, transform(part, value))
    np.testing.assert_array_equal(rotate(parts, "x", 30)[1], rotate(parts[1], "x", 30))


@pytest.mark.parametrize(("axis", "before", "after"), [("x", 1, 2), ("y", 2, 0), ("z", 0, 1)])
def test_rotation_is_counter_clockwise(axis, before, after):
    np.testing.assert_allclose(rotate(np.eye(3)[[before]], axis, 90), np.eye(3)[[after]], atol=1e-12)


@given(st.tuples(lengths, lengths, lengths), axes, angles)
def test_triangles_of_the_file_point_outwards(radii, axis, degrees):
    part = rotate(ellipsoid(radii), axis, degrees)
    lines = [line.split() for line in obj_text([part]).splitlines()]
    vertices = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float)
    triangles = np.array([line[1:] for line in lines if line[0] == "f"], dtype=int) - 1
    # Signed tetrahedra between the origin, which is inside, and each triangle.
    signed = np.linalg.det(vertices[triangles]) / 6
    assert np.all(signed > -1e-12)
    assert signed.sum() == pytest.approx(volume(vertices), rel=1e-6)


def test_file_holds_one_group_a_part_and_no_inner_points(tmp_path):
    parts = [box((0.1, 0.2, 0.3)), hull(cylinder(0.1, 0.2, (1, 0, 0)), np.array([(1.0, 0.0, 0.1)]))]
    path = tmp_path / "two.obj"
    write_obj(path, parts)
    first, second = read_parts(path)
    np.testing.assert_allclose(first, parts[0], atol=5e-7)
    np.testing.assert_allclose(second, parts[1][:-1], atol=5e-7)
    text = path.read_text()
    assert text.count("\no ") + text.startswith("o ") == 2
    assert "-0.000000" not in text
    assert text == obj_text(parts)


def test_noise_in_the_last_digit_does_not_change_the_file():
    part = tube([(0.1, 0), (0.12, 0.1)], 0.01, floor=0.01)
    noisy = [points + np.random.default_rng(0).uniform(-1e-12, 1e-12, points.shape) for points in part]
    assert obj_text(part) == obj_text(noisy)
    # A rod along an axis can take its cross section from either of the two others.
    assert obj_text([rod((0, 0, 0), (0, 0, 1), 0.1)]) == obj_text([rod((0, 0, 0), (1e-13, 0, 1), 0.1)])


@pytest.mark.parametrize(
    "flat", [level(circle(1.0)), np.zeros((8, 3)), box((1, 1, 1))[:3], box((1, 1, 1e-8)), np.full((4, 3), np.nan)]
)
def test_part_without_volume_is_refused(flat):
    with pytest.raises(ObjectSetError, match="part 1"):
        obj_text([box((1, 1, 1)), flat])


def test_pybullet_collides_with_each_part_and_not_with_the_gap_between(tmp_path: Path):
    path = tmp_path / "gate.obj"
    write_obj(path, [box((0.02, 0.1, 0.2), (x, 0, 0.1)) for x in (-0.1, 0.1)])
    client = BulletClient(pybullet.DIRECT)
    shape = client.createCollisionShape(pybullet.GEOM_MESH, fileName=str(path))
    client.createMultiBody(0, shape)
    hits = client.rayTestBatch([(x, 0, 1) for x in (-0.1, 0, 0.1)], [(x, 0, -1) for x in (-0.1, 0, 0.1)])
    client.disconnect()
    assert [hit[0] for hit in hits] == [0, -1, 0]
    assert hits[0][3][2] == pytest.approx(0.2, abs=2e-3)
