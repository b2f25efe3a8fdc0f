"""Operations on the published network, over real Cornell depth images and random ones."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import keras
import numpy as np
import pytest
from published_differences import SINGLE_OPERATIONS, WEIGHTS, cornell_images, random_images
from surgery_models import max_difference, outputs, with_dtype

import ggcnn_net2net as gn
from ggcnn_net2net.net2net import (
    EXTENDED_OPERATIONS,
    OPTIMIZED_OPERATIONS,
    apply_operations,
    history_of,
    operations,
)

ALL = [*SINGLE_OPERATIONS, EXTENDED_OPERATIONS]


@pytest.fixture(scope="module")
def published(data_root: Path) -> keras.Model:
    return gn.load_ggcnn(data_root / WEIGHTS)


@pytest.fixture(scope="module")
def images(data_root: Path) -> np.ndarray:
    return np.concatenate([cornell_images(data_root), random_images()])


@pytest.mark.slow
def test_float32_outputs_stay_within_1e_5(data_root: Path) -> None:
    script = Path(__file__).with_name("published_differences.py")
    # oneDNN's convolutions round more than TensorFlow's own: see the next test.
    environment = os.environ | {"TF_ENABLE_ONEDNN_OPTS": "0"}
    result = subprocess.run(
        [sys.executable, str(script), str(data_root)], env=environment, capture_output=True, text=True, check=True
    )
    differences = json.loads(result.stdout)
    assert list(differences) == ALL
    assert max(differences.values()) <= 1e-5, differences


@pytest.mark.slow
@pytest.mark.parametrize("text", ALL)
def test_default_float32_outputs_stay_within_rounding(published: keras.Model, images: np.ndarray, text: str) -> None:
    child = apply_operations(published, text)
    # wider(1) doubles the terms that conv2d_2 sums, 1600 instead of 800 with sums up to 25. With oneDNN the network
    # itself is up to 9e-6 away from its float64 outputs, and this child up to 2e-5 from its parent.
    assert max_difference(published, child, images) <= (2e-5 if text == "wider(1)" else 1e-5)


@pytest.mark.slow
def test_float64_outputs_stay_within_1e_12(published: keras.Model, images: np.ndarray) -> None:
    model = with_dtype(published, "float64")
    images = images[[0, -1]].astype("float64")
    before = outputs(model, images)
    for text in ALL:
        for noise in (0.0, 1.0):
            after = outputs(apply_operations(model, text, noise=noise), images)
            differences = [np.abs(a - b).max() for a, b in zip(before, after, strict=True)]
            assert max(differences) <= 1e-12, (text, noise, differences)


def test_the_extended_network_of_the_paper(published: keras.Model) -> None:
    extended = apply_operations(published, EXTENDED_OPERATIONS)
    assert gn.architecture_of(extended) == gn.EXTENDED
    assert extended.count_params() == 67_644
    assert type(extended) is type(published)
    assert extended.output_names == list(published.output_names) == ["pos_out", "cos_out", "sin_out", "width_out"]
    assert [entry["operation"] for entry in history_of(extended)] == EXTENDED_OPERATIONS.replace("), ", ");").split(";")
    assert [layer.name for layer in extended.layers][3:8] == [
        "conv2d_3",
        "conv2d_3_deeper_3",
        "conv2d_3_deeper",
        "conv2d_3_deeper_2",
        "conv2d_transpose_1",
    ]


def test_the_optimized_network_of_the_paper() -> None:
    narrow = gn.build_ggcnn(gn.NARROW, input_size=60, seed=0)
    optimized = apply_operations(narrow, OPTIMIZED_OPERATIONS)
    assert gn.architecture_of(optimized) == gn.OPTIMIZED
    assert optimized.count_params() == 16_104
    x = np.random.default_rng(0).uniform(-1, 1, size=(2, 60, 60, 1)).astype("float32")
    assert max_difference(narrow, optimized, x) <= 1e-5


def test_the_search_space_of_the_paper() -> None:
    model = gn.build_ggcnn(gn.ORIGINAL, input_size=60)
    names = [str(operation) for operation in operations(model)]
    assert names == ["deeper(1)", "deeper(2)", "deeper(3)", "wider(1)", "wider(2)", "wider(3)"]
    assert sorted(map(str, operations(model, transpose=True))) == sorted(SINGLE_OPERATIONS)
