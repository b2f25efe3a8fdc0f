from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from skimage.feature import peak_local_max

from ggcnn_net2net.errors import GraspError
from ggcnn_net2net.grasping import RSS_2018, Grasp, decode_maps, wrap_angle

SIDE = 120


def maps_of(grasps, blob=400.0):
    """Ideal network output: a blob of quality, and one angle and width everywhere around each grasp."""
    rows, cols = np.mgrid[:SIDE, :SIDE]
    quality, angle, width = (np.zeros((SIDE, SIDE)) for _ in range(3))
    for grasp in grasps:
        squared = (rows - grasp.row) ** 2 + (cols - grasp.col) ** 2
        quality = np.maximum(quality, grasp.quality * np.exp(-squared / blob))
        angle[squared < 400], width[squared < 400] = grasp.angle, grasp.width_px / 150
    return quality, np.cos(2 * angle), np.sin(2 * angle), width


@settings(max_examples=25, deadline=None)
@given(
    st.integers(25, SIDE - 26),
    st.integers(25, SIDE - 26),
    st.floats(-1.5, 1.5),
    st.floats(5, 140),
)
def test_an_ideal_output_decodes_to_its_grasp(row, col, angle, width_px):
    (grasp,) = decode_maps(*maps_of([Grasp(row, col, angle, width_px)]))
    assert (grasp.row, grasp.col) == (row, col)
    assert grasp.angle == pytest.approx(angle, abs=1e-9)
    assert grasp.width_px == pytest.approx(width_px, rel=1e-3)


def test_best_grasps_come_first_and_keep_their_distance():
    wanted = [Grasp(30, 30, 0.1, 40, 0.6), Grasp(30, 90, 0.2, 50, 0.9), Grasp(90, 60, 0.3, 60, 0.8)]
    found = decode_maps(*maps_of(wanted, blob=100), n_grasps=2)
    assert [(grasp.row, grasp.col) for grasp in found] == [(30, 90), (90, 60)]
    assert found[0].quality > found[1].quality


def test_nothing_above_the_threshold_is_no_grasp():
    quality, *rest = maps_of([Grasp(60, 60, 0, 40, 0.9)])
    assert decode_maps(quality * 0.15, *rest) == []


def test_smoothing_is_the_published_one():
    quality, cos, sin, width = maps_of([Grasp(60, 60, 0, 40)])
    noise = np.random.default_rng(0).normal(0, 0.05, (2, SIDE, SIDE))
    (grasp,) = decode_maps(quality + noise[0], cos, sin, width + noise[1])
    smooth = gaussian_filter(quality + noise[0], 5, mode="nearest")
    assert (grasp.row, grasp.col) == np.unravel_index(smooth.argmax(), smooth.shape)
    smooth_width = gaussian_filter(width + noise[1], 1, mode="nearest") * 150
    assert grasp.width_px == pytest.approx(smooth_width[int(grasp.row), int(grasp.col)])


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    peak=st.tuples(st.integers(0, 39), st.integers(0, 59)),
    width_sigma=st.sampled_from([0.0, 1.0, 2.0]),
    angle_sigma=st.sampled_from([0.0, 2.0]),
    border=st.sampled_from(["nearest", "reflect"]),
    angle_window=st.integers(0, 6),
)
def test_smoothing_around_a_peak_is_smoothing_the_whole_map(seed, peak, width_sigma, angle_sigma, border, angle_window):
    random = np.random.default_rng(seed)
    cos, sin, width = random.normal(size=(3, 40, 60))
    quality = np.zeros((40, 60))
    quality[peak] = 1
    decoding = replace(
        RSS_2018,
        quality_sigma=0.0,
        width_sigma=width_sigma,
        angle_sigma=angle_sigma,
        border=border,
        angle_window=angle_window,
        peaks_at_border=True,
    )
    (grasp,) = decode_maps(quality, cos, sin, width, decoding=decoding)

    def smooth(values, sigma):
        return gaussian_filter(values, sigma, mode=border) if sigma else values

    angle = smooth(np.arctan2(sin, cos) / 2, angle_sigma)
    row, col = peak
    window = angle[max(row - angle_window, 0) : row + angle_window + 1, max(col - angle_window, 0) :][
        :, : min(col, angle_window) + angle_window + 1
    ]
    expected = angle[peak] if angle_window == 0 else window.max() if angle[peak] > 0 else window.min()
    assert (grasp.row, grasp.col) == peak
    assert grasp.angle == wrap_angle(expected)
    assert grasp.width_px == max(smooth(width, width_sigma)[peak] * RSS_2018.width_scale, 0)


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    levels=st.integers(1, 60),
    threshold=st.sampled_from([0.0, 0.4, 0.9, 1.0]),
    min_distance=st.integers(1, 12),
    peaks_at_border=st.booleans(),
)
def test_the_best_grasp_is_where_scikit_image_finds_the_first_peak(
    seed, levels, threshold, min_distance, peaks_at_border
):
    """Also on plateaus and among equal maxima, of which few levels make many."""
    quality = np.random.default_rng(seed).integers(0, levels + 1, (20, 30)) / levels
    decoding = replace(
        RSS_2018,
        quality_sigma=0.0,
        threshold=threshold,
        min_distance=min_distance,
        peaks_at_border=peaks_at_border,
    )
    found = decode_maps(quality, np.ones((20, 30)), np.zeros((20, 30)), quality, decoding=decoding)
    expected = peak_local_max(
        quality,
        min_distance=min_distance,
        threshold_abs=threshold,
        num_peaks=1,
        exclude_border=not peaks_at_border,
    )
    assert [(grasp.row, grasp.col) for grasp in found] == [tuple(peak) for peak in expected]


