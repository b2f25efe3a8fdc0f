"""Export as a whole: what is written, what is refused, and that nothing else is left."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import warnings
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import keras
import numpy as np
import pytest
from keras import layers

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS, build_ggcnn
from ggcnn_net2net.errors import DepthImageError, ExportError, MissingExtraError, ModelFileError
from ggcnn_net2net.grasping import RSS_2018
from ggcnn_net2net.model_files.export import metadata_path, read_metadata
from ggcnn_net2net.model_files.export.formats import FORMATS
from ggcnn_net2net.model_files.export.runtime import Job

NAMES = {
    "keras": "net.keras",
    "hdf5": "net.hdf5",
    "savedmodel": "net",
    "tflite": "net.tflite",
    "onnx": "net.onnx",
    "openvino": "net.xml",
}
ANY_FORMAT = pytest.mark.parametrize("name", NAMES)


def content_of(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def heads_of(tensor):
    return [layers.Conv2D(1, 1, name=name)(tensor) for name in HEADS]


@pytest.fixture
def tampered(monkeypatch):
    """Function (format, write): replace what writes a format."""

    def tamper(name, write):
        monkeypatch.setitem(FORMATS, name, replace(FORMATS[name], write=write))

    return tamper


@pytest.fixture(scope="module")
def exported(network, depth, tmp_path_factory):
    """A folder with the network in every format, and what was printed and warned of meanwhile."""
    folder = tmp_path_factory.mktemp("exported")
    with warnings.catch_warnings(record=True) as caught, capture_descriptors(folder / "printed") as printed:
        warnings.simplefilter("always")
        for name in NAMES.values():
            gn.export(network, folder / name / name, samples=depth())
    return folder, printed.read_text(), caught


@contextmanager
def capture_descriptors(path):
    """Write what reaches file descriptors 1 and 2, of C code too, to a file."""
    saved = [os.dup(descriptor) for descriptor in (1, 2)]
    with path.open("wb") as stream:
        for descriptor in (1, 2):
            os.dup2(stream.fileno(), descriptor)
        try:
            yield path
        finally:
            for descriptor, copy in zip((1, 2), saved, strict=True):
                os.dup2(copy, descriptor)
                os.close(copy)


@ANY_FORMAT
def test_every_format_equals_keras_and_tells_what_it_is(name, network, exported):
    path = exported[0] / NAMES[name] / NAMES[name]
    facts = read_metadata(path)
    assert facts["format"] == name
    assert [output["name"] for output in facts["outputs"]] == list(HEADS)
    assert facts["input"]["shape"] == [1 if name in ("tflite", "openvino") else "batch", 60, 60, 1]
    assert max(facts["parity"]["max_abs_difference"].values()) < 1e-5
    assert (facts["parity"]["images"], facts["parity"]["images_from"]) == (3, "the caller")
    assert facts["network"]["parameters"] == network.count_params()
    assert facts["decoding"]["quality_sigma"] == RSS_2018.quality_sigma
    written = content_of(path.parent)
    assert json.loads(written.pop(metadata_path(path).name)) == facts
    assert {file: hashlib.sha256(data).hexdigest() for file, data in written.items()} == facts["files"]
    assert [entry.name for entry in path.parent.iterdir() if entry.name.startswith(".")] == []


def test_nothing_is_printed(exported):
    _, printed, caught = exported
    assert printed == ""
    assert [str(warning.message) for warning in caught] == []


@pytest.mark.parametrize("name", ["hdf5", "tflite", "onnx", "openvino"])
def test_files_are_the_same_every_time(name, network, depth, exported, tmp_path):
    gn.export(network, tmp_path / NAMES[name], samples=depth())
    assert content_of(tmp_path) == content_of(exported[0] / NAMES[name])


@pytest.mark.parametrize("name", ["hdf5", "onnx"])
def test_grown_networks_keep_their_lineage(name, network, depth, tmp_path):
    grown = gn.apply_operations(network, "deeper(3), wider(3), deeper(2)", seed=4)
    facts = read_metadata(gn.export(grown, tmp_path / NAMES[name], samples=depth()))
    assert [step["operation"] for step in facts["lineage"]["operations"]] == ["deeper(3)", "wider(3)", "deeper(2)"]
    assert facts["network"]["architecture"] == str(gn.architecture_of(grown))


@pytest.mark.parametrize("name", ["hdf5", "onnx", "tflite"])
def test_relatives(name, relative, depth, tmp_path):
    facts = read_metadata(gn.export(relative, tmp_path / NAMES[name], samples=depth(size=16)))
    assert facts["network"]["architecture"] is None


def test_networks_for_any_size_are_exported_for_300_pixels(depth, tmp_path):
    inputs = keras.Input((None, None, 1))
    model = keras.Model(inputs, heads_of(layers.Conv2D(2, 3, padding="same", activation="relu")(inputs)))
    facts = read_metadata(gn.export(model, tmp_path / "net.onnx", samples=depth(1, 300)))
    assert facts["input"]["shape"] == ["batch", 300, 300, 1]


def test_the_source_is_named(network, depth, tmp_path):
    source = gn.save_ggcnn(network, tmp_path / "source.hdf5")
    facts = read_metadata(gn.export(source, tmp_path / "net.onnx", samples=depth()))
    assert facts["lineage"]["source"] == {
        "name": "source.hdf5",
        "sha256": hashlib.sha256(source.read_bytes()).hexdigest(),
    }
    from_memory = read_metadata(gn.export(network, tmp_path / "net.xml", samples=depth()))
    assert from_memory["network"]["weights_sha256"] == facts["network"]["weights_sha256"]
    assert from_memory["lineage"]["source"]["name"] is None


@pytest.mark.parametrize("name", ["tflite", "openvino"])
def test_float16_halves_the_weights(name, network, depth, exported, tmp_path):
    whole = exported[0] / NAMES[name] / NAMES[name]
    half = gn.export(network, tmp_path / NAMES[name], samples=depth(), quantization="float16")
    sizes = [(path.with_suffix(".bin") if name == "openvino" else path).stat().st_size for path in (whole, half)]
    assert sizes[1] < 0.9 * sizes[0]
    assert 1e-6 < max(read_metadata(half)["parity"]["max_abs_difference"].values()) < 2e-2


def test_int8_is_between_float32_ends(network, depth, tmp_path):
    from ai_edge_litert.interpreter import Interpreter

    path = gn.export(
        network, tmp_path / "net.tflite", samples=depth(), quantization="int8", representative=depth(count=10)
    )
    interpreter = Interpreter(model_path=str(path))
    interpreter.allocate_tensors()
    types = {detail["dtype"] for detail in interpreter.get_tensor_details()}
    ends = [*interpreter.get_input_details(), *interpreter.get_output_details()]
    assert np.int8 in types
    assert {end["dtype"] for end in ends} == {np.float32}
    assert [end["name"] for end in ends[1:]] == list(HEADS)
    assert read_metadata(path)["parity"]["agreement"] >= 0.5


@ANY_FORMAT
def test_a_file_with_exchanged_maps_is_refused_and_the_old_one_stays(name, network, depth, tampered, tmp_path):
    """Names and order are right, the maps of two heads are exchanged."""
    old = tmp_path / NAMES[name] / "saved_model.pb" if name == "savedmodel" else tmp_path / NAMES[name]
    old.parent.mkdir(exist_ok=True)
    old.write_bytes(b"an older export")
    metadata_path(tmp_path / NAMES[name]).write_bytes(b"its metadata")
    before = content_of(tmp_path)
    exchanged = keras.models.clone_model(network)
    exchanged.set_weights(network.get_weights())
    for one, other in (("cos_out", "sin_out"), ("sin_out", "cos_out")):
        exchanged.get_layer(one).set_weights(network.get_layer(other).get_weights())
    write = FORMATS[name].write
    tampered(name, lambda job, path: write(Job(exchanged), path))
    with pytest.raises(ExportError, match="cos_out to differ"):
        gn.export(network, tmp_path / NAMES[name], samples=depth())
    assert content_of(tmp_path) == before


@pytest.mark.parametrize("name", ["onnx", "openvino", "savedmodel"])
def test_a_file_that_gives_nan_is_refused(name, network, depth, tampered, tmp_path):
    broken = keras.models.clone_model(network)
    broken.set_weights([weight * np.nan for weight in network.get_weights()])
    write = FORMATS[name].write
    tampered(name, lambda job, path: write(Job(broken), path))
    with pytest.raises(ExportError, match="NaN or infinity in pos_out"):
        gn.export(network, tmp_path / NAMES[name], samples=depth())
    assert content_of(tmp_path) == {}


def test_a_file_with_outputs_in_another_order_is_refused(network, depth, monkeypatch, tmp_path):
    swapped = ("cos_out", "pos_out", "sin_out", "width_out")
    monkeypatch.setattr("ggcnn_net2net.model_files.export.onnx_file.HEADS", swapped)
    with pytest.raises(ExportError, match="the written file has cos_out, pos_out"):
        gn.export(network, tmp_path / "net.onnx", samples=depth())
    assert content_of(tmp_path) == {}


def test_a_writer_that_fails_leaves_nothing(network, depth, tampered, tmp_path):
    def fail(job, path):
        path.mkdir()
        (path / "half").write_bytes(b"half a file")
        raise RuntimeError("no space")

    tampered("savedmodel", fail)
    with pytest.raises(ExportError, match="no space"):
        gn.export(network, tmp_path / "net", samples=depth())
    assert list(tmp_path.iterdir()) == []


def test_int8_that_sees_other_grasps_is_refused(network, depth, monkeypatch, tmp_path):
    monkeypatch.setattr("ggcnn_net2net.model_files.export.parity._same", lambda one, other: False)
    with pytest.raises(ExportError, match="on 0 of 3"):
        gn.export(network, tmp_path / "a.tflite", samples=depth(), quantization="int8", representative=depth())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("onnx", "onnx"),
        ("onnx", "onnxruntime"),
        ("openvino", "openvino"),
        ("tflite", "ai_edge_litert"),
        ("hdf5", "tf_keras"),
    ],
)
def test_missing_software_names_the_extra(name, module, network, depth, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"{module}.*pip install 'ggcnn_net2net\[export\]'"):
        gn.export(network, tmp_path / NAMES[name], samples=depth())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["net.pb", "net.tflite.gz", "net.ONNX"])
def test_unknown_suffixes(name, network, tmp_path):
    with pytest.raises(ExportError, match=r"one of the suffixes \.keras"):
        gn.export(network, tmp_path / name)


@pytest.mark.parametrize(
    ("name", "quantization"), [("onnx", "float16"), ("openvino", "int8"), ("keras", "int8"), ("tflite", "int4")]
)
def test_quantization_that_a_format_does_not_have(name, quantization, network, depth, tmp_path):
    with pytest.raises(ExportError, match="tflite"):
        gn.export(network, tmp_path / NAMES[name], quantization=quantization, representative=depth())


def test_int8_and_representative_images_belong_together(network, depth, tmp_path):
    with pytest.raises(ExportError, match="received none with int8"):
        gn.export(network, tmp_path / "net.tflite", quantization="int8")
    with pytest.raises(ExportError, match="received some with no quantization"):
        gn.export(network, tmp_path / "net.tflite", representative=depth())


def test_networks_that_do_not_work(network, depth, tmp_path):
    broken = keras.models.clone_model(network)
    broken.set_weights([weight * np.nan for weight in network.get_weights()])
    with pytest.raises(ModelFileError, match="NaN"):
        gn.export(broken, tmp_path / "net.onnx", samples=depth())
    reordered = keras.Model(network.inputs, network.outputs[::-1])
    with pytest.raises(ModelFileError, match="order"):
        gn.export(reordered, tmp_path / "net.onnx", samples=depth())


@pytest.mark.parametrize("layer", [layers.AveragePooling2D(1), layers.Activation("gelu"), layers.ReLU(max_value=6.0)])
def test_layers_that_onnx_files_do_not_get(layer, depth, tmp_path):
    inputs = keras.Input((16, 16, 1))
    model = keras.Model(inputs, heads_of(layer(layers.Conv2D(2, 3, padding="same")(inputs))))
    for name in ("onnx", "openvino"):
        with pytest.raises(ExportError, match=layer.name):
            gn.export(model, tmp_path / NAMES[name], samples=depth(size=16))
    gn.export(model, tmp_path / "net.keras", samples=depth(size=16))


def test_layers_that_are_called_twice(depth, tmp_path):
    inputs = keras.Input((16, 16, 1))
    shared = layers.Conv2D(1, 3, padding="same", name="shared")
    model = keras.Model(inputs, heads_of(shared(shared(inputs))))
    with pytest.raises(ExportError, match="shared"):
        gn.export(model, tmp_path / "net.onnx", samples=depth(size=16))
    gn.export(model, tmp_path / "net", samples=depth(size=16))


def test_what_is_no_export_is_not_replaced(network, depth, tmp_path):
    photos = tmp_path / "photos"
    photos.mkdir()
    (photos / "holiday.jpg").write_bytes(b"x")
    source = gn.save_ggcnn(network, tmp_path / "source.hdf5")
    (tmp_path / "folder.onnx").mkdir()
    for model, target in ((network, photos), (network, tmp_path / "folder.onnx"), (source, source)):
        with pytest.raises(ExportError, match="expected"):
            gn.export(model, target, samples=depth())
    assert (photos / "holiday.jpg").exists()


@pytest.mark.parametrize(
    "samples", [np.zeros((2, 30, 30)), np.zeros((60, 60)), np.zeros((0, 60, 60)), np.full((1, 60, 60), np.nan)]
)
def test_samples_that_cannot_be_used(samples, network, tmp_path):
    with pytest.raises(DepthImageError, match="samples"):
        gn.export(network, tmp_path / "net.onnx", samples=samples)


def test_metadata_that_is_not_there(tmp_path):
    with pytest.raises(ExportError, match="metadata"):
        read_metadata(tmp_path / "net.onnx")


def test_importing_the_function_does_not_import_tensorflow():
    code = "import sys, ggcnn_net2net as gn; print(gn.export.__name__, *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    name, *loaded = done.stdout.split()
    assert name == "export"
    assert not {"tensorflow", "keras", "onnx"} & set(loaded)


def test_a_grasp_is_seen_where_there_is_one(depth, tmp_path):
    """The comparison of grasps counts grasps, not only images on which none is seen."""
    model = build_ggcnn("shallow", input_size=60, seed=0)
    for name, bias in zip(HEADS, (0.5, 1.0, 0.0, 0.2), strict=True):
        model.get_layer(name).bias.assign([bias])
    parity = read_metadata(gn.export(model, tmp_path / "net.onnx", samples=depth()))["parity"]
    assert parity["same_grasp"] == 3
    assert parity["no_grasp"] < 3
