"""`ggcnn-net2net export`."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

from ggcnn_net2net.architecture import build_ggcnn
from ggcnn_net2net.cli.export import FORMATS, export_command
from ggcnn_net2net.errors import ExportError
from ggcnn_net2net.model_files import save_ggcnn
from ggcnn_net2net.model_files.export import formats, read_metadata

SIZE = 36


@pytest.fixture(autouse=True)
def quick_samples(monkeypatch):
    """Random depth in place of simulated scenes."""
    images = np.random.default_rng(0).uniform(1, 1.5, (2, SIZE, SIZE))
    monkeypatch.setattr("ggcnn_net2net.model_files.export.exporting.default_samples", lambda size: (images, "test"))


@pytest.fixture
def model(tmp_path):
    return save_ggcnn(build_ggcnn("shallow", SIZE, seed=0), tmp_path / "small.net.hdf5")


def run(*arguments):
    return CliRunner().invoke(export_command, [str(argument) for argument in arguments])


def test_help_names_every_format_and_shows_an_example():
    result = run("--help")
    assert "Example: ggcnn-net2net export published --to onnx" in result.output
    assert list(FORMATS) == list(formats.FORMATS)  # spelled out in the command, so that --help loads nothing


def test_one_file(model, tmp_path):
    result = run(model, "--to", "onnx", "-o", tmp_path / "new" / "mine.onnx")
    assert result.exit_code == 0, result.output
    assert "onnxruntime" in result.output
    assert "2/2" in result.output
    assert read_metadata(tmp_path / "new" / "mine.onnx")["format"] == "onnx"


def test_several_models_and_formats(model, tmp_path):
    other = save_ggcnn(build_ggcnn("shallow", SIZE, seed=1), tmp_path / "other.keras")
    result = run(model, other, "--to", "onnx", "--to", "savedmodel", "--to", "onnx", "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    written = {path.name for path in (tmp_path / "out").iterdir() if not path.name.endswith(".json")}
    assert written == {"small_net.onnx", "small_net_savedmodel", "other.onnx", "other_savedmodel"}


def test_one_file_into_a_folder_or_here(model, tmp_path, monkeypatch):
    assert run(model, "--to", "onnx", "-o", tmp_path).exit_code == 0
    monkeypatch.chdir(tmp_path)
    assert run(model, "--to", "openvino").exit_code == 0
    assert {"small_net.onnx", "small_net.xml", "small_net.bin"} < {path.name for path in tmp_path.iterdir()}


def test_int8(model, dataset, tmp_path):
    result = run(model, "--to", "tflite", "--quantize", "int8", "--representative", dataset, "-o", tmp_path)
    assert result.exit_code == 0, result.output
    assert read_metadata(tmp_path / "small_net_int8.tflite")["quantization"] == "int8"


def test_mistakes_are_told_before_anything_is_written(model, tmp_path):
    wrong_suffix = run(model, "--to", "onnx", "-o", tmp_path / "mine.tflite")
    wrong_quantization = run(model, "--to", "tflite", "--to", "onnx", "--quantize", "float16", "-o", tmp_path / "out")
    same_name = run(model, model, "--to", "onnx", "-o", tmp_path / "out")
    for result, message in (
        (wrong_suffix, "ends in .onnx"),
        (wrong_quantization, "for onnx"),
        (same_name, "same name"),
    ):
        assert isinstance(result.exception, ExportError)
        assert message in str(result.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["small.net.hdf5"]


def test_another_network_is_not_replaced_and_nothing_else_is_written(model, tmp_path):
    other = tmp_path / "out" / "small_net.keras"
    other.parent.mkdir()
    other.write_bytes(b"hours of training")
    result = run(model, "--to", "onnx", "--to", "keras", "-o", other.parent)
    assert "may be a network that was trained" in str(result.exception)
    assert [path.name for path in other.parent.iterdir()] == ["small_net.keras"]
    assert other.read_bytes() == b"hours of training"
    other.unlink()
    for _ in range(2):  # the second time, what is there is an export
        assert run(model, "--to", "keras", "-o", other.parent).exit_code == 0


def test_what_was_written_before_an_error_is_told(model, tmp_path):
    result = run(model, "--to", "onnx", "--to", "pytorch", "-o", tmp_path / "out")
    assert isinstance(result.exception, ExportError)
    assert "2/2" in result.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"small_net.onnx", "small_net.onnx.export.json"}
