"""Written files give the same network in Keras 3, in Keras 2 (tf_keras), and keep its lineage."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path

import h5py
import keras
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from ggcnn_net2net.architecture import HEADS, Architecture, ConvLayer, architecture_of, build_ggcnn
from ggcnn_net2net.errors import ModelFileError
from ggcnn_net2net.model_files import load_ggcnn, save_ggcnn
from ggcnn_net2net.net2net.history import history_of, set_history
from ggcnn_net2net.training.rmsprop import Keras2RMSprop

HISTORY = [{"operation": "deeper(3)", "seed": 0}, {"operation": "wider(3)", "seed": 1, "noise": 0.01}]
SUFFIXES = pytest.mark.parametrize("suffix", [".hdf5", ".h5", ".keras"])


def stored_config(path: Path) -> dict:
    with h5py.File(path) as file:
        return json.loads(file.attrs["model_config"])


@SUFFIXES
def test_round_trip(suffix, small, relative, maps, tmp_path):
    for number, model in enumerate((small, relative)):
        path = save_ggcnn(model, tmp_path / f"{number}{suffix}")
        loaded = load_ggcnn(path)
        assert [layer.name for layer in loaded.layers] == [layer.name for layer in model.layers]
        for ours, theirs in zip(maps(loaded), maps(model), strict=True):
            assert_array_equal(ours, theirs)


@SUFFIXES
def test_keras_3_opens_the_files(suffix, relative, maps, tmp_path):
    path = save_ggcnn(relative, str(tmp_path / f"model{suffix}"))
    for ours, theirs in zip(maps(keras.models.load_model(path, compile=False)), maps(relative), strict=True):
        assert_array_equal(ours, theirs)


def test_keras_2_opens_hdf5(small, relative, maps, tmp_path):
    tf_keras = pytest.importorskip("tf_keras")
    for number, model in enumerate((small, relative)):
        opened = tf_keras.models.load_model(save_ggcnn(model, tmp_path / f"{number}.hdf5"))
        for ours, theirs in zip(maps(model), tf_keras_maps(opened), strict=True):
            assert_allclose(ours, theirs, rtol=1e-6, atol=1e-6)


def tf_keras_maps(model) -> list[np.ndarray]:
    image = np.random.default_rng(0).normal(size=(1, *model.outputs[0].shape[1:3], 1)).astype("float32")
    return [np.asarray(output) for output in model(image)]


def test_the_schema_is_that_of_the_published_file(data_root, tmp_path):
    """Not a key more or less than the Keras 2.0.8 that wrote the published network."""
    path = save_ggcnn(load_ggcnn(data_root / "original_ggcnn_weights/epoch_29_model.hdf5"), tmp_path / "model.hdf5")
    assert stored_config(path) == stored_config(data_root / "original_ggcnn_weights/epoch_29_model.hdf5")
    with h5py.File(path) as ours, h5py.File(data_root / "original_ggcnn_weights/epoch_29_model.hdf5") as theirs:
        for attribute in ("backend", "keras_version", "model_config"):
            assert ours.attrs.get_id(attribute).dtype == theirs.attrs.get_id(attribute).dtype
        for attribute in ("backend", "keras_version", "layer_names"):
            kinds = [file["model_weights"].attrs.get_id(attribute).dtype for file in (ours, theirs)]
            assert kinds[0] == kinds[1]
        for name in theirs["model_weights"].attrs["layer_names"]:
            ours_of_layer, theirs_of_layer = ours["model_weights"][name], theirs["model_weights"][name]
            assert list(ours_of_layer.attrs["weight_names"]) == list(theirs_of_layer.attrs["weight_names"])
            for weight in theirs_of_layer.attrs["weight_names"]:
                assert_array_equal(ours_of_layer[weight], theirs_of_layer[weight])


def test_the_schema_has_only_keys_that_keras_2_0_knows(small, tmp_path):
    config = stored_config(save_ggcnn(small, tmp_path / "model.h5"))
    assert config["class_name"] == "Model"
    by_name = {layer["name"]: layer for layer in config["config"]["layers"]}
    assert by_name["input_1"]["config"] == {
        "batch_input_shape": [None, 20, 20, 1],
        "dtype": "float32",
        "sparse": False,
        "name": "input_1",
    }
    common = {"name", "trainable", "filters", "kernel_size", "strides", "padding", "data_format", "activation",
              "use_bias", "kernel_initializer", "bias_initializer", "kernel_regularizer", "bias_regularizer",
              "activity_regularizer", "kernel_constraint", "bias_constraint"}  # fmt: skip
    assert set(by_name["conv2d_1"]["config"]) == {*common, "dilation_rate"}
    assert set(by_name["conv2d_transpose_1"]["config"]) == common
    assert by_name["pos_out"]["inbound_nodes"] == [[["conv2d_transpose_2", 0, 0, {}]]]
    assert by_name["conv2d_1"]["config"]["kernel_initializer"] == {
        "class_name": "VarianceScaling",
        "config": {"scale": 1.0, "mode": "fan_avg", "distribution": "uniform", "seed": None},
    }
    assert "module" not in json.dumps(config)


@SUFFIXES
def test_the_lineage_travels_with_the_file(suffix, small, tmp_path):
    assert history_of(load_ggcnn(save_ggcnn(small, tmp_path / f"none{suffix}"))) == []
    set_history(small, HISTORY)
    path = save_ggcnn(small, tmp_path / f"model{suffix}")
    loaded = load_ggcnn(path)
    assert history_of(loaded) == HISTORY
    other = tmp_path / ("again.hdf5" if suffix == ".keras" else "again.keras")
    assert history_of(load_ggcnn(save_ggcnn(loaded, other))) == HISTORY
    keras.models.load_model(path, compile=False)  # Keras is not disturbed by it


@pytest.mark.parametrize("content", [b"nonsense", b"{}", b"[1]"])
def test_a_damaged_lineage(content, small, tmp_path):
    set_history(small, HISTORY)
    with h5py.File(save_ggcnn(small, tmp_path / "model.h5"), "r+") as file:
        file.attrs["ggcnn_net2net_history"] = content
    save_ggcnn(small, tmp_path / "model.keras")
    with zipfile.ZipFile(tmp_path / "model.keras") as source, zipfile.ZipFile(tmp_path / "odd.keras", "w") as target:
        for name in source.namelist():
            target.writestr(name, content if "history" in name else source.read(name))
    for path in (tmp_path / "model.h5", tmp_path / "odd.keras"):
        with pytest.raises(ModelFileError, match="operation history"):
            load_ggcnn(path)


@pytest.mark.parametrize("name", ["model.pt", "model.tflite", "model", "model.h6"])
def test_unknown_suffixes(name, small, tmp_path):
    with pytest.raises(ModelFileError, match=r"suffixes \.hdf5, \.h5, \.keras"):
        save_ggcnn(small, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_what_is_no_ggcnn_is_not_written(small, tmp_path):
    with pytest.raises(ModelFileError, match="missing width_out"):
        save_ggcnn(keras.Model(small.inputs, small.outputs[:3]), tmp_path / "model.keras")
    weights = small.get_weights()
    weights[0][0] = np.nan
    small.set_weights(weights)
    with pytest.raises(ModelFileError, match="NaN"):
        save_ggcnn(small, tmp_path / "model.hdf5")
    assert not list(tmp_path.iterdir())


@SUFFIXES
def test_a_failed_write_leaves_the_old_file(suffix, small, tmp_path, monkeypatch):
    path = save_ggcnn(small, tmp_path / f"model{suffix}")
    before = path.read_bytes()

    def full(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        save_ggcnn(small, path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_an_optimizer_is_kept_in_keras_archives_only(small, tmp_path):
    small.compile("rmsprop", "mse")
    small.train_on_batch(np.zeros((1, 20, 20, 1)), [np.ones((1, 20, 20, 1))] * 4)
    assert keras.models.load_model(save_ggcnn(small, tmp_path / "model.keras")).optimizer is not None
    with h5py.File(save_ggcnn(small, tmp_path / "model.hdf5")) as file:
        assert "optimizer_weights" not in file
        assert "training_config" not in file.attrs


def test_keras_alone_opens_what_our_optimizer_trained(small, tmp_path):
    """A `.keras` file with an optimizer class of ours could only be opened where that class has been imported."""
    small.compile(Keras2RMSprop(), "mse")
    small.train_on_batch(np.zeros((1, 20, 20, 1)), [np.ones((1, 20, 20, 1))] * 4)
    path = save_ggcnn(small, tmp_path / "model.keras")
    with zipfile.ZipFile(path) as archive:
        assert "Keras2RMSprop" not in archive.read("config.json").decode()
    opened = keras.models.load_model(path)
    for ours, theirs in zip(small.get_weights(), opened.get_weights(), strict=True):
        assert_array_equal(ours, theirs)
    assert small.optimizer is not None


@st.composite
def architectures(draw) -> tuple[Architecture, int]:
    """A random chain, and an input size that its strides divide."""
    strides = draw(st.lists(st.integers(1, 3), min_size=1, max_size=3))
    sizes = st.tuples(st.integers(1, 7), st.integers(1, 7))
    filters = st.integers(1, 5)
    down = [ConvLayer("C", draw(sizes), draw(filters), stride) for stride in strides]
    up = [ConvLayer("T", draw(sizes), draw(filters), stride) for stride in reversed(strides)]
    return Architecture((*down, *up)), int(np.prod(strides)) * draw(st.integers(1, 3))


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(case=architectures(), suffix=st.sampled_from([".hdf5", ".keras"]), seed=st.integers(0, 1000))
def test_random_architectures_survive(case, suffix, seed, maps, tmp_path):
    architecture, size = case
    model = build_ggcnn(architecture, input_size=size, seed=seed)
    path = save_ggcnn(model, tmp_path / f"model{suffix}")
    loaded = load_ggcnn(path)
    assert architecture_of(loaded) == architecture
    for ours, theirs in zip(maps(loaded), maps(model), strict=True):
        assert_array_equal(ours, theirs)
    if suffix == ".hdf5":
        tf_keras = pytest.importorskip("tf_keras")
        for ours, theirs in zip(maps(model), tf_keras_maps(tf_keras.models.load_model(path)), strict=True):
            assert_allclose(ours, theirs, rtol=1e-6, atol=1e-6)


def test_options_that_keras_2_lacks_are_kept(tmp_path, maps):
    """Grouped convolutions came with Keras 2.3: a file with them needs that, and still gives the same maps."""
    inputs = keras.Input((8, 8, 1))
    hidden = keras.layers.Conv2D(4, 3, padding="same")(inputs)
    hidden = keras.layers.Conv2D(4, 3, padding="same", groups=2, kernel_initializer="he_normal")(hidden)
    hidden = keras.layers.GroupNormalization(groups=1)(hidden)
    hidden = keras.layers.UpSampling2D(interpolation="bilinear")(hidden)
    hidden = keras.layers.Resizing(8, 8, interpolation="nearest")(hidden)
    model = keras.Model(inputs, [keras.layers.Conv2D(1, 2, padding="same", name=name)(hidden) for name in HEADS])
    for ours, theirs in zip(maps(load_ggcnn(save_ggcnn(model, tmp_path / "model.h5"))), maps(model), strict=True):
        assert_array_equal(ours, theirs)


@pytest.mark.parametrize("suffix", [".keras", ".hdf5"])
def test_activations_that_are_layers(suffix, tmp_path, maps):
    inputs = keras.Input((8, 8, 1))
    hidden = keras.layers.Conv2D(4, 3, padding="same", activation=keras.layers.ReLU(max_value=0.1))(inputs)
    model = keras.Model(inputs, [keras.layers.Conv2D(1, 2, padding="same", name=name)(hidden) for name in HEADS])
    for ours, theirs in zip(maps(load_ggcnn(save_ggcnn(model, tmp_path / f"a{suffix}"))), maps(model), strict=True):
        assert_array_equal(ours, theirs)
    heads = [keras.layers.Conv2D(1, 2, padding="same", activation=keras.layers.ReLU(), name=name) for name in HEADS]
    with pytest.raises(ModelFileError, match=r"linear Conv2D with one filter, received Conv2D .* activation ReLU"):
        save_ggcnn(keras.Model(inputs, [head(hidden) for head in heads]), tmp_path / f"b{suffix}")
