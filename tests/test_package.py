"""What a user notices first: importing is quick, and every public name is there."""

import subprocess
import sys

import pytest

import ggcnn_net2net

HEAVY = ("tensorflow", "keras", "pybullet", "matplotlib", "trimesh", "skimage")


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("module", ["ggcnn_net2net", "ggcnn_net2net.architecture", "ggcnn_net2net.cli.main"])
def test_import_is_light(module):
    loaded = run(f"import sys, {module}; print(*sys.modules)").split()
    assert not set(HEAVY) & set(loaded)


def test_every_public_name_resolves():
    for name in ggcnn_net2net.__all__:
        assert getattr(ggcnn_net2net, name) is not None
    assert sorted(dir(ggcnn_net2net)) == sorted(ggcnn_net2net.__all__)


def test_unknown_name():
    with pytest.raises(AttributeError, match="no attribute 'wieder'"):
        _ = ggcnn_net2net.wieder


def test_importing_pybullet_prints_nothing():
    done = subprocess.run(
        [sys.executable, "-c", "from ggcnn_net2net.simulation.world import World; World().close()"],
        capture_output=True,
        check=True,
    )
    assert (done.stdout, done.stderr) == (b"", b"")


def test_simulation_workers_start_without_tensorflow():
    loaded = run("import sys, ggcnn_net2net.simulation.benchmark; print(*sys.modules)").split()
    assert not {"tensorflow", "keras", "trimesh", "matplotlib"} & set(loaded)
