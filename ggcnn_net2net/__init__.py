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
    from ggcnn_net2net.grasping import Decoding, Grasp, decode_maps
    from ggcnn_net2net.inference import predict_grasps
    from ggcnn_net2net.inference.intrinsics import CameraGrasp, Intrinsics
    from ggcnn_net2net.inference.predictor import GraspPredictor
    from ggcnn_net2net.model_files import load_ggcnn, model_summary, save_ggcnn
    from ggcnn_net2net.model_files.export import export
    from ggcnn_net2net.net2net import Operation, apply_operations, deeper, history_of, operations, wider
    from ggcnn_net2net.protocol import CORRECTED, PAPER, Protocol

_HOME = {
    "Architecture": "architecture",
    "CORRECTED": "protocol",
    "CameraGrasp": "inference.intrinsics",
    "Decoding": "grasping",
    "EXTENDED": "architecture",
    "GGCNNError": "errors",
    "Grasp": "grasping",
    "GraspPredictor": "inference.predictor",
    "Intrinsics": "inference.intrinsics",
    "NARROW": "architecture",
    "OPTIMIZED": "architecture",
    "ORIGINAL": "architecture",
    "Operation": "net2net",
    "PAPER": "protocol",
    "Protocol": "protocol",
    "SHALLOW": "architecture",
    "apply_operations": "net2net",
    "architecture_of": "architecture",
    "build_ggcnn": "architecture",
    "decode_maps": "grasping",
    "deeper": "net2net",
    "export": "model_files.export",
    "history_of": "net2net",
    "load_ggcnn": "model_files",
    "model_summary": "model_files",
    "operations": "net2net",
    "predict_grasps": "inference",
    "save_ggcnn": "model_files",
    "wider": "net2net",
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
    "CameraGrasp",
    "Decoding",
    "GGCNNError",
    "Grasp",
    "GraspPredictor",
    "Intrinsics",
    "Operation",
    "Protocol",
    "__version__",
    "apply_operations",
    "architecture_of",
    "build_ggcnn",
    "decode_maps",
    "deeper",
    "export",
    "history_of",
    "load_ggcnn",
    "model_summary",
    "operations",
    "predict_grasps",
    "save_ggcnn",
    "wider",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
