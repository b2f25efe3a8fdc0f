"""Networks that the tests of model files share, and files as old versions of Keras wrote them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from ggcnn_net2net.architecture import HEADS, build_ggcnn

SMALL = "C5x5x4_C3x3x3_T3x3x3_T5x5x4"


@pytest.fixture
def small():
    """A GG-CNN of 20x20 pixels with four hidden layers and biases that are not zero."""
    return with_random_weights(build_ggcnn(SMALL, input_size=20))


@pytest.fixture
def relative():
    """A close relative in the manner of GG-CNN2: dilation, pooling, upsampling, normalisation, skips, 1x1 heads."""
    from keras import Input, Model, layers

    inputs = Input((16, 16, 1))
    skip = outputs = layers.Conv2D(4, 3, padding="same", activation="relu")(inputs)
    outputs = layers.MaxPooling2D()(outputs)
    outputs = layers.Conv2D(6, 3, padding="same", dilation_rate=2)(outputs)
    outputs = layers.BatchNormalization()(outputs)
    outputs = layers.LeakyReLU(0.2)(outputs)
    outputs = layers.UpSampling2D()(outputs)
    outputs = layers.Concatenate()([skip, outputs])
    outputs = layers.Conv2DTranspose(4, 3, padding="same", activation="relu")(outputs)
    outputs = layers.Add()([skip, outputs])
    outputs = layers.Dropout(0.1)(outputs)
    return with_random_weights(Model(inputs, [layers.Conv2D(1, 1, name=name)(outputs) for name in HEADS]))


def with_random_weights(model):
    """Give every weight of `model` a positive random value (positive, since some are variances)."""
    rng = np.random.default_rng(5)
    model.set_weights([rng.uniform(0.01, 0.3, weight.shape) for weight in model.get_weights()])
    return model


@pytest.fixture
def maps():
    """Function: the four maps of a model for a fixed random image."""

    def run(model) -> list[np.ndarray]:
        image = np.random.default_rng(0).normal(size=(1, *model.outputs[0].shape[1:3], 1)).astype("float32")
        return [np.asarray(output) for output in model(image)]

    return run


@pytest.fixture
def write_old_file():
    """Function (path, model, version): write a chain of C and T layers with heads as that Keras version did."""
    return _write_old_file


@pytest.fixture
def write_h5():
    """Function (path, model_config, weights by layer, version, training_config): write an HDF5 model file.

    Configuration and weights need not fit.
    """
    return _write_h5


_GLOROT = {"scale": 1.0, "mode": "fan_avg", "distribution": "uniform", "seed": None}
_RMSPROP = {"rho": 0.9, "decay": 0.0, "epsilon": 1e-7}


def _write_old_file(path: Path, model, version: str) -> Path:
    """Write the Keras 3 `model`, a chain of C and T layers with heads, as Keras `version` would have written it."""
    layers = [_layer(layer, version) for layer in model.layers]
    config = {
        "name": "model_1",
        "layers": layers,
        "input_layers": [[model.layers[0].name, 0, 0]],
        "output_layers": [[tensor._keras_history.operation.name, 0, 0] for tensor in model.outputs],
    }
    rate_key = "lr" if version < "2.3" else "learning_rate"
    optimizer = {"class_name": "RMSprop", "config": {rate_key: 0.001, **_RMSPROP}}
    return _write_h5(
        path,
        {"class_name": "Functional" if version >= "2.5" else "Model", "config": config},
        {layer.name: layer.get_weights() for layer in model.layers},
        version,
        {"optimizer_config": optimizer, "loss": "mean_squared_error", "metrics": None},
    )


def _write_h5(
    path: Path, model_config: dict, weights: dict[str, list], version: str = "2.2.4", training: dict | None = None
) -> Path:
    """Write an HDF5 file with the given configuration and weights; they need not fit."""
    with h5py.File(path, "w") as file:
        file.attrs["keras_version"] = version.encode()
        file.attrs["backend"] = b"tensorflow"
        file.attrs["model_config"] = json.dumps(model_config).encode()
        if training is not None:
            file.attrs["training_config"] = json.dumps(training).encode()
        group = file.create_group("model_weights")
        group.attrs["backend"] = b"tensorflow"
        group.attrs["keras_version"] = version.encode()
        group.attrs["layer_names"] = [name.encode() for name in weights]
        for name, arrays in weights.items():
            layer = group.create_group(name)
            names = [f"{name}/{part}:0" for part in ("kernel", "bias", "more", "still_more")[: len(arrays)]]
            layer.attrs["weight_names"] = [weight.encode() for weight in names]
            for weight, array in zip(names, arrays, strict=True):
                layer.create_dataset(weight, data=array)
    return path


def _layer(layer, version: str) -> dict[str, Any]:
    class_name = type(layer).__name__
    if class_name == "InputLayer":
        config = {
            "batch_input_shape": list(layer.batch_shape), "dtype": "float32", "sparse": False, "name": layer.name,
        }  # fmt: skip
        if version >= "2.5":
            config["ragged"] = False
        return {"name": layer.name, "class_name": class_name, "config": config, "inbound_nodes": []}
    source = layer._inbound_nodes[0].input_tensors[0]._keras_history.operation.name
    nodes = [[[source, 0, 0, {}]]]
    config = _convolution(layer, class_name, version)
    return {"name": layer.name, "class_name": class_name, "config": config, "inbound_nodes": nodes}


def _convolution(layer, class_name: str, version: str) -> dict[str, Any]:
    modern = version >= "2.5"
    initializer = {"class_name": "VarianceScaling", "config": _GLOROT}
    config: dict[str, Any] = {
        "name": layer.name,
        "trainable": True,
        "filters": layer.filters,
        "kernel_size": list(layer.kernel_size),
        "strides": list(layer.strides),
        "padding": layer.padding,
        "data_format": "channels_last",
        "dilation_rate": [1, 1],
        "activation": layer.activation.__name__,
        "use_bias": True,
        "kernel_initializer": {"class_name": "GlorotUniform", "config": {"seed": None}} if modern else initializer,
        "bias_initializer": {"class_name": "Zeros", "config": {}},
        "kernel_regularizer": None,
        "bias_regularizer": None,
        "activity_regularizer": None,
        "kernel_constraint": None,
        "bias_constraint": None,
    }
    if version >= "2.3":
        config["dtype"] = "float32"
    if modern:
        config["groups"] = 1
    if class_name == "Conv2DTranspose":
        if version < "2.3":
            del config["dilation_rate"]
        if version >= "2.2":
            config["output_padding"] = None
    return config
