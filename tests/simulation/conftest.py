"""Hand-made objects at rest, for tests of the simulation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ggcnn_net2net.protocol import PAPER
from ggcnn_net2net.simulation.camera import Camera
from ggcnn_net2net.simulation.convex import Part, write_obj
from ggcnn_net2net.simulation.object_sets import ObjectModel, make_model
from ggcnn_net2net.simulation.scenes import Scene
from ggcnn_net2net.simulation.world import World


@pytest.fixture(scope="session")
def world():
    with World() as world:
        yield world


@pytest.fixture
def model(tmp_path: Path) -> Callable[..., ObjectModel]:
    """Make an object of convex parts."""

    def make(name: str, parts: list[Part], **options) -> ObjectModel:
        mesh = tmp_path / f"{name}.obj"
        write_obj(mesh, parts)
        return make_model(name, name, mesh, PAPER, **options)

    return make


@pytest.fixture
def at_rest(world: World, model) -> Callable[..., Scene]:
    """Let an object made of convex parts settle on the plane as it is modelled, and look at it."""

    def make(name: str, parts: list[Part]) -> Scene:
        item = model(name, parts)
        world.reset()
        lowest = min(part[:, 2].min() for part in parts) - item.centre[2]
        body = world.add_object(item, (0, 0, -lowest + 0.002), (0, 0, 0, 1))
        assert world.settle(body)
        position, orientation = world.pose_of(body)
        camera = Camera(target=position)
        return Scene(item, 0, position, orientation, True, 1, *camera.render(world.client), camera)

    return make


@pytest.fixture
def box_scene(at_rest) -> Scene:
    """A box of 0.06 x 0.12 x 0.08 m, long side along y."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * (0.03, 0.06, 0.04)
    return at_rest("box", [corners])
