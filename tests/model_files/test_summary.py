"""Summaries of model files, and the commands `inspect` and `grow`."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
from click.testing import CliRunner

from ggcnn_net2net.architecture import ORIGINAL, architecture_of, build_ggcnn
from ggcnn_net2net.cli.grow import grow_command
from ggcnn_net2net.cli.inspect import inspect_command
from ggcnn_net2net.errors import GGCNNError, ModelFileError
from ggcnn_net2net.model_files import load_ggcnn, model_summary, save_ggcnn
from ggcnn_net2net.net2net.history import history_of, set_history


def run(command, *arguments):
    return CliRunner().invoke(command, [str(argument) for argument in arguments])


def check(summary, name):
    return next(check for check in summary.checks if check.name == name)


def test_summary_of_an_old_file(small, write_old_file, tmp_path):
    path = write_old_file(tmp_path / "old.hdf5", small, "2.2.4")
    summary = model_summary(path)
    assert summary.architecture == str(architecture_of(small))
    assert summary.architecture_name is None
    assert (summary.format, summary.keras_version) == ("Keras HDF5", "2.2.4")
    assert summary.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert summary.size_bytes == path.stat().st_size
    assert not summary.is_published
    assert summary.heads == ("pos_out", "cos_out", "sin_out", "width_out")
    assert summary.parameters == small.count_params() == sum(layer.parameters for layer in summary.layers)
    assert summary.optimizer == {"class_name": "RMSprop", "learning_rate": 0.001, "n_weights": 0}
    assert summary.history == []
    assert summary.problems == ()
    layer = summary.layers[3]
    assert (layer.name, layer.class_name) == ("conv2d_transpose_1", "Conv2DTranspose")
    assert (layer.kernel_size, layer.filters, layer.strides) == ((3, 3), 3, (2, 2))
    assert layer.largest_weight == pytest.approx(max(np.abs(w).max() for w in small.layers[3].get_weights()))


@pytest.mark.parametrize("suffix", [".h5", ".keras"])
def test_optimizers_of_keras_3(suffix, small, tmp_path):
    import keras

    small.compile(keras.optimizers.Adam(0.01), "mse")
    small.train_on_batch(np.zeros((1, 20, 20, 1)), [np.ones((1, 20, 20, 1))] * 4)
    small.save(tmp_path / f"model{suffix}")
    optimizer = model_summary(tmp_path / f"model{suffix}").optimizer
    assert optimizer["class_name"] == "Adam"
    assert optimizer["learning_rate"] == pytest.approx(0.01)
    assert optimizer["n_weights"] == 2 + 2 * len(small.weights)


def test_health_of_dead_and_cloned_filters(small, tmp_path):
    convolution, transposed = small.get_layer("conv2d_1"), small.get_layer("conv2d_transpose_2")
    kernel, bias = convolution.get_weights()
    kernel[..., 1], bias[1] = kernel[..., 3], bias[3]
    convolution.set_weights([kernel, bias])
    kernel, bias = transposed.get_weights()
    kernel[:, :, [0, 2]] = 0
    transposed.set_weights([kernel, bias])
    summary = model_summary(save_ggcnn(small, tmp_path / "model.keras"))
    assert check(summary, "no dead filters").detail == "all-zero kernels: 2 in conv2d_transpose_2"
    assert check(summary, "no cloned filters").detail == "exact copies of another filter: 1 in conv2d_1"
    assert not check(summary, "no dead filters").ok
    assert not check(summary, "no cloned filters").ok
    assert check(summary, "a working GG-CNN").ok


def test_health_of_a_healthy_network(small, tmp_path):
    summary = model_summary(save_ggcnn(small, tmp_path / "model.keras"))
    assert all(item.ok for item in summary.checks)


def test_a_network_that_load_refuses_is_summarised(small, tmp_path):
    import keras

    weights = small.get_weights()
    weights[2][0, 0, 0, 0] = np.nan
    small.set_weights(weights)
    keras.Model(small.inputs, small.outputs[::-1]).save(tmp_path / "bad.keras")
    summary = model_summary(tmp_path / "bad.keras")
    assert len(summary.problems) == 2
    assert "in this order" in summary.problems[0]
    assert "NaN" in summary.problems[1]
    assert check(summary, "finite weights").detail == "NaN or infinity in conv2d_2"
    assert summary.layers[2].largest_weight is None

    result = run(inspect_command, tmp_path / "bad.keras")
    assert isinstance(result.exception, ModelFileError)
    assert "NaN or infinity in conv2d_2" in result.output
    assert "Infinity" not in run(inspect_command, "--json", tmp_path / "bad.keras").output


def test_a_model_of_no_images_is_summarised(tmp_path):
    import keras

    numbers = keras.Input((10,))
    keras.Model(numbers, keras.layers.Dense(3)(numbers)).save(tmp_path / "dense.keras")
    summary = model_summary(tmp_path / "dense.keras")
    assert (summary.input_shape, summary.parameters, summary.multiplications) == ((None, 10), 33, None)


def test_relatives_have_no_name(relative, tmp_path):
    summary = model_summary(save_ggcnn(relative, tmp_path / "model.keras"))
    assert summary.architecture is None
    assert summary.problems == ()


def test_summary_of_the_published_file(data_root, monkeypatch):
    monkeypatch.setenv("GGCNN_NET2NET_DATA", str(data_root))
    summary = model_summary("published")
    assert summary.is_published
    assert summary.architecture_name == "original"
    assert summary.keras_version == "2.0.8"
    assert summary.parameters == 62_420
    assert summary.multiplications == ORIGINAL.multiplications(300)
    assert summary.optimizer["n_weights"] == 20
    assert all(item.ok for item in summary.checks)


def test_inspect_prints_all(small, tmp_path):
    set_history(small, [{"operation": "deeper(2)", "seed": 4}])
    path = save_ggcnn(small, tmp_path / "model[1].hdf5")
    result = run(inspect_command, path)
    assert result.exit_code == 0, result.output
    for text in ("model[1].hdf5", model_summary(path).sha256, str(architecture_of(small)), "conv2d_transpose_2",
                 "Conv2DTranspose", "2.2.4", "none stored", "operation=deeper(2)", "no dead filters"):  # fmt: skip
        assert text in result.output
    assert max(map(len, result.output.splitlines()[9:22])) <= 80


def test_layers_have_the_numbers_of_operations(tmp_path):
    path = save_ggcnn(build_ggcnn("C9x9x3s3_C5x5x2_T3x3x2_T9x9x3s3", input_size=36, seed=0), tmp_path / "small.h5")
    numbers = {layer.name: layer.index for layer in model_summary(path).layers if layer.index is not None}
    assert numbers == {"conv2d_1": 1, "conv2d_2": 2, "conv2d_transpose_1": 3, "conv2d_transpose_2": 4}
    rows = [line.split() for line in run(inspect_command, path).output.splitlines()]
    assert [row[:2] for row in rows if row[:1] and row[0] in "1234"] == [
        [str(number), name] for name, number in numbers.items()
    ]


def test_inspect_json(small, tmp_path):
    path = save_ggcnn(small, tmp_path / "model.hdf5")
    result = run(inspect_command, path, "--json")
    assert json.loads(result.output) == json.loads(json.dumps(model_summary(path).as_dict()))


def test_inspect_of_a_bad_file(tmp_path):
    (tmp_path / "bad.h5").write_bytes(b"no model")
    result = run(inspect_command, tmp_path / "bad.h5")
    assert result.exit_code == 1
    assert isinstance(result.exception, ModelFileError)


@pytest.mark.parametrize("suffix", [".hdf5", ".keras"])
def test_grow(suffix, small, tmp_path):
    source, target = save_ggcnn(small, tmp_path / "model.keras"), tmp_path / "new" / f"grown{suffix}"
    result = run(grow_command, source, "--ops", "deeper(2), wider(2)", "-o", target, "--seed", 3)
    assert result.exit_code == 0, result.output
    grown = load_ggcnn(target)
    assert f"{small.count_params():,} -> {grown.count_params():,} parameters" in result.output
    differences = [float(line.rsplit(": ")[1]) for line in result.output.splitlines() if "difference" in line]
    assert len(differences) == 2
    assert max(differences) <= 1e-5
    assert str(architecture_of(grown)) == "C5x5x4_C3x3x6_C3x3x3_T3x3x3_T5x5x4"
    assert [step["operation"] for step in history_of(grown)] == ["deeper(2)", "wider(2)"]


def test_grow_hands_seed_and_noise_on(small, tmp_path):
    source, target = save_ggcnn(small, tmp_path / "model.keras"), tmp_path / "noisy.keras"
    result = run(grow_command, source, "--ops", "wider(1)", "-o", target, "--seed", 7, "--noise", 0.1)
    assert result.exit_code == 0, result.output
    (step,) = history_of(load_ggcnn(target))
    assert (step["seed"], step["noise"]) == (7, 0.1)


def test_grow_keeps_its_input(small, tmp_path):
    source = save_ggcnn(small, tmp_path / "model.keras")
    before = source.read_bytes()
    (tmp_path / "link.keras").symlink_to(source)
    for output in (source, tmp_path / "link.keras", tmp_path / "." / "model.keras"):
        result = run(grow_command, source, "--ops", "wider(1)", "-o", output)
        assert isinstance(result.exception, ModelFileError)
        assert "another output file" in str(result.exception)
    assert source.read_bytes() == before


@pytest.mark.parametrize(
    ("ops", "output"), [("wider(99)", "out.keras"), ("nonsense", "out.keras"), ("wider(1)", "out.tflite")]
)
def test_grow_errors_leave_nothing(ops, output, small, tmp_path):
    source = save_ggcnn(small, tmp_path / "model.keras")
    result = run(grow_command, source, "--ops", ops, "-o", tmp_path / output)
    assert result.exit_code == 1
    assert isinstance(result.exception, GGCNNError)
    assert [path.name for path in tmp_path.iterdir()] == ["model.keras"]
