import json
import os
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pybullet_data
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from ggcnn_net2net.errors import ObjectSetError
from ggcnn_net2net.protocol import CORRECTED
from ggcnn_net2net.reference_data import sha256_of
from ggcnn_net2net.simulation.meshes import extents, read_parts
from ggcnn_net2net.simulation.object_sets import PYBULLET_FOLDERS, load_object_set
from ggcnn_net2net.simulation.scenes import make_scene
from ggcnn_net2net.simulation.training_objects import (
    FAMILIES,
    MAX_PARTS,
    PYBULLET_NUMBERS,
    PYBULLET_SIDES,
    SIDES,
    THINNEST,
    WIDEST,
    build,
    shape_of,
    training_object,
)

BY_NAME = {family.name: family for family in FAMILIES}
SEED = 4

# Runs in a process of its own: prints the objects, and fails where a design of the benchmark was imported.
MAKE = f"""
import json, sys
from ggcnn_net2net.reference_data import sha256_of
from ggcnn_net2net.simulation.training_objects import training_object

models = [training_object(index, {SEED}) for index in range(80)]
assert not [name for name in sys.modules if name.startswith("ggcnn_net2net.simulation.procedural")]
print(json.dumps([[model.name, sha256_of(model.mesh), model.scale, model.centre] for model in models]))
"""


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    """An empty user cache."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder / "ggcnn_net2net"


@pytest.fixture(scope="module")
def sample():
    return [training_object(index, SEED) for index in range(300)]


def described(models):
    return [[model.name, sha256_of(model.mesh), model.scale, list(model.centre)] for model in models]


assemblies = pytest.mark.parametrize("name", [family.name for family in FAMILIES if family.design])


def test_processes_that_write_at_the_same_time_make_the_same_objects_without_any_benchmark_design(sample, tmp_path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    runs = [subprocess.Popen([sys.executable, "-c", MAKE], stdout=-1, env=environment, text=True) for _ in range(2)]
    outputs = [run.communicate()[0].splitlines()[-1] for run in runs]
    assert [run.returncode for run in runs] == [0, 0]
    assert json.loads(outputs[0]) == json.loads(outputs[1]) == described(sample[:80])
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) == sum(model.category != "pybullet" for model in sample[:80])


def test_an_object_depends_on_index_and_seed_alone(sample):
    assert described([training_object(index, SEED) for index in (17, 3)]) == described([sample[17], sample[3]])
    others = [training_object(index, SEED + 1) for index in range(20)]
    assert not {model.mesh for model in others} & {model.mesh for model in sample}


def test_a_mesh_is_written_once_and_under_its_content(sample, cache):
    assemblies = [model for model in sample if model.category != "pybullet"]
    assert all(cache in model.mesh.parents for model in assemblies)
    assert len({model.mesh for model in assemblies}) == len(assemblies)
    times = [model.mesh.stat().st_mtime_ns for model in sample]
    assert [training_object(index, SEED) for index in range(300)] == sample
    assert times == [model.mesh.stat().st_mtime_ns for model in sample]
    for model in assemblies:
        assert sha256_of(model.mesh).startswith(model.mesh.stem.rpartition("-")[2])


def test_every_family_occurs_about_as_often_as_the_table_says(sample):
    counts = Counter(model.category for model in sample)
    assert set(counts) == set(BY_NAME)
    assert sum(family.weight for family in FAMILIES) == 100
    for family in FAMILIES:
        share = family.weight / 100
        assert abs(counts[family.name] / 300 - share) < 4 * np.sqrt(share * (1 - share) / 300)
    assert [model.name for model in sample] == [f"{model.category}_{index:06d}" for index, model in enumerate(sample)]


@pytest.mark.parametrize("benchmark", ["procedural40", "pybullet", "ycb40"])
def test_disjoint_from_the_benchmark(sample, benchmark, request):
    if benchmark == "ycb40":
        request.getfixturevalue("data_root")
    objects = load_object_set(benchmark).objects
    assert not {model.name for model in sample} & {model.name for model in objects}
    assert not {sha256_of(model.mesh) for model in sample} & {sha256_of(model.mesh) for model in objects}


def test_pybullet_numbers_are_those_that_the_benchmark_leaves(sample):
    assert len(PYBULLET_NUMBERS) == 959  # of 1000, without the benchmark's 40 and one broken mesh
    assert not set(PYBULLET_NUMBERS) & set(PYBULLET_FOLDERS)
    used = [model.mesh.parent.name for model in sample if model.category == "pybullet"]
    assert set(used) <= set(PYBULLET_NUMBERS)
    assert len(set(used)) > 80


def test_no_pybullet_mesh_is_a_copy_of_one_in_the_benchmark():
    root = Path(pybullet_data.getDataPath()) / "random_urdfs"

    def content(number):
        text = (root / number / f"{number}.obj").read_text()
        return text.split("\nv ", 1)[1]  # without the header, which names the number

    assert not {content(number) for number in PYBULLET_NUMBERS} & {content(number) for number in PYBULLET_FOLDERS}


def test_sizes_masses_and_parts(sample):
    for model in sample:
        low, high = PYBULLET_SIDES if model.category == "pybullet" else SIDES
        _, middle, longest = np.sort(extents(read_parts(model.mesh))) * model.scale
        assert longest == pytest.approx(model.longest_side)
        assert low - 1e-5 <= longest <= high + 1e-5
        assert middle <= WIDEST + 1e-5
        assert model.mass == model.longest_side > 0
        assert len(read_parts(model.mesh)) <= MAX_PARTS
    small, middle, large = np.histogram([model.longest_side for model in sample], [0.0, 0.08, 0.16, 0.33])[0] / 300
    assert min(small, middle, large) > 0.1


@assemblies
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_any_draw_of_a_family_is_a_solid_object_of_a_size(name, seed):
    parts = build(BY_NAME[name].design, np.random.default_rng(seed))
    assert 1 <= len(parts) <= MAX_PARTS
    assert SIDES[0] - 1e-9 <= extents(parts).max() <= SIDES[1] + 1e-9
    for part in parts:
        hull = ConvexHull(part)
        assert hull.volume > 1e-8  # a hundredth of a cubic centimetre
        assert min(np.ptp(part @ normal) for normal in hull.equations[:, :3]) > 0.999 * THINNEST


def touch(first, second):
    """Whether a point lies behind the faces of both of two convex parts."""
    faces = np.concatenate([ConvexHull(part).equations for part in (first, second)])
    return linprog(np.zeros(3), faces[:, :3], 1e-9 - faces[:, 3], bounds=(None, None)).status == 0


@pytest.mark.slow
@assemblies
def test_parts_form_one_body(name):
    for seed in range(5):
        parts = build(BY_NAME[name].design, np.random.default_rng(seed))
        pairs = np.eye(len(parts))
        for first, second in combinations(range(len(parts)), 2):
            pairs[first, second] = touch(parts[first], parts[second])
        assert connected_components(pairs, directed=False)[0] == 1


@assemblies
def test_draws_of_a_family_differ(name):
    shapes = [np.sort(extents(build(BY_NAME[name].design, np.random.default_rng(seed)))) for seed in range(12)]
    ratios = np.array([shape / shape[-1] for shape in shapes])
    assert np.unique(ratios.round(3), axis=0).shape[0] == 12


def test_centre_follows_the_protocol():
    index = next(index for index in range(100) if training_object(index, SEED).category == "tool")
    assert training_object(index, SEED).mesh == training_object(index, SEED, CORRECTED).mesh
    assert training_object(index, SEED).centre != training_object(index, SEED, CORRECTED).centre


def test_sides_can_be_given():
    sides = (0.2, 0.3)
    large = [training_object(index, SEED, sides=sides) for index in range(60)]
    longest = np.array([one.longest_side for one in large])
    assert longest.min() >= 0.2 - 1e-6
    assert longest.max() <= 0.3 + 1e-6
    assert np.ptp(longest) > 0.08
    assert {one.category for one in large} > {"pybullet", "cup"}
    assert all(np.sort(extents(read_parts(one.mesh)) * one.scale)[1] <= WIDEST + 1e-6 for one in large)


def test_sides_that_a_family_cannot_have():
    (walls,) = (family.design for family in FAMILIES if family.name == "bin")
    with pytest.raises(ObjectSetError, match=r"received 0.04 to 0.04 m: choose a wider one"):
        build(walls, np.random.default_rng(0), (0.04, 0.04))


def test_objects_of_one_mesh_have_one_shape(sample):
    of_pybullet = [one for one in sample if one.category == "pybullet"]
    assert all(shape_of(one) == f"pybullet_{one.mesh.stem}" for one in of_pybullet)
    assert all(shape_of(one) == one.name for one in sample if one.category != "pybullet")
    again = replace(of_pybullet[0], name="pybullet_999999", scale=2.0)
    assert shape_of(again) == shape_of(of_pybullet[0]) != shape_of(of_pybullet[1])


@pytest.mark.parametrize(("index", "seed"), [(-1, 0), (0, -1)])
def test_negative_numbers(index, seed):
    with pytest.raises(ObjectSetError, match="0 or more"):
        training_object(index, seed)


def test_as_an_object_set(sample):
    objects = load_object_set(f"training:12:{SEED}")
    assert (objects.name, list(objects.objects)) == (f"training:12:{SEED}", sample[:12])
    assert load_object_set("training").objects[:12] == load_object_set("training:12").objects
    usual = load_object_set("training")
    assert (usual.name, len(usual.objects)) == ("training", 40)


@pytest.mark.parametrize("argument", ["0", "-3", "many", "3:", "3:x", "3:1:2", "1.5"])
def test_bad_arguments_of_the_set(argument):
    with pytest.raises(ObjectSetError, match="training:N:SEED"):
        load_object_set(f"training:{argument}")


@pytest.mark.slow
@assemblies
def test_scenes_can_be_made(world, sample, name):
    models = [model for model in sample if model.category == name][:4]
    scenes = [make_scene(world, model, 0, seed=1) for model in models]
    assert all(scene.stable for scene in scenes)
    assert sum(scene.drops == 1 for scene in scenes) >= len(scenes) - 1
    for scene in scenes:
        assert 0 < scene.position[2] < scene.model.longest_side
        assert np.ptp(scene.depth) > 0.002
