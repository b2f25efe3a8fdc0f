"""A network and its provenance, as `ggcnn-net2net train` writes them, and a zoo without networks."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from ggcnn_net2net.cli.train import train_command
from ggcnn_net2net.datasets.augmentation import Sample
from ggcnn_net2net.datasets.hdf5 import DatasetWriter
from ggcnn_net2net.datasets.label_maps import LabelMaps
from ggcnn_net2net.zoo import files

SIZE = 36


@pytest.fixture
def empty_zoo(tmp_path, monkeypatch) -> Path:
    """The folder that the package takes for its zoo."""
    folder = tmp_path / "zoo"
    folder.mkdir()
    monkeypatch.setattr(files, "FOLDER", folder)
    return folder


@pytest.fixture(scope="session")
def trained(tmp_path_factory) -> Path:
    """A small network that the train command made, its provenance beside it."""
    folder = tmp_path_factory.mktemp("trained")
    quality = np.eye(SIZE, dtype=np.float32)
    sample = Sample(
        "scene",
        np.linspace(0, 0.1, SIZE * SIZE, dtype=np.float32).reshape(SIZE, SIZE),
        np.zeros((SIZE, SIZE, 3), np.uint8),
        np.ones((1, 4, 2)),
        LabelMaps(quality, 0.3 * quality, 60 * quality),
    )
    with DatasetWriter(folder / "grasps.h5", {"source": "test"}) as writer:
        for _ in range(4):
            writer.add("train", sample)
    arguments = ["shallow", folder / "grasps.h5", "-o", folder / "mine.hdf5", "--epochs", "1", "--no-validation"]
    with pytest.MonkeyPatch.context() as patch:
        # TensorFlow runs already in this process, with the number of threads it has.
        patch.setattr("ggcnn_net2net.training.set_threads", lambda threads: None)
        CliRunner().invoke(train_command, [str(part) for part in arguments], catch_exceptions=False)
    return folder / "mine.hdf5"


@pytest.fixture
def facts(trained) -> dict[str, Any]:
    """The provenance of `trained`."""
    return json.loads(trained.with_suffix(".json").read_text())
