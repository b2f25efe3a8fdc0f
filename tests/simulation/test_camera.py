import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.simulation.camera import Camera
from ggcnn_net2net.simulation.convex import box

targets = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(0, 0.3))


@given(targets, st.floats(0, 299), st.floats(0, 299), st.floats(0.5, 2))
def test_pixel_to_world_and_back(target, row, col, depth):
    camera = Camera(target=target)
    back = camera.pixel_from_world(camera.world_from_pixel(row, col, depth))
    np.testing.assert_allclose(back, (row, col, depth), atol=1e-3)


def test_depth_of_the_plane_is_the_camera_height(world):
    world.reset()
    depth, rgb = Camera(target=(0, 0, 0)).render(world.client)
    assert depth.shape == (300, 300)
    assert depth.dtype == np.float32
    assert rgb.shape == (300, 300, 3)
    np.testing.assert_allclose(depth, 1.5, atol=1e-3)


def test_geometry_agrees_with_the_renderer(world, model):
    """Boxes of known size are seen where the camera model puts them, to a tenth of a pixel on average."""
    rng = np.random.default_rng(0)
    camera = Camera(target=(0, 0, 0))
    shifts = []
    for index in range(40):
        x, y = rng.uniform(-0.15, 0.15, 2)
        width, length = rng.uniform(0.06, 0.4, 2)
        world.reset()
        world.add_object(model(f"box_{index}", [box((width, length, 0.1))]), (x, y, 0.05), (0, 0, 0, 1))
        depth, _ = camera.render(world.client)
        rows, cols = np.nonzero(np.abs(depth - 1.4) < 0.01)
        top, left, _ = camera.pixel_from_world((x - width / 2, y + length / 2, 0.1))
        bottom, right, _ = camera.pixel_from_world((x + width / 2, y - length / 2, 0.1))
        first, last = (
            np.array([rows.min() - top, cols.min() - left]),
            np.array([bottom - rows.max(), right - cols.max()]),
        )
        assert (first > -0.3).all()
        assert (first < 1.1).all()
        assert (last > -0.3).all()
        assert (last < 1.1).all()
        shifts.append((first - last) / 2)
    np.testing.assert_allclose(np.mean(shifts, axis=0), 0, atol=0.1)


def test_image_axes(world):
    """Up in the image is +y, right is +x."""
    camera = Camera(target=(0, 0, 0))
    row, col, depth = camera.pixel_from_world((0.1, 0.2, 0))
    assert col > 150
    assert row < 149
    assert depth == pytest.approx(1.5)
    assert camera.pixel_from_world((0, 0, 0))[:2] == pytest.approx((149, 150))
