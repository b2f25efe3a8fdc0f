"""Model configurations of every Keras generation, brought into one form and back into that of Keras 2.0.

A configuration is the JSON from which Keras rebuilds the layers of a model. Between Keras 2.0 and Keras 3 its frame
changed (wrapped objects, tensors spelled out, dtype policies) and layers gained keys that other versions reject. The
normal form used here has the frame of Keras 2.0, the key names of Keras 3, and no key that only repeats a default; all
generations understand it, except for what `keras2_config` renames.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.errors import ModelFileError

if TYPE_CHECKING:
    import keras

Config = dict[str, Any]

FUNCTIONAL_CLASSES = ("Model", "Functional")
_NESTED_CLASSES = (*FUNCTIONAL_CLASSES, "Sequential")

# These run code or read other files that the model file names.
_CARRIES_CODE = {
    "Lambda", "__lambda__", "function", "TFOpLambda", "SlicingOpLambda", "TensorFlowOpLayer", "TFSMLayer",
    "TorchModuleWrapper", "JaxLayer", "FlaxLayer", "StringLookup", "IntegerLookup", "TextVectorization",
}  # fmt: skip

# Keys that some Keras generation does not know: part of the class name, key, and the value with which leaving the key
# out changes nothing.
_LATER_KEYS: tuple[tuple[str, str, Any], ...] = (
    ("", "input_axes", None),
    ("", "output_axes", None),
    ("", "quantization_config", None),
    ("BatchNormalization", "renorm", False),
    ("BatchNormalization", "renorm_clipping", None),
    ("BatchNormalization", "renorm_momentum", 0.99),
    ("BatchNormalization", "synchronized", False),
    ("Conv", "groups", 1),
    ("Conv2DTranspose", "dilation_rate", [1, 1]),
    ("Conv2DTranspose", "output_padding", None),
    ("InputLayer", "optional", False),
    ("InputLayer", "ragged", False),
    ("UpSampling2D", "interpolation", "nearest"),
)

_MERGE_LAYERS = {"Add", "Average", "Concatenate", "Dot", "Maximum", "Minimum", "Multiply", "Subtract"}
_POLICIES = {"DTypePolicy", "FloatDTypePolicy", "Policy"}

# Keras before 2.2.5 knows these initializers only as settings of VarianceScaling: scale, mode, distribution.
_VARIANCE_SCALING = {
    "GlorotNormal": (1.0, "fan_avg", "normal"),
    "GlorotUniform": (1.0, "fan_avg", "uniform"),
    "HeNormal": (2.0, "fan_in", "normal"),
    "HeUniform": (2.0, "fan_in", "uniform"),
    "LecunNormal": (1.0, "fan_in", "normal"),
    "LecunUniform": (1.0, "fan_in", "uniform"),
}


def normalised_config(stored: Config) -> Config:
    """Bring the configuration of a functional model into the normal form.

    Args:
        stored: what a model file of any Keras generation holds: class_name and config of the model.

    Returns:
        A dict with name, layers, input_layers and output_layers.

    Raises:
        ModelFileError: not a flat functional model, or something in it could run code.
    """
    refuse_code(stored["config"])  # not what else the file holds: compile_config is never used
    if stored.get("class_name") not in FUNCTIONAL_CLASSES or "output_layers" not in stored["config"]:
        raise ModelFileError(
            f"expected a functional Keras model, received one of class {stored.get('class_name')!r}: rebuild it with "
            "keras.Model(inputs, outputs)"
        )
    config = stored["config"]
    return {
        "name": config["name"],
        "layers": [_layer(layer) for layer in config["layers"]],
        "input_layers": _tensor_list(config["input_layers"]),
        "output_layers": _tensor_list(config["output_layers"]),
    }


def keras2_config(model: keras.Model) -> Config:
    """The configuration of a model in the schema of Keras 2.0, which all later versions read, too."""
    config = normalised_config({"class_name": "Functional", "config": model.get_config()})
    for layer in config["layers"]:
        keys = layer["config"]
        if layer["class_name"] == "LeakyReLU":
            keys["alpha"] = keys.pop("negative_slope")
        if layer["class_name"] != "InputLayer" and keys.get("dtype") == "float32":
            del keys["dtype"]
        layer["config"] = {key: _keras2_initializer(value) for key, value in keys.items()}
    return {"class_name": "Model", "config": config}


def build_model(config: Config) -> keras.Model:
    """Build the model of a configuration in normal form, with fresh weights."""
    import keras  # importing the package must not import TensorFlow

    for layer in config["layers"]:
        layer_class = getattr(keras.layers, layer["class_name"], None)
        if not (isinstance(layer_class, type) and issubclass(layer_class, keras.layers.Layer)):
            raise ModelFileError(
                f"expected layers that are part of Keras {keras.__version__}, received {layer['name']!r} of class "
                f"{layer['class_name']}: custom layers are not loaded; replace it by a standard layer"
            )
    config = copy.deepcopy(config)
    if len(config["input_layers"]) == 1:  # as a list of one, Keras 3 would warn at every call
        config["input_layers"] = config["input_layers"][0]
    # Keras looks for the class of an activation by its module, which the normal form does not have.
    activations = [item for layer in config["layers"] for item in _objects(layer["config"].get("activation"))]
    classes = {item["class_name"]: getattr(keras.layers, str(item["class_name"]), None) for item in activations}
    return keras.Model.from_config(config, custom_objects=classes)


def refuse_code(stored: Any) -> None:
    """Raise a ModelFileError if anything in a stored configuration, at any depth, would run code or is custom."""
    for item in _objects(stored):
        class_name, registered = str(item["class_name"]), str(item.get("registered_name") or "")
        if class_name in _CARRIES_CODE:
            raise ModelFileError(
                f"refused, because it holds a {class_name} object, which would run code or read files that the model "
                "file names: rebuild the model with standard layers"
            )
        if ">" in class_name or ">" in registered:
            raise ModelFileError(
                f"refused, because it holds the custom object {registered or class_name}: rebuild the model with "
                "standard layers"
            )


def _objects(value: Any) -> Iterator[Config]:
    """Every serialised object inside `value`, outer ones first."""
    if isinstance(value, dict):
        if "class_name" in value:
            yield value
        value = list(value.values())
    if isinstance(value, list | tuple):
        for item in value:
            yield from _objects(item)


def _layer(stored: Config) -> Config:
    class_name = stored["class_name"]
    name = stored.get("name") or stored["config"]["name"]
    if class_name in _NESTED_CLASSES:
        raise ModelFileError(
            f"expected a flat model, received one with another model {name!r} inside: apply the inner model's layers "
            "one by one and save it again"
        )
    config = _plain(stored)["config"]
    if "batch_shape" in config:
        config["batch_input_shape"] = config.pop("batch_shape")
    if class_name == "LeakyReLU" and "alpha" in config:
        config["negative_slope"] = config.pop("alpha")
    nodes = [_node(node, class_name, name) for node in stored["inbound_nodes"]]
    return {"name": name, "class_name": class_name, "config": config, "inbound_nodes": nodes}


def _plain(value: Any) -> Any:
    """Serialised objects reduced to class_name and needed keys, dtype policies to their name, tuples to lists."""
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if not isinstance(value, dict):
        return value
    if "class_name" not in value or "config" not in value:
        return {key: _plain(item) for key, item in value.items()}
    class_name, config = value["class_name"], _plain(value["config"])
    if class_name in _POLICIES:
        return config["name"]
    for part, key, default in _LATER_KEYS:
        if part in class_name and key in config and config[key] == default:
            del config[key]
    return {"class_name": class_name, "config": config}


def _node(stored: Any, class_name: str, name: str) -> list[Any]:
    """One call of a layer as Keras 2 writes it: a list of [layer, node, tensor, keyword arguments]."""
    if isinstance(stored, list):
        return stored
    arguments = stored["args"]
    if class_name in _MERGE_LAYERS and len(arguments) == 1:
        arguments = arguments[0]
    histories = [_history_of_tensor(argument) for argument in arguments]
    several = len(histories) > 1 and class_name not in _MERGE_LAYERS
    # Keras 3 notes the default training=False of a call; kept, it would switch Dropout off for good in Keras 2.
    options = {key: value for key, value in stored["kwargs"].items() if value is not None and key != "training"}
    if several or None in histories or any(_objects(options)):
        raise ModelFileError(
            f"expected every layer to be called on the outputs of layers, received other arguments for {name!r} of "
            f"class {class_name}: rebuild the model with standard layers"
        )
    return [[*history, options] for history in histories if history]


def _history_of_tensor(argument: Any) -> list[Any] | None:
    """[layer, node, tensor] of a Keras 3 tensor; None if the argument is no tensor."""
    if not isinstance(argument, dict) or argument.get("class_name") != "__keras_tensor__":
        return None
    return argument["config"]["keras_history"]


def _tensor_list(stored: Any) -> list[Any]:
    """[[layer, node, tensor], ...], also where Keras 3 leaves out the outer list of a single tensor."""
    if isinstance(stored, dict):
        raise ModelFileError(
            f"expected a list of inputs or outputs, received a dictionary with the keys {', '.join(stored)}: rebuild "
            "the model with keras.Model(inputs, [outputs in order])"
        )
    return [stored] if stored and isinstance(stored[0], str) else list(stored)


def _keras2_initializer(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    class_name, config = value.get("class_name"), value.get("config", {})
    if class_name in _VARIANCE_SCALING:
        scale, mode, distribution = _VARIANCE_SCALING[class_name]
    elif class_name == "VarianceScaling":
        scale, mode, distribution = config["scale"], config["mode"], config["distribution"]
    else:
        return value
    # Keras 2.0 has one normal distribution; no matter, since a file brings its weights.
    distribution = "normal" if distribution.endswith("normal") else distribution
    settings = {"scale": scale, "mode": mode, "distribution": distribution, "seed": config.get("seed")}
    return {"class_name": "VarianceScaling", "config": settings}
