"""Model files: reading a GG-CNN of any origin, writing it for others, looking into a file, and the published one."""

from ggcnn_net2net.model_files.check import check_ggcnn
from ggcnn_net2net.model_files.load import load_ggcnn
from ggcnn_net2net.model_files.published import PUBLISHED_SHA256, published_weights
from ggcnn_net2net.model_files.save import save_ggcnn
from ggcnn_net2net.model_files.summary import ModelSummary, model_summary

__all__ = [
    "PUBLISHED_SHA256",
    "ModelSummary",
    "check_ggcnn",
    "load_ggcnn",
    "model_summary",
    "published_weights",
    "save_ggcnn",
]
