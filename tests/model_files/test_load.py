"""Files of every Keras generation give the network that was stored."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ggcnn_net2net.architecture import HEADS, architecture_of
from ggcnn_net2net.errors import ArchitectureError
from ggcnn_net2net.model_files import check_ggcnn, load_ggcnn


def assert_same_maps(maps, model, other) -> None:
    for ours, theirs in zip(maps(model), maps(other), strict=True):
        assert_allclose(ours, theirs, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("version", ["2.0.8", "2.2.4", "2.3.1", "2.5.0"])
def test_files_of_keras_2(version, small, maps, write_old_file, tmp_path):
    loaded = load_ggcnn(write_old_file(tmp_path / "old.hdf5", small, version))
    assert [tensor._keras_history.operation.name for tensor in loaded.outputs] == list(HEADS)
    assert architecture_of(loaded) == architecture_of(small)
    assert_same_maps(maps, small, loaded)


@pytest.mark.parametrize("suffix", [".h5", ".keras"])
@pytest.mark.parametrize("compiled", [False, True])
def test_files_of_keras_3(suffix, compiled, small, relative, maps, tmp_path):
    for number, model in enumerate((small, relative)):
        if compiled:
            model.compile("rmsprop", "mse")
        path = tmp_path / f"{number}{suffix}"
        model.save(path)
        assert_same_maps(maps, model, load_ggcnn(path))


@pytest.mark.parametrize("suffix", [".h5", ".keras"])
def test_files_of_tf_keras(suffix, tmp_path):
    keras = pytest.importorskip("tf_keras")
    inputs = keras.Input((12, 12, 1))
    outputs = keras.layers.Conv2D(3, 3, strides=2, padding="same", activation="relu")(inputs)
    outputs = keras.layers.BatchNormalization()(outputs)
    outputs = keras.layers.LeakyReLU(0.1)(outputs)
    outputs = keras.layers.Add()([outputs, keras.layers.Dropout(0.5)(outputs)])
    outputs = keras.layers.Conv2DTranspose(4, 5, strides=2, padding="same", activation="relu")(outputs)
    model = keras.Model(inputs, [keras.layers.Conv2D(1, 2, padding="same", name=name)(outputs) for name in HEADS])
    rng = np.random.default_rng(0)
    model.set_weights([rng.uniform(0.1, 0.5, weight.shape) for weight in model.get_weights()])
    model.compile("rmsprop", "mse")
    model.save(tmp_path / f"model{suffix}")

    loaded = load_ggcnn(tmp_path / f"model{suffix}")
    image = rng.normal(size=(1, 12, 12, 1)).astype("float32")
    for ours, theirs in zip(loaded(image), model(image), strict=True):
        assert_allclose(ours, theirs, rtol=1e-6, atol=1e-6)


def test_layer_names_split_over_several_attributes(small, maps, write_old_file, tmp_path):
    """Keras splits lists of names that are too long for one attribute."""
    path = write_old_file(tmp_path / "old.hdf5", small, "2.2.4")
    with h5py.File(path, "r+") as file:
        group = file["model_weights"]
        names = list(group.attrs["layer_names"])
        del group.attrs["layer_names"]
        group.attrs["layer_names0"], group.attrs["layer_names1"] = names[:3], names[3:]
    assert_same_maps(maps, small, load_ggcnn(path))


def test_operations_on_tensors_are_read_as_merge_layers(tmp_path, maps):
    """In Keras 3, x + y makes an operation, which its own h5 files cannot bring back."""
    from keras import Input, Model, layers

    inputs = Input((8, 8, 1))
    hidden = layers.Conv2D(2, 3, padding="same")(inputs)
    hidden = hidden + layers.ReLU()(hidden)
    model = Model(inputs, [layers.Conv2D(1, 2, padding="same", name=name)(hidden) for name in HEADS])
    model.save(tmp_path / "sum.h5")
    assert_same_maps(maps, model, load_ggcnn(tmp_path / "sum.h5"))


def test_relatives_pass_the_check_without_a_name(relative):
    check_ggcnn(relative)
    with pytest.raises(ArchitectureError):
        architecture_of(relative)


def test_loading_is_quiet_and_leaves_the_file_alone(small, maps, write_old_file, tmp_path, recwarn):
    path = write_old_file(tmp_path / "old.hdf5", small, "2.0.8")
    before = path.read_bytes()
    maps(load_ggcnn(path))
    assert path.read_bytes() == before
    assert not [warning for warning in recwarn if issubclass(warning.category, UserWarning)]


def test_float64_files_stay_float64(tmp_path):
    import keras

    inputs = keras.Input((8, 8, 1), dtype="float64")
    hidden = keras.layers.Conv2D(2, 3, padding="same", dtype="float64")(inputs)
    heads = [keras.layers.Conv2D(1, 2, padding="same", name=name, dtype="float64")(hidden) for name in HEADS]
    model = keras.Model(inputs, heads)
    for suffix in (".h5", ".keras"):
        model.save(tmp_path / f"double{suffix}")
        loaded = load_ggcnn(tmp_path / f"double{suffix}")
        assert {weight.dtype for weight in loaded.weights} == {"float64"}
        assert_array_equal(loaded.get_weights()[0], model.get_weights()[0])


def test_published_network(data_root, monkeypatch):
    from ggcnn_net2net.architecture import ORIGINAL

    monkeypatch.setenv("GGCNN_NET2NET_DATA", str(data_root))
    model = load_ggcnn("published")
    assert architecture_of(model) == ORIGINAL
    assert model.count_params() == 62_420
    assert not model.compiled
