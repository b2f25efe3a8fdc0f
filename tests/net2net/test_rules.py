"""Every layer class that surgery knows, with a layer before it that grows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import keras
import numpy as np
import pytest
from surgery_models import L, outputs, randomize, relative_difference

from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net import Operation, apply_operations, operations, parameters_after
from ggcnn_net2net.net2net.rules import RULES

OF_ONE: dict[str, Callable[..., Any]] = {
    "Activation": lambda **options: L.Activation("tanh", **options),
    "ELU": L.ELU,
    "LeakyReLU": L.LeakyReLU,
    "PReLU": L.PReLU,
    "ReLU": lambda **options: L.ReLU(6, **options),
    "ActivityRegularization": lambda **options: L.ActivityRegularization(0.1, **options),
    "Dropout": lambda **options: L.Dropout(0.5, **options),
    "GaussianDropout": lambda **options: L.GaussianDropout(0.5, **options),
    "GaussianNoise": lambda **options: L.GaussianNoise(1.0, **options),
    "Identity": L.Identity,
    "SpatialDropout2D": lambda **options: L.SpatialDropout2D(0.5, **options),
    "AveragePooling2D": lambda **options: L.AveragePooling2D(2, **options),
    "Cropping2D": lambda **options: L.Cropping2D(((1, 0), (0, 2)), **options),
    "GlobalAveragePooling2D": L.GlobalAveragePooling2D,
    "GlobalMaxPooling2D": L.GlobalMaxPooling2D,
    "MaxPooling2D": L.MaxPooling2D,
    "UpSampling2D": L.UpSampling2D,
    "ZeroPadding2D": L.ZeroPadding2D,
    "BatchNormalization": lambda **options: L.BatchNormalization(epsilon=0.01, **options),
    "Flatten": L.Flatten,
    "Conv2D": lambda **options: L.Conv2D(4, 3, strides=2, padding="same", activation="relu6", **options),
    "Conv2DTranspose": lambda **options: L.Conv2DTranspose(4, 4, strides=2, activation="hard_tanh", **options),
    "Dense": lambda **options: L.Dense(4, activation="relu", **options),
}
OF_TWO: dict[str, Callable[..., Any]] = {
    **{name: getattr(L, name) for name in ("Add", "Average", "Maximum", "Minimum", "Multiply", "Subtract")},
    "Concatenate": L.Concatenate,
    "Concatenate of rows": lambda **options: L.Concatenate(axis=1, **options),
}


def model_with(case: str) -> keras.Model:
    """A convolution, `one`, for a layer of two another one beside it, the layer, and a head; random weights."""
    inputs = keras.Input((8, 10, 2), dtype="float64")
    own_activation = case in ("Activation", "ELU", "LeakyReLU", "PReLU", "ReLU")
    options = {"padding": "same", "activation": None if own_activation else "relu", "dtype": "float64"}
    one = L.Conv2D(3, 3, name="one", **options)(inputs)
    if case in OF_TWO:
        x = OF_TWO[case](name="case", dtype="float64")([one, L.Conv2D(3, 2, name="two", **options)(inputs)])
    else:
        x = OF_ONE[case](name="case", dtype="float64")(one)
    head = L.Dense(2, dtype="float64") if len(x.shape) == 2 else L.Conv2D(2, 2, padding="same", dtype="float64")
    model = keras.Model(inputs, head(x))
    randomize(model, 1)
    return model


def test_every_rule_has_a_case() -> None:
    assert {case.removesuffix(" of rows") for case in (*OF_ONE, *OF_TWO)} == set(RULES)


@pytest.mark.parametrize("case", [*OF_ONE, *OF_TWO])
def test_growing_before_the_layer_and_the_layer_itself_preserve_the_function(case: str) -> None:
    model = model_with(case)
    x = np.random.default_rng(0).normal(size=(3, 8, 10, 2))
    possible = operations(model, transpose=True)
    assert Operation("wider", 1) in possible  # wherever a rule says how channels pass
    for number in range(1, len({operation.layer for operation in possible}) + 1):
        for name in ("deeper", "wider"):
            operation = Operation(name, number)
            if operation not in possible:
                with pytest.raises(SurgeryError):
                    apply_operations(model, [operation])
                continue
            child = apply_operations(model, [operation], seed=2, noise=0.5)
            assert relative_difference(model, child, x) < 1e-10
            assert [child.count_params()] == parameters_after(model, [operation])
            assert child.count_params() > model.count_params()
            assert np.ptp(outputs(child, x)[0]) > 0.01  # and what stays is not a constant
