"""The GG-CNN that its authors retrained in PyTorch, as a Keras model with the same outputs.

PyTorch pads both sides of an image alike and cuts a transposed convolution by `padding` on one side and
`padding - output_padding` on the other. Keras' 'same' puts the odd pixel on the other side, so it would shift the maps.
Hence explicit ZeroPadding2D and Cropping2D layers around 'valid' convolutions, as `padding` and `output_padding` say.

Kernel sizes, strides and paddings: class GGCNN in models/ggcnn.py of github.com/dougsm/ggcnn.
"""

from __future__ import annotations

from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ggcnn_net2net.architecture import HEADS, INPUT_SIZE
from ggcnn_net2net.errors import ExportError, ModelFileError
from ggcnn_net2net.model_files.stored_model import StoredModel
from ggcnn_net2net.model_files.torch_tensors import read_state_dict

if TYPE_CHECKING:
    import keras

SUFFIXES = (".pt", ".pth")


class _TorchLayer(NamedTuple):
    torch_name: str
    keras_name: str
    channels: tuple[int, int]  # in, out
    kernel: int
    stride: int
    padding: int
    output_padding: int | None = None  # None: not transposed


_BODY = (
    _TorchLayer("conv1", "conv2d_1", (1, 32), 9, 3, 3),
    _TorchLayer("conv2", "conv2d_2", (32, 16), 5, 2, 2),
    _TorchLayer("conv3", "conv2d_3", (16, 8), 3, 2, 1),
    _TorchLayer("convt1", "conv2d_transpose_1", (8, 8), 3, 2, 1, 1),
    _TorchLayer("convt2", "conv2d_transpose_2", (8, 16), 5, 2, 2, 1),
    _TorchLayer("convt3", "conv2d_transpose_3", (16, 32), 9, 3, 3, 1),
)
_HEADS = tuple(_TorchLayer(name.replace("_out", "_output"), name, (32, 1), 2, 1, 0) for name in HEADS)


def read_torch(path: Path, input_size: int = INPUT_SIZE) -> StoredModel:
    """Read a state_dict of PyTorch's GG-CNN, for images of `input_size`; PyTorch need not be installed.

    Raises:
        ModelFileError: damaged, not a plain state_dict, or not one of this network.
    """
    tensors = read_state_dict(path)
    _check_shapes(tensors)
    model = build_torch_ggcnn(input_size)
    for layer in (*_BODY, *_HEADS):
        # (out, in, h, w) -> (h, w, in, out), and (in, out, h, w) of a transposed convolution -> (h, w, out, in).
        kernel = tensors[f"{layer.torch_name}.weight"].transpose(2, 3, 1, 0)
        model.get_layer(layer.keras_name).set_weights([kernel, tensors[f"{layer.torch_name}.bias"]])
    return StoredModel(model=model, format="PyTorch state_dict", keras_version=None)


def build_torch_ggcnn(input_size: int = INPUT_SIZE) -> keras.Model:
    """An untrained GG-CNN with the padding of the PyTorch implementation; `input_size` is a multiple of 12."""
    import keras  # importing the package must not import TensorFlow

    inputs = outputs = keras.Input((input_size, input_size, 1), name="input_1")
    for number, layer in enumerate(_BODY, start=1):
        options = {"strides": layer.stride, "activation": "relu", "name": layer.keras_name}
        if layer.output_padding is None:
            outputs = keras.layers.ZeroPadding2D(layer.padding, name=f"zero_padding2d_{number}")(outputs)
            outputs = keras.layers.Conv2D(layer.channels[1], layer.kernel, **options)(outputs)
        else:
            outputs = keras.layers.Conv2DTranspose(layer.channels[1], layer.kernel, **options)(outputs)
            cut = (layer.padding, layer.padding - layer.output_padding)
            outputs = keras.layers.Cropping2D((cut, cut), name=f"cropping2d_{number - 3}")(outputs)
    heads = [keras.layers.Conv2D(1, head.kernel, name=head.keras_name)(outputs) for head in _HEADS]
    return keras.Model(inputs, heads, name="ggcnn_pytorch")


def _check_shapes(tensors: dict[str, np.ndarray]) -> None:
    expected: dict[str, tuple[int, ...]] = {}
    for layer in (*_BODY, *_HEADS):
        n_in, n_out = layer.channels
        first = (n_out, n_in) if layer.output_padding is None else (n_in, n_out)
        expected[f"{layer.torch_name}.weight"] = (*first, layer.kernel, layer.kernel)
        expected[f"{layer.torch_name}.bias"] = (n_out,)
    received = {name: tensor.shape for name, tensor in tensors.items()}
    wrong = [
        f"{name} {received.get(name, 'missing')} instead of {expected.get(name, 'nothing')}"
        for name in {**expected, **received}
        if expected.get(name) != received.get(name)
    ]
    if wrong:
        raise ModelFileError(
            "expected the 20 tensors of class GGCNN in models/ggcnn.py of github.com/dougsm/ggcnn for "
            f"one-channel depth images, received {', '.join(wrong)}: other PyTorch networks are not converted"
        )


def torch_tensors_of(model: keras.Model) -> dict[str, np.ndarray]:
    """The state_dict with which class GGCNN computes what `model` computes: the inverse of `read_torch`.

    Raises:
        ExportError: no such state_dict exists. Class GGCNN has fixed sizes, and it pads an image of even size by one
            pixel more above and on the left than Keras' 'same' does where the stride is 2. No weights make up for
            that: the outermost taps of the shifted kernels would fall outside of PyTorch's.
    """
    expected, received = _steps(build_torch_ggcnn()), _steps(model)
    if received != expected:
        wrong = next(step for step in zip_longest(received, expected) if step[0] != step[1])
        raise ExportError(
            f"expected the layers of class GGCNN of github.com/dougsm/ggcnn, received {wrong[0]} instead of {wrong[1]} "
            "as the first that differs: its filters are fixed, and where the stride is 2 it pads one pixel more above "
            "and on the left than Keras' 'same' does, so that no weights give equal maps. Networks read from a .pt "
            "file, trained further or not, can be written; export others to onnx"
        )
    layers = [layer for layer in model.layers if layer.weights and layer.name not in HEADS]
    layers += [model.get_layer(name) for name in HEADS]
    tensors = {}
    for torch_layer, layer in zip((*_BODY, *_HEADS), layers, strict=True):
        kernel, bias = layer.get_weights()
        tensors[f"{torch_layer.torch_name}.weight"] = kernel.transpose(3, 2, 0, 1)
        tensors[f"{torch_layer.torch_name}.bias"] = bias
    return tensors


def _steps(model: keras.Model) -> list[str]:
    """What each layer does, in order: class, and the settings on which its result depends."""
    keys = ("filters", "kernel_size", "strides", "padding", "cropping", "dilation_rate", "activation", "use_bias")
    return [
        f"{type(layer).__name__}({', '.join(f'{key}={config[key]}' for key in keys if key in config)})"
        for layer in model.layers
        for config in [layer.get_config()]
        if type(layer).__name__ != "InputLayer"
    ]
