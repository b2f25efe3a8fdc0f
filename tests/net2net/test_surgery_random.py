"""Operations on random architectures: the function stays, the original stays, the parameters add up."""

from __future__ import annotations

import keras
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from surgery_models import expected_parameters, models, outputs, relative_difference, state

from ggcnn_net2net.net2net import Operation, apply_operations, history_of, operations, parameters_after

# Keras draws initial weights, which the tests overwrite, while hypothesis builds a model.
pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module")

SETTINGS = settings(deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def _inputs(model: keras.Model, dtype: str) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(2, *model.input_shape[1:])).astype(dtype)


def _grow(data: st.DataObject, model: keras.Model, steps: int) -> keras.Model:
    for step in range(steps):
        operation = data.draw(st.sampled_from(operations(model, transpose=True)))
        change: dict[str, object] = {}
        if operation.name == "wider":
            change["factor"] = data.draw(st.sampled_from([1.1, 1.5, 2.0, 3.0]))
        elif model.get_layer(_name(model, operation)).__class__ is not keras.layers.Dense:
            change["kernel_size"] = data.draw(st.sampled_from([None, (2, 3), (4, 1)]))
        noise = data.draw(st.sampled_from([0.0, 0.5]))
        before = state(model)
        child = apply_operations(model, [Operation(operation.name, operation.layer, **change)], seed=step, noise=noise)
        assert state(model) == before
        model = child
    return model


def _name(model: keras.Model, operation: Operation) -> str:
    from ggcnn_net2net.net2net.channels import Channels
    from ggcnn_net2net.net2net.graph import ModelGraph

    return Channels.of(ModelGraph.of(model)).layer_name(operation.layer)


@pytest.mark.slow
@settings(SETTINGS, max_examples=60)
@given(models(), st.data())
def test_any_operations_on_any_architecture_preserve_the_function(model: keras.Model, data: st.DataObject) -> None:
    assume(operations(model, transpose=True))
    steps = data.draw(st.integers(1, 5))
    child = _grow(data, model, steps)
    x = _inputs(model, "float64")
    assert outputs(child, x)[0].dtype == np.float64
    assert relative_difference(model, child, x) < 1e-10
    assert child.count_params() == expected_parameters(child) > model.count_params()
    assert len(history_of(child)) == steps
    assert child.output_names == model.output_names


@pytest.mark.slow
@settings(SETTINGS, max_examples=15)
@given(models(dtype="float32"), st.data())
def test_float32_networks_stay_the_same_but_for_rounding(model: keras.Model, data: st.DataObject) -> None:
    assume(operations(model, transpose=True))
    child = _grow(data, model, 3)
    assert relative_difference(model, child, _inputs(model, "float32")) < 1e-5


@pytest.mark.slow
@settings(SETTINGS, max_examples=40)
@given(models(dtype="float32"))
def test_parameters_are_counted_without_building(model: keras.Model) -> None:
    following = operations(model, transpose=True)
    following += [Operation("wider", one.layer, factor=2.6) for one in following if one.name == "wider"]
    built = [apply_operations(model, [one]).count_params() for one in following]
    assert parameters_after(model, following) == built
