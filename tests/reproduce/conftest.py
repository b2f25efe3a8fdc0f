"""Networks, objects and commands; makes the module beside the tests importable from them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.protocol import PAPER
from ggcnn_net2net.reproduce import table1
from ggcnn_net2net.reproduce.networks import Network
from ggcnn_net2net.reproduce.paper import TABLE1
from ggcnn_net2net.simulation.convex import box, write_obj
from ggcnn_net2net.simulation.object_sets import ObjectSet, make_model

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def objects(tmp_path) -> ObjectSet:
    sizes = {"brick": (0.06, 0.15, 0.08), "plank": (0.2, 0.05, 0.02), "cube": (0.12, 0.12, 0.12)}
    models = []
    for name, size in sizes.items():
        write_obj(tmp_path / f"{name}.obj", [box(size)])
        models.append(make_model(name, name.title(), tmp_path / f"{name}.obj", PAPER))
    return ObjectSet("three", tuple(models))


@pytest.fixture
def network(monkeypatch) -> Callable[..., Network]:
    """Networks that need no TensorFlow: they always grasp the image's middle with a fixed opening, or see nothing.

    `network.decodings` are those that were asked for.
    """

    def predict(model, depth, decoding):
        make.decodings.append(decoding)
        return [Grasp(149.0, 150.0, 0.4, model, 0.9) if model else None for _ in np.asarray(depth)]

    monkeypatch.setattr(table1, "each_grasp", predict)

    def make(name: str, opening_px: float, sha256: str) -> Network:
        return Network(name, "C1x1x1", 17, f"{name}.hdf5", sha256, opening_px, TABLE1.get(name))

    make.decodings = []
    return make
