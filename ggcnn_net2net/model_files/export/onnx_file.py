"""ONNX files, written layer by layer (`onnx_layers`) with the channels last, as the other formats have them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ggcnn_net2net._version import __version__
from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.errors import ExportError, SurgeryError
from ggcnn_net2net.model_files.export.onnx_layers import WRITERS, OnnxGraph
from ggcnn_net2net.model_files.export.runtime import INPUT, Job, Runtime, input_size
from ggcnn_net2net.net2net.graph import ModelGraph

OPSET = 17
IR_VERSION = 8
"""With opset 17, that of ONNX 1.12 and ONNX Runtime 1.13 (2022): a later one would lock out what robots run."""


def write_onnx(job: Job, path: Path) -> None:
    """Write the file; it takes any number of images.

    Raises:
        ExportError: a layer for which there is no writer, or one that is called several times.
    """
    import onnx
    from onnx import TensorProto, helper

    try:
        layers = ModelGraph.of(job.model)
    except SurgeryError as error:
        raise ExportError(f"cannot write this network as ONNX: {error}") from error
    graph = OnnxGraph()
    tensors: dict[str, str] = {}  # layer -> its output, channels first
    for name, layer in layers.layers.items():
        kind = type(layer).__name__
        if kind == "InputLayer":
            tensors[name] = graph.add_layer("Transpose", [INPUT], layer, perm=[0, 3, 1, 2])
        elif kind in WRITERS:
            tensors[name] = WRITERS[kind](graph, layer, [tensors[source] for source in layers.sources[name]])
        else:
            raise ExportError(
                f"expected layers of the classes {', '.join(WRITERS)}, received {name!r} of class {kind}: export to "
                "keras, savedmodel or tflite, which take every layer"
            )
    for name in HEADS:
        graph.add("Transpose", [tensors[name]], name, perm=[0, 2, 3, 1])
    shape: list[str | int] = ["batch", *input_size(job.model), 1]
    network = helper.make_model(
        helper.make_graph(
            graph.nodes,
            "ggcnn",
            [helper.make_tensor_value_info(INPUT, TensorProto.FLOAT, shape)],
            [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name in HEADS],
            graph.constants,
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="ggcnn_net2net",
        producer_version=__version__,
    )
    onnx.checker.check_model(network, full_check=True)
    path.write_bytes(network.SerializeToString(deterministic=True))


def open_onnx(path: Path) -> Runtime:
    """Open a file with ONNX Runtime on the CPU."""
    import onnxruntime

    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]

    def run(image: Any) -> list[Any]:
        return list(session.run(names, {INPUT: image}))

    return Runtime(tuple(names), run)
