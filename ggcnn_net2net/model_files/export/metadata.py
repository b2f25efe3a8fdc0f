"""What an exported network is, what it takes and gives, and what made it: JSON beside the file."""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ggcnn_net2net._version import __version__
from ggcnn_net2net.architecture import HEADS, architecture_of
from ggcnn_net2net.errors import ArchitectureError, ExportError
from ggcnn_net2net.grasping import RSS_2018
from ggcnn_net2net.model_files.export.formats import Format
from ggcnn_net2net.model_files.export.parity import Parity
from ggcnn_net2net.model_files.export.runtime import INPUT, Job, input_size
from ggcnn_net2net.model_files.load import opened_name
from ggcnn_net2net.net2net.history import history_of
from ggcnn_net2net.reference_data import sha256_of

if TYPE_CHECKING:
    import keras

SUFFIX = ".export.json"
_FORMAT = "ggcnn_net2net export 1"

_PREPROCESSING = (
    "depth in metres along the optical axis, float32 (millimetres divided by 1000)",
    "missing pixels (0 or NaN) filled in from around them (Navier-Stokes inpainting, radius 1)",
    "square crop, resized to the input's height and width",
    "the image's own mean subtracted",
    "clipped to [-1, 1]",
)
_MEANINGS = (
    "grasp quality, 1 at a good grasp",
    "cos 2θ; θ is the closing direction of the jaws from the column axis, counter-clockwise as one sees the image",
    "sin 2θ; θ = atan2(sin_out, cos_out) / 2",
    f"opening of the gripper in pixels of the input, divided by {RSS_2018.width_scale:g}",
)


def metadata_path(path: Path) -> Path:
    """Where the metadata of an exported file or folder stands: NAME.SUFFIX.export.json beside it."""
    return path.with_name(path.name + SUFFIX)


def read_metadata(path: str | Path) -> dict[str, Any]:
    """The metadata of an exported file or folder, `path`.

    Args:
        path: what `export` wrote.

    Returns:
        Plain JSON values: input, preprocessing, outputs, decoding, network, lineage, parity, versions.

    Raises:
        ExportError: it has none that can be read.
    """
    beside = metadata_path(Path(path))
    try:
        return dict(json.loads(beside.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise ExportError(f"expected the metadata of {path} in {beside}, cannot read it: {error}") from error


def metadata(
    export_format: Format, job: Job, files: dict[str, str], source: dict[str, Any], parity: Parity, images: str
) -> dict[str, Any]:
    """What is known of an export, as plain JSON values, the same for the same export.

    Args:
        export_format: the format.
        job: what was written.
        files: name of each file -> its SHA-256.
        source: where the network comes from.
        parity: how the file compares with the Keras model.
        images: where the images of the comparison come from.
    """
    versions = export_format.versions()
    return {
        "metadata": _FORMAT,
        "format": export_format.name,
        "description": export_format.description,
        "quantization": job.quantization,
        "files": files,
        "input": {
            "name": INPUT if export_format.names_input else None,
            "shape": _shape(export_format, job.model),
            "dtype": "float32",
            "unit": "metres minus the image's mean",
        },
        "preprocessing": list(_PREPROCESSING),
        "outputs": [
            {"name": name, "shape": _shape(export_format, job.model), "dtype": "float32", "meaning": meaning}
            for name, meaning in zip(HEADS, _MEANINGS, strict=True)
        ],
        "decoding": {"name": "RSS_2018", **asdict(RSS_2018)},
        "network": {
            "architecture": _architecture(job.model),
            "parameters": job.model.count_params(),
            "weights_sha256": _weights_sha256(job.model),
        },
        "lineage": {"source": source, "operations": history_of(job.model)},
        "parity": {
            **asdict(parity),
            "agreement": parity.agreement,
            "images_from": images,
            "runtime": f"{export_format.runtime} {versions[export_format.runtime]}",
        },
        "versions": {
            "ggcnn_net2net": __version__,
            "python": platform.python_version(),
            **versions,
        },
    }


def hashes(paths: list[Path], root: Path) -> dict[str, str]:
    """SHA-256 of every file of an export, those in folders included, by name relative to `root`."""
    files = [file for path in paths for file in ([path] if path.is_file() else sorted(path.rglob("*")))]
    return {str(file.relative_to(root)): sha256_of(file) for file in files if file.is_file()}


def source_of(model: str | Path | keras.Model, file: Path | None) -> dict[str, Any]:
    """Name and hash of the file that a network was read from; nothing of a model in memory."""
    if file is None:
        return {"name": None, "sha256": None}
    assert isinstance(model, str | Path)
    name = file.name if Path(model).exists() else opened_name(model, file)
    return {"name": name, "sha256": sha256_of(file)}


def _shape(export_format: Format, model: keras.Model) -> list[int | str]:
    batch = "batch" if export_format.any_batch else 1
    return [batch, 1, *input_size(model)] if export_format.channels_first else [batch, *input_size(model), 1]


def _architecture(model: keras.Model) -> str | None:
    """The paper's notation, which relatives of GG-CNN do not have."""
    try:
        return str(architecture_of(model))
    except ArchitectureError:
        return None


def _weights_sha256(model: keras.Model) -> str:
    """Of all weights in order: equal for exports of one network, whatever their format."""
    digest = hashlib.sha256()
    for weight in model.weights:
        digest.update(weight.numpy().tobytes())
    return digest.hexdigest()
