"""What is no GG-CNN, damaged or dangerous is refused with an error that says why."""

from __future__ import annotations

import contextlib
import json
import zipfile

import h5py
import numpy as np
import pytest

from ggcnn_net2net.architecture import HEADS, build_ggcnn
from ggcnn_net2net.errors import GGCNNError, ModelFileError, VerificationError
from ggcnn_net2net.model_files import check_ggcnn, load_ggcnn

CODE = pytest.mark.parametrize("suffix", [".h5", ".keras"])


def stored_config(path) -> dict:
    with h5py.File(path) as file:
        return json.loads(file.attrs["model_config"])


def weights_of(model) -> dict:
    return {layer.name: layer.get_weights() for layer in model.layers}


@pytest.fixture
def old_file(small, write_old_file, tmp_path):
    return write_old_file(tmp_path / "old.hdf5", small, "2.2.4")


@pytest.fixture
def keras_file(small, tmp_path):
    small.save(tmp_path / "model.keras")
    return tmp_path / "model.keras"


def refused(path, *words: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        load_ggcnn(path)
    for word in words:
        assert word in str(caught.value)


def test_missing_file(tmp_path):
    refused(tmp_path / "none.hdf5", "none.hdf5", "no file")


def test_folder(tmp_path):
    refused(tmp_path, "no file")


@pytest.mark.parametrize("name", ["model.json", "model.tflite", "model"])
def test_wrong_suffix(name, tmp_path):
    (tmp_path / name).write_bytes(b"x")
    refused(tmp_path / name, ".hdf5", ".keras", ".pt", name)


@pytest.mark.parametrize("kept", [0, 7, 300, 0.4, 0.9, 0.999])
def test_truncated_hdf5(kept, old_file):
    content = old_file.read_bytes()
    old_file.write_bytes(content[: kept if isinstance(kept, int) else int(kept * len(content))])
    refused(old_file, "damaged or truncated")


@pytest.mark.parametrize("kept", [0, 40, 0.5, 0.99])
def test_truncated_keras_archive(kept, keras_file):
    content = keras_file.read_bytes()
    keras_file.write_bytes(content[: kept if isinstance(kept, int) else int(kept * len(content))])
    refused(keras_file, "damaged or truncated")


@pytest.mark.parametrize("position", [0.3, 0.5, 0.7])
def test_flipped_bytes_in_a_keras_archive(position, keras_file):
    content = bytearray(keras_file.read_bytes())
    start = int(position * len(content))
    for index in range(start, start + 8):
        content[index] ^= 0xFF
    keras_file.write_bytes(content)
    refused(keras_file, "damaged")


@pytest.mark.parametrize("member", ["config.json", "metadata.json", "model.weights.h5"])
def test_member_missing_in_a_keras_archive(member, keras_file, tmp_path):
    with zipfile.ZipFile(keras_file) as source, zipfile.ZipFile(tmp_path / "part.keras", "w") as target:
        for name in source.namelist():
            if name != member:
                target.writestr(name, source.read(name))
    refused(tmp_path / "part.keras", member)


@pytest.mark.parametrize("content", [b"{}", b"null", b"not json", b'{"class_name": "Functional", "config": {}}'])
def test_nonsense_configuration(content, old_file, keras_file, tmp_path):
    with h5py.File(old_file, "r+") as file:
        file.attrs["model_config"] = content
    refused(old_file, "old.hdf5")
    with zipfile.ZipFile(keras_file) as source, zipfile.ZipFile(tmp_path / "odd.keras", "w") as target:
        for name in source.namelist():
            target.writestr(name, content if name == "config.json" else source.read(name))
    refused(tmp_path / "odd.keras", "odd.keras")


def test_weights_only_file(small, tmp_path):
    small.save_weights(tmp_path / "some.weights.h5")
    refused(tmp_path / "some.weights.h5", "model_config", "save_weights")


@CODE
def test_missing_head(suffix, small, tmp_path):
    import keras

    keras.Model(small.inputs, small.outputs[:3]).save(tmp_path / f"three{suffix}")
    refused(tmp_path / f"three{suffix}", "missing width_out")


@CODE
def test_reordered_heads(suffix, small, tmp_path):
    import keras

    keras.Model(small.inputs, [small.outputs[i] for i in (0, 2, 1, 3)]).save(tmp_path / f"order{suffix}")
    refused(tmp_path / f"order{suffix}", "pos_out, sin_out, cos_out, width_out", "in this order")


def test_named_outputs(small, tmp_path):
    import keras

    keras.Model(small.inputs, dict(zip(HEADS, small.outputs, strict=True))).save(tmp_path / "named.keras")
    refused(tmp_path / "named.keras", "list of inputs or outputs")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"filters": 2}, "map of the input's size (8, 8, 1), received (8, 8, 2)"),
        ({"activation": "sigmoid"}, "activation sigmoid"),
        ({"padding": "valid"}, "map of the input's size"),
        ({"strides": 2}, "map of the input's size"),
    ],
)
def test_heads_of_the_wrong_shape(options, message, tmp_path):
    from keras import Input, Model, layers

    inputs = Input((8, 8, 1))
    usual = {"filters": 1, "kernel_size": 2, "padding": "same"}
    heads = [layers.Conv2D(**{**usual, **(options if name == "cos_out" else {})}, name=name)(inputs) for name in HEADS]
    Model(inputs, heads).save(tmp_path / "head.keras")
    refused(tmp_path / "head.keras", "cos_out", message)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@CODE
