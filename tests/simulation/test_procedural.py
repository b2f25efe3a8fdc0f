import re
from collections import Counter
from itertools import combinations

import numpy as np
import pybullet
import pybullet_data
import pytest
from pybullet_utils.bullet_client import BulletClient
from scipy.optimize import linprog
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from ggcnn_net2net.simulation.convex import obj_text, rotate, scale, translate, write_obj
from ggcnn_net2net.simulation.procedural import PROCEDURAL40

CATEGORIES = Counter(
    Pencil=4,
    CellPhone=3,
    Guitar=2,
    Vase=2,
    TrashBin=2,
    Stapler=2,
    Knife=2,
    Gun=2,
    ToyFigure=1,
    Mug=1,
    Plate=1,
    Cup=1,
    PaperBox=1,
    Bowl=1,
    Book=1,
    Coin=1,
    Camera=1,
    BeerBottle=1,
    Candle=1,
    Bird=1,
    Sword=1,
    Pan=1,
    Fish=1,
    Hammer=1,
    Keyboard=1,
    Cap=1,
    Banana=1,
    Flashlight=1,
    Scissors=1,
)
BY_NAME = {item.name: item for item in PROCEDURAL40}

every_object = pytest.mark.parametrize("item", PROCEDURAL40, ids=lambda item: item.name)


@pytest.fixture(scope="module")
def client():
    client = BulletClient(pybullet.DIRECT)
    yield client
    client.disconnect()


@pytest.fixture
def load(client, tmp_path):
    """Puts an object into an empty world as the simulation does: its file is the collision shape."""

    def load(parts, mass=0.0, **pose):
        client.resetSimulation()
        write_obj(tmp_path / "object.obj", parts)
        centre = np.concatenate(parts).mean(axis=0) if mass else np.zeros(3)
        shape = client.createCollisionShape(
            pybullet.GEOM_MESH,
            fileName=str(tmp_path / "object.obj"),
            collisionFramePosition=(-centre).tolist(),
        )
        return client.createMultiBody(mass, shape, **pose)

    return load


def in_millimetres(name):
    """An object as it is designed, a thousandth of its units to the metre."""
    return scale(BY_NAME[name].design(), 1e-3)


def sides(parts):
    return np.ptp(np.concatenate(parts), axis=0)


def thickness(part):
    """Smallest distance between two parallel planes around a part of which one carries a face."""
    return min(np.ptp(part @ normal) for normal in ConvexHull(part).equations[:, :3])


def touch(first, second):
    """Whether two convex parts share a point: weights of their corners exist that make it."""
    if np.any(first.min(axis=0) > second.max(axis=0)) or np.any(second.min(axis=0) > first.max(axis=0)):
        return False
    weights = np.zeros((2, len(first) + len(second)))
    weights[0, : len(first)] = weights[1, len(first) :] = 1
    equal = np.concatenate([np.vstack([first, -second]).T, weights])
    return linprog(np.zeros(equal.shape[1]), A_eq=equal, b_eq=[0, 0, 0, 1, 1]).status == 0


def first_hit(client, start, end):
    """Point where a ray in millimetres hits something, in millimetres; None where it passes."""
    body, _, _, position, _ = client.rayTest(np.divide(start, 1000).tolist(), np.divide(end, 1000).tolist())[0]
    return None if body < 0 else np.multiply(position, 1000)


def test_touching_parts_are_told_from_separate_ones():
    cube = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    assert touch(cube, translate(cube, (1, 0, 0)))
    assert touch(cube, translate(cube, (0.5, 0.5, 0.5)))
    # Their boxes overlap at a corner, the bodies do not.
    tilted = rotate(cube - 0.5, "z", 45) + 0.5
    assert not touch(tilted, translate(tilted, (1, 1, 0)))


def test_categories_are_those_of_the_paper():
    assert len(PROCEDURAL40) == 40
    assert Counter(item.category for item in PROCEDURAL40) == CATEGORIES


def test_names_are_distinct_and_tell_the_category():
    assert len(BY_NAME) == 40
    for item in PROCEDURAL40:
        stem = re.sub(r"(?<=.)(?=[A-Z])", "_", item.category).lower()
        assert re.fullmatch(stem if CATEGORIES[item.category] == 1 else rf"{stem}_\d", item.name)


def test_longest_sides_spread_over_the_range():
    longest = sorted(sides(item.build()).max() for item in PROCEDURAL40)
    assert longest[0] >= 0.12
    assert longest[-1] <= 0.30 + 1e-9
    assert np.histogram(longest, bins=3, range=(0.12, 0.3001))[0].min() >= 3


