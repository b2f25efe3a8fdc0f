"""Fixtures for all tests. Nothing here, and no test, uses the network."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell starts jobs in its background deaf to Ctrl-C, and so would be the processes that tests interrupt.
    signal.signal(signal.SIGINT, signal.default_int_handler)

PARTS = (
    "original_ggcnn_weights/epoch_29_model.hdf5",
    "original_ggcnn_weights/pytorch/ggcnn_epoch_23_cornell_statedict.pt",
    "cornell/01",
    "jacquard_samples",
    "objects/ycb40/objects.csv",
)
NEEDS_DATA = "needs the reference data: set GGCNN_NET2NET_DATA to a folder with"


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder of the reference data; tests that need it are skipped where it, or a part of it, is absent."""
    value = os.environ.get("GGCNN_NET2NET_DATA")
    missing = [part for part in PARTS if not value or not (Path(value) / part).exists()]
    if missing:
        pytest.skip(f"{NEEDS_DATA} {', '.join(missing)}")
    return Path(str(value))