def test_weights_that_are_not_finite(suffix, bad, small, tmp_path):
    layer = small.get_layer("conv2d_transpose_1")
    kernel, bias = layer.get_weights()
    kernel[1, 0, 2, 1] = bad
    layer.set_weights([kernel, bias])
    small.save(tmp_path / f"bad{suffix}")
    refused(tmp_path / f"bad{suffix}", "NaN or infinity", "conv2d_transpose_1/kernel")


@CODE
def test_dense_classifier(suffix, tmp_path):
    from keras import Input, Model, Sequential, layers

    inputs = Input((8, 8, 1))
    outputs = layers.Dense(10, activation="softmax")(layers.Flatten()(inputs))
    Model(inputs, outputs).save(tmp_path / f"dense{suffix}")
    refused(tmp_path / f"dense{suffix}", "four heads", "pos_out")
    Sequential([Input((4,)), layers.Dense(2)]).save(tmp_path / f"sequential{suffix}")
    refused(tmp_path / f"sequential{suffix}", "functional", "Sequential")


def test_colour_images_are_not_depth_images(tmp_path):
    from keras import Input, Model, layers

    inputs = Input((8, 8, 3))
    Model(inputs, [layers.Conv2D(1, 2, padding="same", name=name)(inputs) for name in HEADS]).save(
        tmp_path / "rgb.keras"
    )
    refused(tmp_path / "rgb.keras", "one input", "(None, 8, 8, 3)")


def test_subclassed_models_are_refused_before_saving(tmp_path):
    import keras

    from ggcnn_net2net.model_files import save_ggcnn

    class Custom(keras.Model):
        pass

    with pytest.raises(ModelFileError, match="functional"):
        check_ggcnn(Custom())
    with pytest.raises(ModelFileError, match="functional"):
        save_ggcnn(Custom(), tmp_path / "custom.keras")


def test_weights_of_another_shape(small, old_file, write_h5, tmp_path):
    weights = weights_of(small)
    weights["conv2d_2"][0] = weights["conv2d_2"][0][..., :2]
    refused(write_h5(tmp_path / "odd.h5", stored_config(old_file), weights), "conv2d_2", "shapes")


def test_weights_missing(small, old_file, write_h5, tmp_path):
    weights = weights_of(small)
    del weights["sin_out"]
    refused(write_h5(tmp_path / "few.h5", stored_config(old_file), weights), "sin_out", "shapes")


@pytest.mark.parametrize("name", ["conv2d_9", "conv2d_1"])
def test_weights_left_over(name, small, old_file, write_h5, tmp_path):
    weights = weights_of(small)
    weights[name] = [*weights.get(name, []), np.zeros(3)]
    refused(write_h5(tmp_path / "many.h5", stored_config(old_file), weights), name)


@pytest.mark.parametrize("other", ["C5x5x4_C3x3x3_T3x3x3_T5x5x5", "C5x5x4_T5x5x4"])
def test_weights_and_configuration_of_different_archives(other, small, keras_file, tmp_path):
    build_ggcnn(other, 20).save(tmp_path / "other.keras")
    for config, weights in ((keras_file, tmp_path / "other.keras"), (tmp_path / "other.keras", keras_file)):
        with (
            zipfile.ZipFile(config) as one,
            zipfile.ZipFile(weights) as two,
            zipfile.ZipFile(tmp_path / "mixed.keras", "w") as target,
        ):
            for name in one.namelist():
                target.writestr(name, (two if name == "model.weights.h5" else one).read(name))
        refused(tmp_path / "mixed.keras", "weights")


def test_theano_kernels(old_file):
    with h5py.File(old_file, "r+") as file:
        file["model_weights"].attrs["backend"] = b"theano"
    refused(old_file, "Theano", "mirrored")


