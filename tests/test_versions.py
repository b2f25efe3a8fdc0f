"""What stands beside every result."""

import platform
from importlib.metadata import PackageNotFoundError, version

from ggcnn_net2net import versions as module
from ggcnn_net2net.versions import PACKAGES, versions


def test_every_package_has_its_version_also_under_another_name():
    found = versions()
    assert set(found) == {"ggcnn_net2net", "python", *PACKAGES}
    assert found["python"] == platform.python_version()
    assert found["keras"] == version("keras")
    assert found["tensorflow"][0].isdigit()  # also where tensorflow-cpu brings it


def test_a_package_that_is_not_installed_is_none_and_no_error(monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(module, "version", missing)
    assert {versions()[name] for name in PACKAGES} == {"none"}
