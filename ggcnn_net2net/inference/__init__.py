"""From depth images to grasps."""

from ggcnn_net2net.inference.predict import predict_grasps, predict_maps

__all__ = ["predict_grasps", "predict_maps"]
