"""Grasps in the image: rectangle geometry, the decoding of a GG-CNN's four maps, the IoU rate. No Keras."""

from ggcnn_net2net.grasping.decoding import RSS_2018, Decoding, decode_maps
from ggcnn_net2net.grasping.geometry import Grasp, closing_angles, grasp_to_rectangle, rectangle_to_grasp, wrap_angle
from ggcnn_net2net.grasping.iou import IouRate, grasp_iou, iou_rate, iou_success, published_rectangle

__all__ = [
    "RSS_2018",
    "Decoding",
    "Grasp",
    "IouRate",
    "closing_angles",
    "decode_maps",
    "grasp_iou",
    "grasp_to_rectangle",
    "iou_rate",
    "iou_success",
    "published_rectangle",
    "rectangle_to_grasp",
    "wrap_angle",
]
