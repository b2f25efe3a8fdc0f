"""Makes `training_images`, which stands beside the tests, importable from them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from training_images import SyntheticGrasps

import ggcnn_net2net as gn


@pytest.fixture(scope="session")
def grasps():
    """Twelve images of 36x36 pixels."""
    return SyntheticGrasps(12, 36)


@pytest.fixture(scope="session")
def small():
    """An untrained network for them; no test may change it."""
    return gn.build_ggcnn("narrow", input_size=36, seed=1)
