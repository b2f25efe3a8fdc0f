"""Files of every Keras generation give the network that was stored."""

from __future__ import annotations

import json
import shutil
import warnings

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ggcnn_net2net import reference_data, zoo
from ggcnn_net2net.architecture import HEADS, architecture_of
from ggcnn_net2net.errors import ArchitectureError, DataNotFoundError, ModelFileError, VerificationError
from ggcnn_net2net.model_files import check_ggcnn, load, load_ggcnn, published, save_ggcnn
from ggcnn_net2net.model_files.load import opened_name, source_path
from ggcnn_net2net.zoo import files


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


class TestStandIn:
    """What "published" means where the published file is nowhere."""

    @pytest.fixture(autouse=True)
    def nowhere(self, monkeypatch, tmp_path):
        """No published file, no network; a zoo that is empty."""
        (tmp_path / "zoo").mkdir()
        monkeypatch.setattr(files, "FOLDER", tmp_path / "zoo")
        monkeypatch.delenv("GGCNN_NET2NET_DATA", raising=False)
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        monkeypatch.setattr(reference_data, "checkout_root", lambda: tmp_path / "checkout")
        monkeypatch.setattr(published, "PUBLISHED_URL", "http://127.0.0.1:9/epoch_29_model.hdf5")

    @pytest.fixture
    def stand_in(self, small, tmp_path):
        path = save_ggcnn(small, tmp_path / "zoo" / f"{zoo.STAND_IN}.hdf5")
        path.with_suffix(".json").write_text(json.dumps({"model_sha256": reference_data.sha256_of(path)}))
        return path

    @pytest.fixture
    def found(self, tmp_path):
        """Where the published file is looked for."""
        path = tmp_path / "checkout" / "original_ggcnn_weights" / published.PUBLISHED_NAME
        path.parent.mkdir(parents=True)
        return path

    def test_the_retrained_network_with_a_warning_that_says_what_to_do(self, stand_in, small, maps):
        with pytest.warns(zoo.StandInWarning, match="NOT THE PUBLISHED NETWORK") as caught:
            loaded = load_ggcnn("published")
        assert_same_maps(maps, small, loaded)
        (warning,) = caught
        for part in ("zoo:original_retrained", "curl", "epoch_29_model.hdf5", "07ed61da"):
            assert part in str(warning.message)
        with pytest.warns(zoo.StandInWarning):
            assert source_path("published") == stand_in
        assert opened_name("published", stand_in) == "zoo:original_retrained"
        assert opened_name("zoo:original_retrained", stand_in) == "zoo:original_retrained"

    def test_without_it_the_error_stays(self):
        with pytest.raises(DataNotFoundError, match="curl"):
            load_ggcnn("published")

    def test_the_published_file_wins(self, stand_in, found, small, write_old_file, monkeypatch):
        write_old_file(found, small, "2.0.8")
        monkeypatch.setattr(published, "PUBLISHED_SHA256", reference_data.sha256_of(found))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert source_path("published") == found
        monkeypatch.setattr(load, "PUBLISHED_SHA256", reference_data.sha256_of(found))
        assert opened_name("published", found) == "published"

    def test_it_hides_no_damage(self, stand_in, found, tmp_path, monkeypatch):
        shutil.copy(stand_in, found)
        with pytest.raises(VerificationError, match="07ed61da"):
            load_ggcnn("published")
        monkeypatch.setenv("GGCNN_NET2NET_DATA", str(tmp_path / "no_such_folder"))
        with pytest.raises(DataNotFoundError, match="correct or unset it"):
            load_ggcnn("published")

    def test_a_damaged_stand_in_is_no_stand_in(self, stand_in):
        stand_in.write_bytes(stand_in.read_bytes()[:-1])
        with pytest.raises(VerificationError, match="provenance"):
            load_ggcnn("published")

    def test_no_other_name_falls_back(self, stand_in):
        with pytest.raises(ModelFileError, match=zoo.STAND_IN):
            load_ggcnn("zoo:original")
