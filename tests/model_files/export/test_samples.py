"""Depth images that exports are compared on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ggcnn_net2net.model_files.export.samples import default_samples, network_inputs, read_representative


@given(st.integers(0, 2**32 - 1), st.floats(0.3, 3))
def test_inputs_have_a_mean_of_zero_and_keep_metres(seed, distance):
    depth = distance + np.random.default_rng(seed).uniform(0, 0.5, (2, 7, 9))
    for image, original in zip(network_inputs(depth, (7, 9), "samples"), depth, strict=True):
        assert (image.shape, image.dtype) == ((1, 7, 9, 1), np.float32)
        assert abs(image.mean()) < 1e-6
        assert_allclose(np.ptp(image), np.ptp(original), rtol=1e-4)


def test_cornell_images_are_the_samples_where_they_are(data_root):
    depth, source = default_samples((300, 300))
    assert source == "Cornell Grasping Dataset"
    assert depth.shape == (8, 300, 300)
    assert 0.3 < depth.min() < depth.max() < 3
    assert default_samples((120, 200))[0].shape == (8, 120, 200)


@pytest.mark.slow
def test_simulated_scenes_are_the_samples_elsewhere(monkeypatch, tmp_path):
    (tmp_path / "cornell" / "deep" / "01").mkdir(parents=True)
    (tmp_path / "cornell" / "deep" / "01" / "pcd0100cpos.txt").touch()  # not where scenes are looked for
    monkeypatch.setenv("GGCNN_NET2NET_DATA", str(tmp_path))
    depth, source = default_samples((300, 300))
    assert source == "simulated scenes"
    assert depth.shape == (4, 300, 300)
    assert 1 < depth.min() < depth.max() < 2
    assert np.ptp(depth, axis=(1, 2)).min() > 0.01  # an object in each


def test_representative_images_of_a_folder(data_root):
    assert read_representative(data_root / "cornell", (60, 60)).shape == (100, 60, 60)
