"""What is in a model file: architecture, layers, optimizer, lineage, and whether its weights look healthy."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ggcnn_net2net.architecture import architecture_of
from ggcnn_net2net.errors import ArchitectureError, SurgeryError
from ggcnn_net2net.model_files.check import output_names, problems
from ggcnn_net2net.model_files.load import read_model_file, source_path
from ggcnn_net2net.model_files.published import PUBLISHED_SHA256
from ggcnn_net2net.reference_data import sha256_of

if TYPE_CHECKING:
    import keras

# Axis of the filters in the kernels of each layer class.
_FILTER_AXIS = {"Conv2D": 3, "Conv2DTranspose": 2}


@dataclass(frozen=True)
class LayerSummary:
    """One layer; kernel size, filters and strides are None where it has none.

    `index` is the paper's number of the layer, by which operations name it; None where none can be applied.

    `largest_weight` is the greatest magnitude of its weights, None without weights or with NaN or infinity in them.
    `dead_filters` counts filters whose kernel is all zero, `cloned_filters` those that repeat an earlier one exactly.
    """

    name: str
    index: int | None
    class_name: str
    kernel_size: tuple[int, ...] | None
    filters: int | None
    strides: tuple[int, ...] | None
    output_shape: tuple[int | None, ...]
    parameters: int
    largest_weight: float | None
    dead_filters: int
    cloned_filters: int


@dataclass(frozen=True)
class HealthCheck:
    """One check of a model: what was looked for, whether it is as it should be, and what was found."""

    name: str
    ok: bool
    detail: str


@dataclass(frozen=True)
class ModelSummary:
    """A model file at a glance. `problems` lists every reason for which `load_ggcnn` would refuse it."""

    path: str
    size_bytes: int
    sha256: str
    is_published: bool
    format: str
    keras_version: str | None
    architecture: str | None
    architecture_name: str | None
    input_shape: tuple[int | None, ...]
    heads: tuple[str, ...]
    layers: tuple[LayerSummary, ...]
    parameters: int
    multiplications: int | None
    """Of one image, see `Architecture.multiplications`; None where architecture or image size are not known."""
    optimizer: dict[str, Any] | None
    history: list[dict[str, Any]]
    checks: tuple[HealthCheck, ...]
    problems: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values that JSON can hold."""
        return dataclasses.asdict(self)


def model_summary(source: str | Path) -> ModelSummary:
    """Look into a model file.

    Args:
        source: "published", "zoo:NAME" or a path, as for `load_ggcnn`; a model that `load_ggcnn` refuses for its heads
            or weights is summarised all the same.

    Returns:
        Layers, parameters, hash, lineage, and the reasons for which `load_ggcnn` would refuse the file.

    Raises:
        DataNotFoundError: the published file is nowhere.
        VerificationError: the published file, or one of the zoo, has a wrong SHA-256.
        ModelFileError: no such file, damaged, or a model that cannot be rebuilt safely.
    """
    path = source_path(source)
    stored = read_model_file(path)
    model = stored.model
    try:
        architecture = architecture_of(model)
    except ArchitectureError:
        architecture = None
    sha256 = sha256_of(path)
    numbers = _numbers(model)
    layers = tuple(_layer_summary(layer, numbers.get(layer.name)) for layer in model.layers)
    refused_for = tuple(problems(model))
    size = model.inputs[0].shape[1:3]  # a file may hold anything, also a model of no images
    side = size[0] if len(size) == 2 and size[0] == size[1] else None
    return ModelSummary(
        path=str(path),
        size_bytes=path.stat().st_size,
        sha256=sha256,
        is_published=sha256 == PUBLISHED_SHA256,
        format=stored.format,
        keras_version=stored.keras_version,
        architecture=str(architecture) if architecture else None,
        architecture_name=architecture.name if architecture else None,
        input_shape=tuple(model.inputs[0].shape),
        heads=tuple(output_names(model)),
        layers=layers,
        parameters=model.count_params(),
        multiplications=architecture.multiplications(side) if architecture and side else None,
        optimizer=stored.optimizer,
        history=stored.history,
        checks=_health_checks(layers, refused_for),
        problems=refused_for,
    )


def _numbers(model: keras.Model) -> dict[str, int]:
    """The paper's number of each layer that it has one for; empty where no surgery is possible."""
    from ggcnn_net2net.net2net.channels import Channels
    from ggcnn_net2net.net2net.graph import ModelGraph

    try:
        expandable = Channels.of(ModelGraph.of(model)).expandable
    except SurgeryError:
        return {}
    return {name: number for number, name in enumerate(expandable, start=1)}


def _layer_summary(layer: keras.layers.Layer, index: int | None) -> LayerSummary:
    weights = [weight.numpy() for weight in layer.weights]
    largest = max((float(np.abs(array).max()) for array in weights if array.size), default=float("nan"))
    finite = all(np.isfinite(array).all() for array in weights)
    dead, clones = _dead_and_cloned(type(layer).__name__, weights)
    return LayerSummary(
        name=layer.name,
        index=index,
        class_name=type(layer).__name__,
        kernel_size=_pair(layer, "kernel_size"),
        filters=getattr(layer, "filters", None),
        strides=_pair(layer, "strides"),
        output_shape=tuple(layer.output.shape),
        parameters=sum(array.size for array in weights),
        largest_weight=largest if finite and weights else None,
        dead_filters=dead,
        cloned_filters=clones,
    )


def _pair(layer: keras.layers.Layer, attribute: str) -> tuple[int, ...] | None:
    value = getattr(layer, attribute, None)
    return tuple(value) if value is not None else None


def _dead_and_cloned(class_name: str, weights: list[np.ndarray]) -> tuple[int, int]:
    """How many filters are all zero, and how many are an exact copy, bias included, of an earlier one that is not."""
    if class_name not in _FILTER_AXIS or not weights:
        return 0, 0
    kernel = np.moveaxis(weights[0], _FILTER_AXIS[class_name], 0)
    rows = kernel.reshape(len(kernel), -1)
    alive = rows.any(axis=1)
    biases = weights[1:2] or [np.zeros(len(rows), rows.dtype)]
    signatures = np.column_stack([rows, biases[0]])[alive]
    return int((~alive).sum()), len(signatures) - len(np.unique(signatures, axis=0))


def _health_checks(layers: tuple[LayerSummary, ...], refused_for: tuple[str, ...]) -> tuple[HealthCheck, ...]:
    def named(what: str) -> list[str]:
        return [f"{getattr(layer, what)} in {layer.name}" for layer in layers if getattr(layer, what)]

    not_finite = [layer.name for layer in layers if layer.parameters and layer.largest_weight is None]
    dead, clones = named("dead_filters"), named("cloned_filters")
    largest = max(layers, key=lambda layer: layer.largest_weight or 0.0)
    return (
        HealthCheck(
            "a working GG-CNN",
            not refused_for,
            "; ".join(refused_for) or "one depth image in, the four heads in order",
        ),
        HealthCheck(
            "finite weights",
            not not_finite,
            f"NaN or infinity in {', '.join(not_finite)}" if not_finite else "all",
        ),
        HealthCheck(
            "no dead filters",
            not dead,
            f"all-zero kernels: {', '.join(dead)}" if dead else "none is all zero",
        ),
        HealthCheck(
            "no cloned filters",
            not clones,
            f"exact copies of another filter: {', '.join(clones)}" if clones else "no two are equal",
        ),
        HealthCheck("largest weight", True, f"{largest.largest_weight or 0.0:.4g} in {largest.name}"),
    )
