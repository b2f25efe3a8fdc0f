"""From depth images to grasps."""

from ggcnn_net2net.inference.intrinsics import CameraGrasp, Intrinsics
from ggcnn_net2net.inference.predict import predict_grasps, predict_maps
from ggcnn_net2net.inference.predictor import GraspPredictor, Prediction
from ggcnn_net2net.inference.presets import PRESETS, Preset

__all__ = [
    "PRESETS",
    "CameraGrasp",
    "GraspPredictor",
    "Intrinsics",
    "Prediction",
    "Preset",
    "predict_grasps",
    "predict_maps",
]
