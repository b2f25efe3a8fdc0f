"""A GG-CNN in the formats that grasp stacks load, each run by its own runtime before it is kept."""

from ggcnn_net2net.model_files.export.exporting import export
from ggcnn_net2net.model_files.export.metadata import metadata_path, read_metadata

__all__ = ["export", "metadata_path", "read_metadata"]
