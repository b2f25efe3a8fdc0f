"""The formats: suffix, what each can do, who writes it, who runs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

from ggcnn_net2net.errors import ExportError, MissingExtraError
from ggcnn_net2net.model_files.export import keras_files, litert, onnx_file, openvino_ir, saved_model, torch_state_dict
from ggcnn_net2net.model_files.export.runtime import FLOAT16, INT8, Job, Runtime


@dataclass(frozen=True)
class Format:
    """One format of exported networks."""

    name: str
    suffixes: tuple[str, ...]
    """Of its files; the first is the usual one. Empty: a folder."""
    description: str
    write: Callable[[Job, Path], None]
    open: Callable[[Path], Runtime]
    runtime: str
    """Python module of the software that runs it."""
    writers: tuple[str, ...] = ()
    """Python modules that writing it needs."""
    quantizations: tuple[str, ...] = ()
    any_batch: bool = True
    """Whether it takes any number of images; otherwise one."""
    names_input: bool = True
    """Whether the input is called "depth"; in Keras' files it has the name of its layer, in a state_dict none."""
    channels_first: bool = False
    """Whether the images are (batch, 1, H, W) instead of (batch, H, W, 1)."""

    def require(self) -> None:
        """Raise a MissingExtraError if a module that this format needs cannot be imported."""
        for name in (*self.writers, self.runtime):
            try:
                import_module(name)
            except ImportError as error:
                raise MissingExtraError(
                    f"the format {self.name} needs {name}, which cannot be imported ({error}): "
                    "pip install 'ggcnn_net2net[export]'"
                ) from error

    def versions(self) -> dict[str, str]:
        """Versions of what writes and runs it, by module."""
        return {name: _version(name) for name in ("tensorflow", "keras", "numpy", *self.writers, self.runtime)}


def _version(module: str) -> str:
    """Of a module itself where it tells: TensorFlow's package has another name than its module."""
    full = str(getattr(import_module(module), "__version__", None) or version(module))
    return full.split("-", maxsplit=1)[0]  # OpenVINO adds its build


FORMATS = {
    export_format.name: export_format
    for export_format in (
        Format(
            "keras",
            (".keras",),
            "Keras 3 archive",
            keras_files.write_keras,
            keras_files.open_keras3,
            runtime="keras",
            names_input=False,
        ),
        Format(
            "hdf5",
            (".hdf5", ".h5"),
            "Keras 2 HDF5",
            keras_files.write_keras,
            keras_files.open_keras2,
            runtime="tf_keras",
            names_input=False,
        ),
        Format(
            "savedmodel",
            (),
            "TensorFlow SavedModel, signature serving_default",
            saved_model.write_saved_model,
            saved_model.open_saved_model,
            runtime="tensorflow",
        ),
        Format(
            "tflite",
            (".tflite",),
            "LiteRT flatbuffer",
            litert.write_tflite,
            litert.open_tflite,
            runtime="ai_edge_litert",
            quantizations=(FLOAT16, INT8),
            any_batch=False,
        ),
        Format(
            "onnx",
            (".onnx",),
            "ONNX",
            onnx_file.write_onnx,
            onnx_file.open_onnx,
            runtime="onnxruntime",
            writers=("onnx",),
        ),
        Format(
            "openvino",
            (".xml",),
            "OpenVINO IR",
            openvino_ir.write_openvino,
            openvino_ir.open_openvino,
            runtime="openvino",
            writers=("onnx",),
            quantizations=(FLOAT16,),
            any_batch=False,
        ),
        Format(
            "pytorch",
            (".pt", ".pth"),
            "PyTorch state_dict of class GGCNN",
            torch_state_dict.write_torch,
            torch_state_dict.open_torch,
            runtime="keras",
            names_input=False,
            channels_first=True,
        ),
    )
}


def format_of(path: Path) -> Format:
    """The format that a path's suffix means.

    Raises:
        ExportError: none.
    """
    for export_format in FORMATS.values():
        if path.suffix in export_format.suffixes or not (path.suffix or export_format.suffixes):
            return export_format
    known = ", ".join(suffix for export_format in FORMATS.values() for suffix in export_format.suffixes)
    raise ExportError(
        f"expected a path with one of the suffixes {known}, or with none for a SavedModel folder, received "
        f"{str(path)!r}"
    )


def check_quantization(export_format: Format, quantization: str | None) -> None:
    """Raise an ExportError if a format cannot be quantized as asked for."""
    if quantization is None or quantization in export_format.quantizations:
        return
    able = [f"{other.name} ({', '.join(other.quantizations)})" for other in FORMATS.values() if other.quantizations]
    raise ExportError(
        f"expected quantization only where the format has it: {', '.join(able)}; received {quantization!r} for "
        f"{export_format.name}"
    )
