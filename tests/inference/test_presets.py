"""The presets' smoothing and maxima against the same steps written with the libraries that their sources use."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from skimage.feature import peak_local_max
from skimage.filters import gaussian

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.grasping import decode_maps
from ggcnn_net2net.inference.presets import GGCNN_MASTER, KINOVA, MVP, PRESETS, Preset, preset_named


def unsmooth(values):
    return values


def best(quality):
    return np.unravel_index(quality.argmax(), quality.shape)


def best_local(quality):
    return tuple(peak_local_max(quality, min_distance=20, threshold_abs=0.2, num_peaks=1)[0])


SOURCES = {
    KINOVA: (lambda q: gaussian_filter(q, 5.0), lambda a: gaussian_filter(a, 2.0), unsmooth, best),
    MVP: (*[lambda values: gaussian_filter(values, 2.0)] * 3, best),
    GGCNN_MASTER: (
        lambda q: gaussian(q, 2.0, preserve_range=True),
        lambda a: gaussian(a, 2.0, preserve_range=True),
        lambda w: gaussian(w, 1.0, preserve_range=True),
        best_local,
    ),
}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("preset", SOURCES, ids=lambda preset: preset.name)
def test_noise_decodes_as_in_the_source(preset, seed):
    """Maps of noise, so small that the border counts in some of them."""
    smooth_quality, smooth_angle, smooth_width, maximum = SOURCES[preset]
    quality, cos, sin, width = np.random.default_rng(seed).random((4, 200, 180))
    (grasp,) = decode_maps(quality, cos - 0.5, sin - 0.5, width, decoding=preset.decoding)
    place = maximum(smooth_quality(quality))
    assert (grasp.row, grasp.col) == place
    assert grasp.quality == pytest.approx(smooth_quality(quality)[place])
    assert grasp.angle == pytest.approx(smooth_angle(np.arctan2(sin - 0.5, cos - 0.5) / 2.0)[place])
    assert grasp.width_px == pytest.approx(smooth_width(width * 150.0)[place])


def test_presets_by_name():
    assert list(PRESETS) == ["rss_2018", "kinova", "mvp", "ggcnn_master", "paper_simulator"]
    assert all(preset_named(name) is preset and preset.name == name for name, preset in PRESETS.items())
    mine = Preset("mine", crop=200)
    assert preset_named(mine) is mine
    with pytest.raises(DepthImageError, match="kinova"):
        preset_named("Kinova")


@pytest.mark.parametrize("wrong", [{"crop": 0}, {"crop": -1}, {"clip": 0.0}])
def test_impossible_presets(wrong):
    with pytest.raises(DepthImageError, match="above 0"):
        Preset("mine", **wrong)
