"""Makes the modules beside the tests importable from them."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from search_data import write_dataset


@pytest.fixture(scope="session")
def dataset(tmp_path_factory) -> Path:
    """Twelve images to train on, six to score."""
    return write_dataset(tmp_path_factory.mktemp("dataset") / "boxes.h5")
