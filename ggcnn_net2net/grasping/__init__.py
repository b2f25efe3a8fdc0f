"""Grasps in the image: rectangle geometry and the decoding of a GG-CNN's four maps. NumPy only, no Keras."""

from ggcnn_net2net.grasping.decoding import RSS_2018, Decoding, decode_maps
from ggcnn_net2net.grasping.geometry import Grasp, grasp_to_rectangle, rectangle_to_grasp, wrap_angle

__all__ = [
    "RSS_2018",
    "Decoding",
    "Grasp",
    "decode_maps",
    "grasp_to_rectangle",
    "rectangle_to_grasp",
    "wrap_angle",
]
