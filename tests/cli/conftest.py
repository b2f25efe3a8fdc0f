"""A data file for commands that train."""

import numpy as np
import pytest

from ggcnn_net2net.datasets.augmentation import Sample
from ggcnn_net2net.datasets.hdf5 import DatasetWriter
from ggcnn_net2net.datasets.label_maps import LabelMaps

SIZE = 36


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """Twelve images of 36x36 pixels, eight of them to train on."""
    path = tmp_path_factory.mktemp("data") / "grasps.h5"
    random = np.random.default_rng(0)
    with DatasetWriter(path, {"source": "test"}) as writer:
        for number in range(12):
            quality = (random.random((SIZE, SIZE)) > 0.9).astype(np.float32)
            depth = random.normal(0, 0.1, (SIZE, SIZE)).astype(np.float32)
            sample = Sample(
                f"scene{number}",
                depth,
                np.zeros((SIZE, SIZE, 3), np.uint8),
                np.ones((1, 4, 2)) * [[[1, 1], [1, 9], [5, 9], [5, 1]]],
                LabelMaps(quality, 0.3 * quality, 60 * quality),
            )
            writer.add("train" if number < 8 else "test", sample)
    return path