def lambda_layer(proof) -> dict:
    """A Lambda layer, as the old format spells it, whose code would write the file `proof`."""
    import base64
    import marshal

    source = f"open({str(proof)!r}, 'w').close() or x"
    code = base64.b64encode(marshal.dumps(compile(source, "x", "eval"))).decode()
    config = {"name": "evil", "trainable": True, "function": [code, None, None], "function_type": "lambda",
              "output_shape": None, "output_shape_type": "raw", "arguments": {}}  # fmt: skip
    return {
        "class_name": "Lambda", "name": "evil", "config": config, "inbound_nodes": [[["conv2d_1", 0, 0, {}]]],
    }  # fmt: skip


def test_lambda_layers_are_refused_unrun(small, old_file, write_h5, tmp_path):
    stored = stored_config(old_file)
    stored["config"]["layers"].append(lambda_layer(tmp_path / "proof"))
    refused(write_h5(tmp_path / "evil.h5", stored, weights_of(small)), "Lambda", "run code")
    assert not (tmp_path / "proof").exists()


def test_lambda_layers_in_nested_models_and_wrappers_are_refused_unrun(small, old_file, write_h5, tmp_path):
    for class_name, config in (
        ("Model", {"name": "inner", "layers": [lambda_layer(tmp_path / "proof")], "output_layers": []}),
        ("TimeDistributed", {"name": "inner", "layer": lambda_layer(tmp_path / "proof")}),
    ):
        stored = stored_config(old_file)
        inner = {"class_name": class_name, "name": "inner", "config": config, "inbound_nodes": []}
        stored["config"]["layers"].append(inner)
        refused(write_h5(tmp_path / "evil.h5", stored, weights_of(small)), "Lambda", "run code")
    assert not (tmp_path / "proof").exists()


def test_lambda_layers_in_keras_archives(small, tmp_path):
    import keras

    outputs = keras.layers.Lambda(lambda x: x)(small.outputs[0])
    keras.Model(small.inputs, [outputs, *small.outputs[1:]]).save(tmp_path / "lambda.keras")
    refused(tmp_path / "lambda.keras", "Lambda", "run code")


@pytest.mark.parametrize(
    "value",
    [
        {"class_name": "function", "module": "os", "config": "system", "registered_name": "function"},
        {"class_name": "__lambda__", "config": {"value": "eA=="}},
        {"class_name": "Custom>Activation", "config": {}},
        {"class_name": "Mine", "module": "mine", "config": {}, "registered_name": "package>Mine"},
    ],
)
def test_custom_objects_and_functions_are_refused(value, small, old_file, write_h5, tmp_path):
    stored = stored_config(old_file)
    stored["config"]["layers"][1]["config"]["activation"] = value
    refused(write_h5(tmp_path / "custom.h5", stored, weights_of(small)), "refused")


@pytest.mark.parametrize("class_name", ["MyConv", "TFSMLayer", "os.system", "Input"])
def test_layers_that_keras_does_not_have(class_name, small, old_file, write_h5, tmp_path):
    stored = stored_config(old_file)
    stored["config"]["layers"][1]["class_name"] = class_name
    refused(write_h5(tmp_path / "custom.h5", stored, weights_of(small)), class_name)


def test_nested_models_are_refused(small, tmp_path):
    import keras

    inputs = keras.Input((20, 20, 1))
    keras.Model(inputs, small(inputs)).save(tmp_path / "nested.keras")
    refused(tmp_path / "nested.keras", "flat model")


def test_operations_on_constants_are_refused(small, tmp_path):
    import keras

    outputs = [small.outputs[0] + 1.0, *small.outputs[1:]]
    keras.Model(small.inputs, outputs).save(tmp_path / "constant.keras")
    refused(tmp_path / "constant.keras", "other arguments")


def test_every_error_is_ours_whatever_byte_breaks(old_file):
    """A file with any damage either loads or raises a GGCNNError."""
    content = old_file.read_bytes()
    rng = np.random.default_rng(1)
    for position in rng.integers(0, len(content), 25):
        broken = bytearray(content)
        broken[position] ^= 0xFF
        old_file.write_bytes(broken)
        with contextlib.suppress(GGCNNError):
            load_ggcnn(old_file)


def test_published_file_with_a_wrong_hash(small, tmp_path, monkeypatch, write_old_file):
    folder = tmp_path / "original_ggcnn_weights"
    folder.mkdir()
    write_old_file(folder / "epoch_29_model.hdf5", small, "2.0.8")
    monkeypatch.setenv("GGCNN_NET2NET_DATA", str(tmp_path))
    with pytest.raises(VerificationError, match="07ed61da"):
        load_ggcnn("published")
