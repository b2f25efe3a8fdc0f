"""Every error this package raises on purpose.

One tree with `GGCNNError` at the top, so `except GGCNNError` catches all of them and nothing else. A message says
what was expected, what was received and what to do about it.
"""

from __future__ import annotations

from typing import ClassVar


class GGCNNError(Exception):
    """Base of all errors of ggcnn_net2net."""

    page: ClassVar[str] = ""
    """The page of the documentation that helps, from the top of the repository; the command line names it."""


class ArchitectureError(GGCNNError):
    """An architecture string, or a model, that does not describe a GG-CNN."""

    page = "docs/reference/files.md"


class SurgeryError(GGCNNError):
    """A Net2Net operation that cannot be applied: no such layer, or one that cannot be changed without loss."""

    page = "docs/net2net.md"


class ModelFileError(GGCNNError):
    """A model file that cannot be read, is damaged, or does not hold a GG-CNN."""

    page = "docs/reference/files.md"


class DataNotFoundError(GGCNNError):
    """Reference data (weights, objects) that is nowhere to be found and cannot be fetched."""

    page = "README.md"


class VerificationError(GGCNNError):
    """A file whose content is not what was published: wrong SHA-256, or a mesh of the wrong shape."""

    page = "original_ggcnn_weights/README.md"


class GraspError(GGCNNError):
    """Grasp maps or grasp rectangles with an impossible shape or value."""

    page = "docs/datasets.md"


class ObjectSetError(GGCNNError):
    """An object set, mesh or CSV that cannot be used in the simulation."""

    page = "docs/howto/own_objects.md"


class SceneError(GGCNNError):
    """Scenes that cannot be made, read or matched to what was asked for."""

    page = "docs/simulator.md"


class SimulationError(GGCNNError):
    """The physics simulation could not do what was asked."""

    page = "docs/simulator.md"


class GripperError(SimulationError):
    """A gripper's dimensions that the simulation cannot use."""

    page = "docs/howto/own_gripper.md"


class DatasetError(GGCNNError):
    """Grasp data that cannot be read, written or matched to what was asked for."""

    page = "docs/howto/own_data.md"


class TrainingError(GGCNNError):
    """Training that cannot start, go on or be resumed: loss not finite, checkpoint of another run."""

    page = "docs/training.md"


class SearchError(GGCNNError):
    """A search that cannot start or go on: settings, or a folder of another search."""

    page = "docs/howto/long_searches.md"


class ClusterError(GGCNNError):
    """A Dask cluster that cannot be reached, or cannot do the work."""

    page = "docs/cluster.md"


class ResultsError(GGCNNError):
    """A results folder that is damaged or belongs to another experiment."""

    page = "docs/howto/reproduce_table1.md"


class DepthImageError(GGCNNError):
    """A depth image, its unit or its camera's intrinsics that cannot be used."""

    page = "docs/howto/own_camera.md"


class ExportError(GGCNNError):
    """An export that cannot be made, or that does not compute what the Keras model computes."""

    page = "docs/export.md"


class MissingExtraError(GGCNNError):
    """An optional dependency that is not installed; the message names the extra that brings it."""

    page = "docs/export.md"
