"""Export: write, run, compare, and only then move into place."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ggcnn_net2net.architecture import INPUT_SIZE
from ggcnn_net2net.atomic import is_one_of
from ggcnn_net2net.errors import ExportError, GGCNNError
from ggcnn_net2net.model_files.check import check_ggcnn
from ggcnn_net2net.model_files.export.formats import Format, check_quantization, format_of
from ggcnn_net2net.model_files.export.metadata import hashes, metadata, metadata_path, source_of
from ggcnn_net2net.model_files.export.parity import Maps, Parity, check, compare
from ggcnn_net2net.model_files.export.placing import placing
from ggcnn_net2net.model_files.export.runtime import INT8, Image, Job, input_size
from ggcnn_net2net.model_files.export.samples import Depth, default_samples, network_inputs
from ggcnn_net2net.model_files.load import load_ggcnn, source_path
from ggcnn_net2net.net2net.history import history_of, set_history
from ggcnn_net2net.quiet import import_tensorflow, silence_output

if TYPE_CHECKING:
    import keras


def export(
    model: str | Path | keras.Model,
    path: str | Path,
    *,
    quantization: str | None = None,
    representative: Depth | None = None,
    samples: Depth | None = None,
) -> Path:
    """Write a GG-CNN in a format that a grasp stack loads, if the written file computes the same maps.

    The file is written to a temporary place, run there by its own runtime, compared with the Keras model on depth
    images, and then moved into place with its metadata, NAME.SUFFIX.export.json (see `read_metadata`). Maps may differ
    by 1e-4, with float16 by 0.02 (of the largest value of the map, or of 1); with int8 the best grasp has to be the
    same on half of the images, and the metadata tell on how many it is.

    Every format takes (batch, H, W, 1) float32 depth in metres minus the image's mean, and gives pos_out, cos_out,
    sin_out and width_out in this order. H and W are those of the network, 300 for one that takes any size; LiteRT and
    OpenVINO take one image at a time; PyTorch has the channels first.

    Args:
        model: the network, or what `load_ggcnn` takes: a path, "published" or "zoo:NAME".
        path: where to; the suffix chooses the format. .keras: Keras 3. .hdf5, .h5: Keras 2. None: a SavedModel folder.
            .tflite: LiteRT. .onnx: ONNX. .xml: OpenVINO IR, with the weights in .bin beside it. .pt, .pth: state_dict
            of class GGCNN of github.com/dougsm/ggcnn, only for networks with its layers and its padding.
        quantization: "float16" (weights; .tflite, .xml) or "int8" (.tflite).
        representative: for int8, (n, H, W) depth images in metres like those of use; a hundred are plenty.
        samples: (n, H, W) depth images in metres on which file and model are compared. None: 8 Cornell scenes where the
            folder of the reference data has them, 4 simulated scenes otherwise.

    Returns:
        The path.

    Raises:
        ExportError: unknown suffix, a quantization that the format does not have, a network that it cannot hold, or a
            file that does not compute what the model computes. Nothing is left behind, and what stood there stays.
        MissingExtraError: what writes or runs the format is not installed.
        DepthImageError: images of another size, or not finite.
        ModelFileError, DataNotFoundError, VerificationError: as `load_ggcnn`; NaN weights among them.
    """
    path = Path(path)
    export_format = format_of(path)
    check_quantization(export_format, quantization)
    if (quantization == INT8) != (representative is not None):
        raise ExportError(
            "expected representative depth images (--representative) with int8, and only with it; received "
            f"{'none' if representative is None else 'some'} with {quantization or 'no quantization'}"
        )
    import_tensorflow()
    file = source_path(model) if isinstance(model, str | Path) else None
    check_target(path, file)
    network = _with_one_size(_checked(model if file is None else file))
    size = input_size(network)
    images, images_from = (samples, "the caller") if samples is not None else default_samples(size)
    inputs = network_inputs(images, size, "samples")
    calibration = [] if representative is None else network_inputs(representative, size, "representative images")
    job = Job(network, quantization, calibration)
    beside = metadata_path(path)
    with placing(path.parent, last=beside.name) as folder:
        parity = _write_and_compare(export_format, job, folder / path.name, inputs)
        files = hashes(sorted(folder.iterdir()), folder)
        facts = metadata(export_format, job, files, source_of(model, file), parity, images_from)
        (folder / beside.name).write_text(json.dumps(facts, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


_NETWORKS = (".keras", ".hdf5", ".h5", ".pt", ".pth")
"""Suffixes that a network's own file has, too."""


def _write_and_compare(export_format: Format, job: Job, path: Path, inputs: list[Image]) -> Parity:
    expected = _keras_maps(job.model, inputs)
    try:
        with _quiet():
            export_format.write(job, path)
            parity = compare(export_format.open(path), inputs, expected)
    except GGCNNError:
        raise
    except Exception as error:  # converters and runtimes raise anything
        raise ExportError(f"cannot export this network as {export_format.description}: {error!r}") from error
    check(parity, expected, job.quantization)
    return parity


def _keras_maps(model: keras.Model, inputs: list[Image]) -> list[Maps]:
    """(4, H, W) for each image, from the four-headed model itself and none of its rewritings."""
    return [np.stack([np.asarray(head)[0, ..., 0] for head in model(image, training=False)]) for image in inputs]


def _checked(model: str | Path | keras.Model) -> keras.Model:
    if isinstance(model, str | Path):
        return load_ggcnn(model)
    check_ggcnn(model)
    return model


def _with_one_size(model: keras.Model) -> keras.Model:
    """The network itself, or for one that takes images of any size, the same for those of GG-CNN."""
    import keras

    if None not in model.inputs[0].shape[1:3]:
        return model
    inputs = keras.Input((INPUT_SIZE, INPUT_SIZE, 1))
    fixed = keras.models.clone_model(model, input_tensors=inputs)
    fixed.set_weights(model.get_weights())
    set_history(fixed, history_of(model))
    return fixed


def check_target(path: Path, source: Path | None) -> None:
    """Refuse to replace what is not an export: a folder of other things, the network's own file, or another network.

    Args:
        path: of the export to come; its suffix tells the format.
        source: the network's own file, if it has one.

    Raises:
        ExportError: something else is there.
        MissingExtraError: what writes or runs the format is not installed.
    """
    export_format = format_of(path)
    with _quiet():
        export_format.require()
    if is_one_of(path, [source]):
        raise ExportError(f"expected another path than the network's own file, received {str(path)!r} for both")
    if path.suffix in _NETWORKS and path.is_file() and not metadata_path(path).is_file():
        raise ExportError(
            f"expected a new file, or an export to replace, received {str(path)!r}, which may be a network that was "
            "trained: name another"
        )
    if export_format.suffixes and path.is_dir():
        raise ExportError(f"expected a file to write, received {str(path)!r}, which is a folder")
    if not export_format.suffixes and path.exists() and not (path / "saved_model.pb").is_file():
        raise ExportError(
            f"expected a new folder, or a SavedModel to replace, received {str(path)!r}, which is neither: name another"
        )


@contextmanager
def _quiet() -> Iterator[None]:
    """Neither log lines nor warnings of converters and runtimes: what matters in them is raised by the comparison."""
    before = logging.root.manager.disable
    logging.disable(logging.ERROR)
    try:
        with warnings.catch_warnings(), silence_output():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
