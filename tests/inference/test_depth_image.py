import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.inference.depth_image import depth_at, to_metres

SHAPES = hnp.array_shapes(min_dims=2, max_dims=2, min_side=5, max_side=12)
SCENES = hnp.arrays(np.int32, SHAPES, elements=st.integers(100, 20_000))  # millimetres


@given(SCENES, st.sampled_from([np.uint16, np.int16, np.int32, np.int64, np.float32, np.float64]))
def test_millimetres_and_metres_mean_the_same(scene, dtype):
    from_mm, unit = to_metres(scene.astype(dtype))
    from_m, unit_of_metres = to_metres(scene.astype(np.float64) / 1000)
    assert (unit, unit_of_metres) == ("mm", "m")
    assert from_mm.dtype == from_m.dtype == np.float32
    np.testing.assert_allclose(from_mm, from_m, rtol=1e-6)
    np.testing.assert_array_equal(from_mm, to_metres(scene.astype(dtype), "mm")[0])


@given(SCENES, st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0]), st.integers(0, 24))
def test_missing_pixels_neither_count_nor_survive(scene, missing, place):
    depth = scene / 1000
    depth.flat[place] = missing
    metres, unit = to_metres(depth)
    assert unit == "m"
    assert np.isnan(metres.flat[place])
    assert np.isnan(metres).sum() == 1


@given(st.floats(1e-3, 1e6), st.sampled_from([np.float32, np.float64, np.int32]))
def test_the_rule_is_the_documented_one(value, dtype):
    depth = np.full((6, 6), value).astype(dtype)
    value = np.float32(depth[0, 0])  # the rule looks at float32
    is_metres = dtype is not np.int32 and np.float32(0.05) <= value <= 20
    is_millimetres = 100 <= value <= 20_000
    if is_metres or is_millimetres:
        assert to_metres(depth)[1] == ("m" if is_metres else "mm")
    else:
        with pytest.raises(DepthImageError, match=r"depth_unit|missing"):
            to_metres(depth)


def test_half_of_the_pixels_is_not_enough():
    depth = np.ones((6, 6))
    depth[:3] = 1000
    with pytest.raises(DepthImageError, match="depth_unit"):
        to_metres(depth)
    depth[2, 0] = 1
    assert to_metres(depth)[1] == "m"


def test_what_is_told_is_not_questioned():
    assert to_metres(np.full((6, 6), 30), "m")[0][0, 0] == 30
    assert to_metres(np.full((6, 6), 0.5), "mm")[0][0, 0] == np.float32(0.0005)
    with pytest.raises(DepthImageError, match="'cm'"):
        to_metres(np.ones((6, 6)), "cm")


@pytest.mark.parametrize(
    ("depth", "message"),
    [
        (np.ones(6), "shape"),
        (np.ones((0, 6)), "shape"),
        (np.ones((6, 6, 1)), "channels"),
        (np.ones((1, 6, 6, 1)), "shape"),
        (np.ones((6, 6), bool), "bool"),
        (np.ones((6, 6), complex), "complex"),
        ([["a", "b"]], "<U1"),
        (np.zeros((6, 6), np.uint16), "missing"),
        (np.full((6, 6), np.nan), "missing"),
        (np.full((6, 6), 128, np.uint8) // 2, "depth_unit"),
    ],
)
def test_what_is_no_depth_image_is_refused(depth, message):
    with pytest.raises(DepthImageError, match=message):
        to_metres(depth)


def test_the_image_of_the_caller_stays_as_it_is():
    for dtype in (np.float32, np.uint16):
        depth = np.full((6, 6), 700, dtype)
        depth[0, 0] = 0
        depth.flags.writeable = False
        assert to_metres(depth)[0][1, 1] == np.float32(0.7)
        assert depth[0, 0] == 0


def test_batches():
    assert to_metres(np.zeros((0, 6, 6)))[0].shape == (0, 6, 6)
    assert to_metres(np.full((2, 6, 6), 700))[0].shape == (2, 6, 6)


def test_depth_at_a_missing_pixel_is_that_of_the_nearest_measured_ones():
    metres = np.full((9, 9), np.nan, np.float32)
    metres[0, 4], metres[6, 4], metres[6, 6], metres[2, 2] = 9, 1, 2, 4
    assert depth_at(metres, 6.2, 3.8) == (1, True)
    assert depth_at(metres, 4, 4) == (2, False)  # the median of 1, 2 and 4 two pixels off
    assert depth_at(metres, -3, 12)[1] is False  # outside: the nearest pixel
    with pytest.raises(DepthImageError):
        depth_at(np.full((3, 3), np.nan, np.float32), 1, 1)
