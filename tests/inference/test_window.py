from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.inference.presets import KINOVA, MVP, PAPER_SIMULATOR, PRESETS, RSS_2018_PRESET, Preset
from ggcnn_net2net.inference.window import Window, crop_window, network_input, padded

SIDES = st.integers(1, 90)


@given(SIDES, SIDES, st.integers(1, 120), st.integers(-60, 60), st.integers(1, 60))
def test_the_crop_is_a_square_within_the_image(height, width, crop, up, side):
    window = crop_window((height, width), Preset("mine", crop=crop, crop_up=up), side)
    assert window.height == window.width == min(crop, height, width)
    assert 0 <= window.top <= height - window.height
    assert window.left == (width - window.width) // 2
    assert window.network_shape == (side, side)


@pytest.mark.parametrize(
    ("preset", "top", "left", "side"),
    [(RSS_2018_PRESET, 90, 170, 300), (KINOVA, 40, 120, 400), (MVP, 50, 170, 300), (PAPER_SIMULATOR, 0, 80, 480)],
)
def test_crops_of_the_public_nodes(preset, top, left, side):
    window = crop_window((480, 640), preset, 300)
    assert (window.top, window.left, window.height, window.scale) == (top, left, side, side / 300)


@settings(deadline=None, max_examples=50)
@given(st.integers(60, 200), st.integers(60, 200), st.integers(40, 220), st.integers(30, 90), st.data())
def test_a_place_that_the_network_sees_is_found_in_the_image(height, width, crop, side, data):
    """A ramp through crop and resize: its values at a network pixel tell the image pixel that it comes from."""
    rows, cols = np.mgrid[:height, :width].astype(np.float32)
    window = crop_window((height, width), Preset("mine", crop=crop), side)
    seen = [cv2.resize(window.cut(ramp), window.network_shape, interpolation=cv2.INTER_LINEAR) for ramp in (rows, cols)]
    inner = st.integers(2, side - 3)  # OpenCV keeps a constant value beyond the outermost pixel centres
    row, col = data.draw(inner), data.draw(inner)
    grasp = window.to_image(Grasp(row, col, 0.4, 20.0, 0.5))
    assert grasp.row == pytest.approx(seen[0][row, col], abs=0.02)
    assert grasp.col == pytest.approx(seen[1][row, col], abs=0.02)
    assert (grasp.width_px, grasp.angle, grasp.quality) == (pytest.approx(20 * window.height / side), 0.4, 0.5)


def test_the_whole_image_is_a_window_that_changes_nothing():
    grasp = Grasp(3.0, 4.0, 0.1, 20.0)
    window = Window(0, 0, 7, 9)
    assert window.to_image(grasp) == grasp
    assert window.network_shape == (7, 9)


@settings(deadline=None, max_examples=60)
@given(st.sampled_from(list(PRESETS.values())), SIDES, SIDES, st.integers(0, 2**32 - 1), st.floats(0, 0.9))
def test_inputs_are_finite_centred_and_clipped(preset, height, width, seed, missing):
    random = np.random.default_rng(seed)
    metres = random.uniform(0.3, 3, (height, width)).astype(np.float32)
    metres[random.random((height, width)) < missing] = np.nan
    window = crop_window(metres.shape, preset, 36)
    try:
        image, gone = network_input(metres, window, preset)
    except DepthImageError:
        assert np.isnan(window.cut(metres)).any()
        return
    assert image.shape == gone.shape == (36, 36)
    assert image.dtype == np.float32
    assert np.isfinite(image).all()
    if preset.clip is None:
        assert abs(image.mean()) < 1e-5
    else:
        assert np.abs(image).max() <= preset.clip


@pytest.mark.parametrize("preset", PRESETS.values(), ids=PRESETS)
def test_the_mean_is_that_of_the_crop_before_the_clip(preset):
    metres = np.full((36, 36), 1.0, np.float32)
    metres[:9] = 5.0
    image, _ = network_input(metres, crop_window(metres.shape, preset, 36), preset)
    expected = metres - metres.mean()
    if preset.clip is not None:
        expected = np.clip(expected, -preset.clip, preset.clip)
    np.testing.assert_allclose(image, expected, atol=1e-5)


def test_all_missing_in_the_crop_is_an_error():
    metres = np.ones((60, 60), np.float32)
    metres[20:40, 20:40] = np.nan
    preset = replace(RSS_2018_PRESET, crop=20)
    with pytest.raises(DepthImageError, match="rows 20 to 39"):
        network_input(metres, crop_window(metres.shape, preset, 20), preset)


def test_holes_are_filled_from_around_them():
    metres = np.ones((60, 60), np.float32)
    metres[:, 30:] = 2
    holed = metres.copy()
    holed[10:14, 5:9] = holed[0, 0] = np.nan
    window = crop_window(metres.shape, RSS_2018_PRESET, 60)
    whole, none = network_input(metres, window, RSS_2018_PRESET)
    filled, missing = network_input(holed, window, RSS_2018_PRESET)
    np.testing.assert_allclose(filled, whole, atol=1e-5)
    assert not none.any()
    assert missing.sum() == 17


@given(SIDES, SIDES)
def test_padding_goes_on_with_the_border(height, width):
    image = np.random.default_rng(0).random((height, width), np.float32)
    larger = padded(image)
    assert larger.shape[0] % 12 == larger.shape[1] % 12 == 0
    assert larger.shape[0] - height < 12
    assert larger.shape[1] - width < 12
    np.testing.assert_array_equal(larger[:height, :width], image)
    assert larger[-1, -1] == image[-1, -1]


def test_input_of_mvp_is_that_of_its_service(data_root):
    """Its preprocessing as the node does it, on a real scene with holes."""
    depth = cv2.imread(str(data_root / "cornell" / "01" / "pcd0104d.tiff"), cv2.IMREAD_UNCHANGED)
    random = np.random.default_rng(3)
    depth[cv2.dilate((random.random(depth.shape) > 0.999).astype(np.uint8), np.ones((7, 7))) > 0] = np.nan
    crop = cv2.copyMakeBorder(depth[50:350, 170:470], 1, 1, 1, 1, cv2.BORDER_DEFAULT)
    mask = cv2.dilate(np.isnan(crop).astype(np.uint8), np.ones((3, 3), np.uint8), iterations=1)
    crop[mask == 1] = 0
    scale = np.abs(crop).max()
    crop = (cv2.inpaint(crop / scale, mask, 1, cv2.INPAINT_NS) * scale)[1:-1, 1:-1]
    expected = np.clip(crop - crop.mean(), -1, 1)
    image, missing = network_input(depth, crop_window(depth.shape, MVP, 300), MVP)
    assert missing.mean() > 0.02
    np.testing.assert_allclose(image, expected, atol=1e-5)
