"""OpenVINO's intermediate representation: NAME.xml with the graph and NAME.bin with the weights."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from ggcnn_net2net.model_files.export.onnx_file import write_onnx
from ggcnn_net2net.model_files.export.runtime import FLOAT16, INPUT, Job, Runtime, input_size

_NUMBERED = ("Constant", "ConvolutionBackpropData")
"""Operations that OpenVINO names after a counter of the process; the same network is to give the same file."""


def write_openvino(job: Job, path: Path) -> None:
    """Write both files, for one image at a time: fixed shapes are what OpenVINO compiles best."""
    import openvino
    from openvino.passes import ConstantFolding, Manager

    with tempfile.TemporaryDirectory() as folder:
        onnx_path = Path(folder) / "network.onnx"
        write_onnx(job, onnx_path)
        network = openvino.Core().read_model(onnx_path)
        network.reshape({INPUT: [1, *input_size(job.model), 1]})
        folding = Manager()  # what was computed from the shapes is constant now
        folding.register_pass(ConstantFolding())
        folding.run_passes(network)
        for number, operation in enumerate(network.get_ordered_ops()):
            if operation.get_type_name() in _NUMBERED:
                operation.set_friendly_name(f"{operation.get_type_name()}_{number}")
        openvino.save_model(network, path, compress_to_fp16=job.quantization == FLOAT16)


def open_openvino(path: Path) -> Runtime:
    """Compile the files for the CPU. In float32: newer processors would round to bfloat16 of their own accord."""
    import openvino

    network = openvino.Core().compile_model(path, "CPU", {"INFERENCE_PRECISION_HINT": "f32", "NUM_STREAMS": "1"})

    def run(image: Any) -> list[Any]:
        maps = network({INPUT: image})
        return [maps[output] for output in network.outputs]

    return Runtime(tuple(output.get_any_name() for output in network.outputs), run)
