"""What a new model takes over from its parent besides weights: history and optimizer."""

from __future__ import annotations

import json
import subprocess
import sys

import keras
import numpy as np
import pytest
from surgery_models import L, state

import ggcnn_net2net as gn
from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net import apply_operations, deeper, history_of, set_history, wider


def _trained(optimizer: keras.optimizers.Optimizer | str) -> keras.Model:
    rng = np.random.default_rng(0)
    model = gn.build_ggcnn("C9x9x4_C5x5x4_T5x5x4_T9x9x4", input_size=24, seed=0)
    model.compile(optimizer, loss="mse")
    x, *y = (rng.normal(size=(2, 24, 24, 1)).astype("float32") for _ in range(5))
    for _ in range(3):
        model.train_on_batch(x, y)
    return model


def _slot(model: keras.Model, name: str) -> np.ndarray:
    (slot,) = (variable for variable in model.optimizer.variables if variable.name == name)
    return slot.numpy()


def test_history_grows_with_each_operation_and_is_plain_json() -> None:
    model = gn.build_ggcnn("narrow", input_size=24)
    assert history_of(model) == []
    child = apply_operations(model, "deeper(1, kernel_size=4), wider(conv2d_2, filters=6)", seed=7, noise=0.25)
    expected = [
        {"operation": "deeper(1, kernel_size=4)", "layer": "conv2d_1", "added": ["conv2d_1_deeper"]},
        {"operation": "wider(conv2d_2, filters=6)", "layer": "conv2d_2", "filters": 6, "seed": 8, "noise": 0.25},
    ]
    assert json.loads(json.dumps(history_of(child))) == expected
    assert history_of(model) == []


def test_a_history_is_copied_in_and_out() -> None:
    model = gn.build_ggcnn("narrow", input_size=24)
    entry = {"operation": "deeper(1)", "layer": "conv2d_1"}
    set_history(model, [entry])
    entry["layer"] = "changed"
    history_of(model).append({})
    assert history_of(model) == [{"operation": "deeper(1)", "layer": "conv2d_1"}]


@pytest.mark.parametrize("optimizer", ["rmsprop", "adam", "sgd"])
def test_the_optimizer_of_a_wider_network(optimizer: str) -> None:
    model = _trained(optimizer)
    model.optimizer.learning_rate = 0.0123
    before, slots = state(model), [variable.numpy() for variable in model.optimizer.variables]
    child = wider(model, 2, filters=6, carry_optimizer=True)
    assert type(child.optimizer) is type(model.optimizer)
    assert child.optimizer is not model.optimizer
    assert int(child.optimizer.iterations) == 3
    assert float(child.optimizer.learning_rate) == pytest.approx(0.0123)
    assert state(model) == before
    assert all(np.array_equal(a, b.numpy()) for a, b in zip(slots, model.optimizer.variables, strict=True))
    if optimizer == "sgd":
        return
    kind = "velocity"
    origins = [0, 1, 2, 3, *np.random.default_rng(0).integers(4, size=2)]
    for weight, axis in (("conv2d_2_kernel", -1), ("conv2d_2_bias", -1), ("conv2d_transpose_1_kernel", -1)):
        expected = _slot(model, f"{weight}_{kind}").take(origins, axis=axis)
        np.testing.assert_array_equal(_slot(child, f"{weight}_{kind}"), expected)
        assert expected.any()
    np.testing.assert_array_equal(_slot(child, f"cos_out_kernel_{kind}"), _slot(model, f"cos_out_kernel_{kind}"))


def test_the_optimizer_of_a_deeper_network_trains_on() -> None:
    model = _trained(keras.optimizers.RMSprop(1e-4, momentum=0.9))
    child = deeper(model, 1, carry_optimizer=True)
    assert not _slot(child, "conv2d_1_deeper_kernel_velocity").any()
    for name in ("conv2d_1_kernel_velocity", "conv2d_2_bias_momentum", "width_out_kernel_velocity"):
        np.testing.assert_array_equal(_slot(child, name), _slot(model, name))
    x = np.zeros((1, 24, 24, 1), "float32")
    assert np.isfinite(child.train_on_batch(x, [x] * 4)).all()
    assert int(child.optimizer.iterations) == 4


def test_names_that_begin_alike_do_not_swap_slots() -> None:
    inputs = keras.Input((6,))
    x = L.Dense(4, activation="relu", name="a_kernel")(L.Dense(4, activation="relu", name="a")(inputs))
    model = keras.Model(inputs, L.Dense(1, name="out")(x))
    model.compile("adam", loss="mse")
    model.train_on_batch(np.ones((2, 6)), np.ones((2, 1)))
    child = wider(model, "a", filters=6, carry_optimizer=True)
    for name in ("a_kernel_bias_velocity", "out_kernel_momentum"):
        np.testing.assert_array_equal(_slot(child, name), _slot(model, name))
    assert _slot(child, "a_kernel_velocity").shape == (6, 6)


@pytest.mark.parametrize("operation", [deeper, wider])
def test_without_a_built_optimizer_there_is_nothing_to_carry(operation: object) -> None:
    model = gn.build_ggcnn("narrow", input_size=24)
    with pytest.raises(SurgeryError, match="not compiled"):
        operation(model, 1, carry_optimizer=True)
    model.compile("adam", loss="mse")
    with pytest.raises(SurgeryError, match="not built"):
        operation(model, 1, carry_optimizer=True)


def test_by_default_the_new_model_is_not_compiled() -> None:
    assert not wider(_trained("rmsprop"), 1).compiled


def test_importing_the_package_does_not_import_tensorflow() -> None:
    code = "import sys, ggcnn_net2net.net2net; sys.exit(bool({'tensorflow', 'keras'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
