"""Networks to export, and depth images to compare on."""

from __future__ import annotations

import numpy as np
import pytest

from ggcnn_net2net.architecture import build_ggcnn

SIZE = 60


@pytest.fixture(scope="session")
def network():
    """A GG-CNN of 60x60 pixels whose four maps differ clearly from each other."""
    model = build_ggcnn("C9x9x6_C5x5x4_C3x3x3_T3x3x3_T5x5x4_T9x9x6", input_size=SIZE, seed=1)
    rng = np.random.default_rng(2)
    model.set_weights([weight + rng.normal(0, 0.1, weight.shape) for weight in model.get_weights()])
    return model


@pytest.fixture(scope="session")
def depth():
    """Function (count, size): depth images (n, size, size) of boxes on a plane, in metres."""
    return boxes


def boxes(count: int = 3, size: int = SIZE) -> np.ndarray:
    rng = np.random.default_rng(3)
    images = np.full((count, size, size), 1.5)
    for image in images:
        row, col = rng.integers(0, size // 2, 2)
        image[row : row + size // 3, col : col + size // 4] -= rng.uniform(0.02, 0.2)
    return images + rng.normal(0, 0.001, images.shape)
