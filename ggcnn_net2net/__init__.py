"""Automated growing and shrinking of GG-CNN grasp networks.

The names below are the public interface. They are imported on first use, so that `import ggcnn_net2net` is quick and
TensorFlow is loaded only when a network is.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ggcnn_net2net._version import __version__

if TYPE_CHECKING:
    from ggcnn_net2net.architecture import (
        EXTENDED,
        NARROW,
        OPTIMIZED,
        ORIGINAL,
        SHALLOW,
        Architecture,
        architecture_of,
        build_ggcnn,
    )
    from ggcnn_net2net.errors import GGCNNError
    from ggcnn_net2net.grasping import Grasp, decode_maps
    from ggcnn_net2net.model_files import load_ggcnn
    from ggcnn_net2net.protocol import CORRECTED, PAPER, Protocol

_HOME = {
    "Architecture": "architecture",
    "EXTENDED": "architecture",
    "NARROW": "architecture",
    "OPTIMIZED": "architecture",
    "ORIGINAL": "architecture",
    "SHALLOW": "architecture",
    "architecture_of": "architecture",
    "build_ggcnn": "architecture",
    "GGCNNError": "errors",
    "Grasp": "grasping",
    "decode_maps": "grasping",
    "load_ggcnn": "model_files",
    "CORRECTED": "protocol",
    "PAPER": "protocol",
    "Protocol": "protocol",
}

__all__ = [
    "CORRECTED",
    "EXTENDED",
    "NARROW",
    "OPTIMIZED",
    "ORIGINAL",
    "PAPER",
    "SHALLOW",
    "Architecture",
    "GGCNNError",
    "Grasp",
    "Protocol",
    "__version__",
    "architecture_of",
    "build_ggcnn",
    "decode_maps",
    "load_ggcnn",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
