"""Prints, as JSON, how far each operation moves the outputs of the published network, in float32.

Runs in a process of its own, because TensorFlow chooses its convolution kernels when it is imported.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import tifffile
from surgery_models import max_difference

from ggcnn_net2net import load_ggcnn
from ggcnn_net2net.net2net import EXTENDED_OPERATIONS, apply_operations

SINGLE_OPERATIONS = [f"{name}({index})" for name in ("deeper", "wider") for index in range(1, 7)]
WEIGHTS = Path("original_ggcnn_weights", "epoch_29_model.hdf5")


def cornell_images(data_root: Path, number: int = 3) -> np.ndarray:
    """Depth of Cornell scenes as the network gets it: centre crop, minus the mean, clipped to a metre."""
    paths = sorted(data_root.glob("cornell/**/pcd*d.tiff"))[:number]
    depth = np.stack([tifffile.imread(path) for path in paths])
    crops = depth[:, 90:390, 170:470].astype("float32")
    return np.clip(crops - crops.mean(axis=(1, 2), keepdims=True), -1, 1)[..., None]


def random_images(number: int = 2) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, size=(number, 300, 300, 1)).astype("float32")


def differences(data_root: Path) -> dict[str, float]:
    """Operations -> largest absolute difference of any output."""
    model = load_ggcnn(data_root / WEIGHTS)
    images = np.concatenate([cornell_images(data_root), random_images()])
    return {
        operations: max_difference(model, apply_operations(model, operations), images)
        for operations in [*SINGLE_OPERATIONS, EXTENDED_OPERATIONS]
    }


if __name__ == "__main__":
    print(json.dumps(differences(Path(sys.argv[1]))))
