"""Every error this package raises on purpose.

One tree with `GGCNNError` at the top, so `except GGCNNError` catches all of them and nothing else. A message says
what was expected, what was received and what to do about it.
"""

from __future__ import annotations


class GGCNNError(Exception):
    """Base of all errors of ggcnn_net2net."""


class ArchitectureError(GGCNNError):
    """An architecture string, or a model, that does not describe a GG-CNN."""


class SurgeryError(GGCNNError):
    """A Net2Net operation that cannot be applied: no such layer, or one that cannot be changed without loss."""


class ModelFileError(GGCNNError):
    """A model file that cannot be read, is damaged, or does not hold a GG-CNN."""


class DataNotFoundError(GGCNNError):
    """Reference data (weights, objects) that is nowhere to be found and cannot be fetched."""


class VerificationError(GGCNNError):
    """A file whose content is not what was published: wrong SHA-256, or a mesh of the wrong shape."""


class GraspError(GGCNNError):
    """Grasp maps or grasp rectangles with an impossible shape or value."""


class ObjectSetError(GGCNNError):
    """An object set, mesh or CSV that cannot be used in the simulation."""


class SceneError(GGCNNError):
    """Scenes that cannot be made, read or matched to what was asked for."""


class SimulationError(GGCNNError):
    """The physics simulation could not do what was asked."""


class DatasetError(GGCNNError):
    """Grasp data that cannot be read, written or matched to what was asked for."""


class TrainingError(GGCNNError):
    """Training that cannot start, go on or be resumed: loss not finite, checkpoint of another run."""


class SearchError(GGCNNError):
    """A search that cannot start or go on: settings, or a folder of another search."""


class ResultsError(GGCNNError):
    """A results folder that is damaged or belongs to another experiment."""


class DepthImageError(GGCNNError):
    """A depth image, its unit or its camera's intrinsics that cannot be used."""


class ExportError(GGCNNError):
    """An export that cannot be made, or that does not compute what the Keras model computes."""


class MissingExtraError(GGCNNError):
    """An optional dependency that is not installed; the message names the extra that brings it."""
