"""LiteRT (`.tflite`), for edge devices: float32, float16 weights, or int8 arithmetic between float32 ends."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.model_files.export.runtime import FLOAT16, INT8, Job, Runtime
from ggcnn_net2net.model_files.export.saved_model import SIGNATURE, save_signature


def write_tflite(job: Job, path: Path) -> None:
    """Convert by way of a SavedModel, whose signature names the outputs."""
    import tensorflow as tf

    with tempfile.TemporaryDirectory() as folder:
        save_signature(job, Path(folder), batch=1)
        converter = tf.lite.TFLiteConverter.from_saved_model(folder, signature_keys=[SIGNATURE])
        if job.quantization is not None:
            converter.optimizations = [tf.lite.Optimize.DEFAULT]
        if job.quantization == FLOAT16:
            converter.target_spec.supported_types = [tf.float16]
        if job.quantization == INT8:

            def images() -> Iterator[list[Any]]:
                return ([image] for image in job.representative)

            converter.representative_dataset = images
            converter.target_spec.supported_ops = [tf.lite.OpsSet.TFLITE_BUILTINS_INT8]
        content = converter.convert()
    path.write_bytes(_ordered(content))


def _ordered(content: bytes) -> bytes:
    """The same network with its outputs in the order of the heads and under their names.

    The converter orders the signature's outputs by name, the graph's by chance, and names tensors after its own inner
    calls; who reads outputs by position would take one map for another.
    """
    from tensorflow.lite.tools import flatbuffer_utils

    network = flatbuffer_utils.convert_bytearray_to_object(bytearray(content))
    graph, signature = network.subgraphs[0], network.signatureDefs[0]
    outputs = {output.name.decode(): output for output in signature.outputs}
    signature.outputs = [outputs[name] for name in HEADS]
    graph.outputs = [output.tensorIndex for output in signature.outputs]
    for end in (*signature.inputs, *signature.outputs):
        graph.tensors[end.tensorIndex].name = end.name
    return bytes(flatbuffer_utils.convert_object_to_bytearray(network))


def open_tflite(path: Path) -> Runtime:
    """Open a file with the LiteRT interpreter."""
    from ai_edge_litert.interpreter import Interpreter

    interpreter = Interpreter(model_path=str(path), num_threads=1)
    interpreter.allocate_tensors()
    (depth,) = interpreter.get_input_details()
    outputs = interpreter.get_output_details()

    def run(image: Any) -> list[Any]:
        interpreter.set_tensor(depth["index"], image)
        interpreter.invoke()
        return [interpreter.get_tensor(output["index"]) for output in outputs]

    return Runtime(tuple(output["name"] for output in outputs), run)