def test_objects_of_one_category_differ():
    for first, second in combinations(PROCEDURAL40, 2):
        if first.category == second.category:
            one, other = np.sort(sides(first.build())), np.sort(sides(second.build()))
            assert np.abs(one - other).max() > 0.005, (first.name, second.name)


@every_object
def test_same_text_every_time(item):
    assert obj_text(item.build()) == obj_text(item.build())


@every_object
def test_small_enough_for_fast_physics(item):
    corners = [len(ConvexHull(part).vertices) for part in item.build()]
    assert len(corners) <= 40
    assert max(corners) <= 64
    assert sum(corners) <= 1200


@every_object
def test_no_part_is_thin(item):
    assert min(thickness(part) for part in item.build()) > 0.00399


@every_object
def test_parts_form_one_body(item):
    parts = item.build()
    pairs = np.zeros((len(parts), len(parts)))
    for first, second in combinations(range(len(parts)), 2):
        pairs[first, second] = touch(parts[first], parts[second])
    assert connected_components(pairs, directed=False)[0] == 1


@every_object
def test_fits_between_the_fingers(item):
    """As modelled, and from above, some direction across is clearly narrower than the gripper's 0.30 m."""
    outline = np.concatenate(item.build())[:, :2]
    assert min(np.ptp(outline @ normal) for normal in ConvexHull(outline).equations[:, :2]) < 0.27


@pytest.mark.parametrize("name", [name for name in BY_NAME if name.startswith("pencil")])
def test_pencils_are_thick_enough_to_be_held(name):
    assert sides(BY_NAME[name].build()).min() >= 0.008


@pytest.mark.parametrize(
    ("name", "rim", "depth"),
    [
        ("mug", 104, 90),
        ("cup", 72, 50),
        ("plate", 22, 12),
        ("bowl", 82, 65),
        ("pan", 36, 25),
        ("vase_1", 224, 200),
        ("vase_2", 145, 130),
        ("trash_bin_1", 150, 135),
        ("trash_bin_2", 203, 185),
        ("paper_box", 95, 85),
        ("guitar_1", 26, 15),
    ],
)
def test_vessels_are_hollow(client, load, name, rim, depth):
    load(in_millimetres(name))
    x = 72 if name == "guitar_1" else 0
    hit = first_hit(client, (x, 0, 1000), (x, 0, -1000))
    assert hit is not None
    assert 0 < hit[2] < rim - depth


def test_cap_is_hollow_from_below_and_closed_from_above(client, load):
    load(in_millimetres("cap"))
    assert first_hit(client, (0, 0, -1000), (0, 0, 1000))[2] > 75
    assert first_hit(client, (0, 0, 1000), (0, 0, -1000))[2] > 90
    assert first_hit(client, (40, 0, -1000), (40, 0, 1000))[2] > 75


@pytest.mark.parametrize(
    ("name", "axis", "hole", "bar"),
    [
        ("mug", 1, (57, 0, 52), (74, 0, 52)),
        ("cup", 1, (60, 0, 52), (73, 0, 54)),
        ("vase_2", 1, (54, 0, 105), (64, 0, 105)),
        ("candle", 1, (66, 0, 16), (75, 0, 16)),
        ("scissors", 2, (-62, -36, 0), (-42, -16, 0)),
        ("knife_2", 2, (90, 10, 0), (90, -10, 0)),
        ("pan", 2, (-186, 0, 0), (-165, 0, 0)),
        ("gun_1", 2, (60, -24, 0), (60, -40, 0)),
    ],
)
def test_handles_and_holes_are_open(client, load, name, axis, hole, bar):
    load(in_millimetres(name))
    along = 1000 * np.eye(3)[axis]
    assert first_hit(client, hole + along, hole - along) is None
    assert first_hit(client, bar + along, bar - along) is not None


@pytest.mark.slow
@every_object
@pytest.mark.parametrize("angles", [(0, 0, 0), (1.3, 0.4, 0.2)], ids=["upright", "tilted"])
def test_comes_to_rest_after_a_drop(client, load, item, angles):
    height = float(sides(item.build()).max())
    pose = {"basePosition": [0, 0, height], "baseOrientation": pybullet.getQuaternionFromEuler(angles)}
    body = load(item.build(), mass=height, **pose)
    client.loadURDF(f"{pybullet_data.getDataPath()}/plane.urdf")
    client.setGravity(0, 0, -10)
    client.setTimeStep(1e-3)
    still = 0
    for _ in range(10_000):
        client.stepSimulation()
        linear, angular = client.getBaseVelocity(body)
        still = still + 1 if np.linalg.norm(linear) < 1e-2 and np.linalg.norm(angular) < 0.1 else 0
        if still == 200:
            break
    assert still == 200
    assert 0 < client.getBasePositionAndOrientation(body)[0][2] < height
