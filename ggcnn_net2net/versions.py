"""Versions of the packages that a result depends on; they are stored with every result."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

from ggcnn_net2net._version import __version__

PACKAGES = ("tensorflow", "keras", "pybullet", "numpy", "scipy", "scikit-image")


def versions() -> dict[str, str]:
    """Versions of this package, of Python and of `PACKAGES`, by name; "none" for one that is not installed."""
    return {
        "ggcnn_net2net": __version__,
        "python": platform.python_version(),
        **{package: _version(package) for package in PACKAGES},
    }


def _version(package: str) -> str:
    for distribution in (package, f"{package}-cpu"):  # tensorflow-cpu brings the module under another name
        try:
            return version(distribution)
        except PackageNotFoundError:
            continue
    return "none"