@pytest.mark.parametrize(("sign", "expected"), [(1, 0.7), (-1, -0.7)])
def test_angle_window_takes_the_extreme(sign, expected):
    quality, _, _, width = maps_of([Grasp(60, 60, 0, 40)])
    angle = np.full((SIDE, SIDE), 0.2 * sign)
    angle[56, 63] = expected  # inside the 11x11 window
    angle[66, 60] = 1.4 * sign  # one pixel outside
    maps = quality, np.cos(2 * angle), np.sin(2 * angle), width
    (own,) = decode_maps(*maps)
    (extreme,) = decode_maps(*maps, decoding=replace(RSS_2018, angle_window=5))
    assert own.angle == pytest.approx(0.2 * sign)
    assert extreme.angle == pytest.approx(expected)


def test_angle_window_is_cut_at_the_border():
    rows, cols = np.mgrid[:SIDE, :SIDE]
    quality = np.exp(-((rows - 2) ** 2 + (cols - 2) ** 2) / 400)
    angle = np.full((SIDE, SIDE), 0.2)
    angle[4, 4] = 0.5
    angle[-3:, -3:] = 1.5  # what a negative index would read
    near_border = replace(RSS_2018, min_distance=1, angle_window=5, quality_sigma=0.5)
    (grasp,) = decode_maps(quality, np.cos(2 * angle), np.sin(2 * angle), quality, decoding=near_border)
    assert (grasp.row, grasp.col) == (2, 2)
    assert grasp.angle == pytest.approx(0.5)


def test_angles_are_smoothed_only_when_asked_for():
    quality, _, _, width = maps_of([Grasp(60, 60, 0, 40)])
    angle = 0.3 + np.random.default_rng(0).normal(0, 0.1, (SIDE, SIDE))
    maps = quality, np.cos(2 * angle), np.sin(2 * angle), width
    (own,) = decode_maps(*maps)
    (smooth,) = decode_maps(*maps, decoding=replace(RSS_2018, angle_sigma=2.0, border="reflect"))
    assert own.angle == pytest.approx(angle[60, 60])
    assert smooth.angle == pytest.approx(gaussian_filter(angle, 2.0)[60, 60])


def test_width_without_smoothing_is_the_networks():
    quality, cos, sin, width = maps_of([Grasp(60, 60, 0, 40)])
    width[60, 60] = 0.6
    (grasp,) = decode_maps(quality, cos, sin, width, decoding=replace(RSS_2018, width_sigma=0.0))
    assert grasp.width_px == pytest.approx(90)


def test_beyond_the_border_a_map_goes_on_as_said():
    noise = np.random.default_rng(1).random((SIDE, SIDE))
    for border in ("nearest", "reflect"):
        decoding = replace(RSS_2018, border=border, min_distance=1, peaks_at_border=True)
        (grasp,) = decode_maps(noise, noise, noise, noise, decoding=decoding)
        smooth = gaussian_filter(noise, 5, mode=border)
        assert (grasp.row, grasp.col) == np.unravel_index(smooth.argmax(), smooth.shape)
        assert grasp.quality == pytest.approx(smooth.max())


def test_peaks_at_the_border_are_found_when_allowed():
    maps = maps_of([Grasp(3, 60, 0.2, 40, 0.9), Grasp(60, 60, 0.2, 40, 0.5)])
    (inner,) = decode_maps(*maps)
    (outer,) = decode_maps(*maps, decoding=replace(RSS_2018, peaks_at_border=True))
    assert inner.row == 60
    assert outer.row < 20
    assert outer.quality > inner.quality


def test_constants_of_rss_2018_are_unchanged():
    assert asdict(RSS_2018) == {
        "quality_sigma": 5.0,
        "width_sigma": 1.0,
        "angle_sigma": 0.0,
        "border": "nearest",
        "width_scale": 150.0,
        "min_distance": 20,
        "peaks_at_border": False,
        "threshold": 0.2,
        "angle_window": 0,
    }


def test_channel_axis_is_accepted():
    maps = maps_of([Grasp(60, 60, 0.4, 40)])
    assert decode_maps(*(values[..., None] for values in maps)) == decode_maps(*maps)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: [m[0][:50], *m[1:]], "one shape"),
        (lambda m: [m[0], m[1] * np.nan, *m[2:]], "finite cos"),
        (lambda m: [m[0][None], *m[1:]], "quality map"),
    ],
)
def test_bad_maps_are_refused(change, message):
    with pytest.raises(GraspError, match=message):
        decode_maps(*change(list(maps_of([Grasp(60, 60, 0, 40)]))))


def test_zero_grasps_is_refused():
    with pytest.raises(GraspError, match="n_grasps"):
        decode_maps(*maps_of([]), n_grasps=0)
