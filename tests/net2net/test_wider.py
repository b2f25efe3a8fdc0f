"""*wider*: which filters are copied, what becomes of their outgoing weights, and whether copies learn."""

from __future__ import annotations

import keras
import numpy as np
import pytest
from surgery_models import L, max_difference, randomize, relative_difference

import ggcnn_net2net as gn
from ggcnn_net2net.net2net import history_of, wider


def small_ggcnn() -> keras.Model:
    return gn.build_ggcnn("C9x9x4_C5x5x4_T5x5x4_T9x9x4", input_size=24, seed=0)


def test_the_present_filters_stay_in_front_and_the_others_are_copies() -> None:
    model = small_ggcnn()
    child = wider(model, 2, filters=7, seed=3)
    kernel, bias = model.get_layer("conv2d_2").get_weights()
    new_kernel, new_bias = child.get_layer("conv2d_2").get_weights()
    copied = np.random.default_rng(3).integers(4, size=3)
    np.testing.assert_array_equal(new_kernel[..., :4], kernel)
    np.testing.assert_array_equal(new_kernel[..., 4:], kernel[..., copied])
    np.testing.assert_array_equal(new_bias, bias[[0, 1, 2, 3, *copied]])


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_outgoing_weights_of_the_copies_add_up(noise: float) -> None:
    model = small_ggcnn()
    child = wider(model, 2, factor=3, seed=1, noise=noise)
    kernel = model.get_layer("conv2d_transpose_1").get_weights()[0]
    new_kernel = child.get_layer("conv2d_transpose_1").get_weights()[0]
    origins = np.concatenate([np.arange(4), np.random.default_rng(1).integers(4, size=8)])
    for channel in range(4):
        shares = new_kernel[..., origins == channel]
        np.testing.assert_allclose(shares.sum(axis=-1), kernel[..., channel], atol=1e-6)
        if noise == 0:
            expected = np.repeat(kernel[..., [channel]] / shares.shape[-1], shares.shape[-1], axis=-1)
            np.testing.assert_allclose(shares, expected, atol=1e-7)
        elif shares.shape[-1] > 1:
            unequal = shares - kernel[..., [channel]] / shares.shape[-1]
            # Taking the mean off n random numbers leaves (n - 1) / n of their variance.
            expected = noise * kernel.std() * np.sqrt(1 - 1 / shares.shape[-1])
            assert unequal.std() == pytest.approx(expected, rel=0.2)


def test_seeds_repeat_and_differ() -> None:
    model = small_ggcnn()
    one, same, other = (wider(model, 1, noise=0.1, seed=seed).get_weights() for seed in (5, 5, 6))
    assert all(np.array_equal(a, b) for a, b in zip(one, same, strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize(("factor", "filters"), [(2, 8), (1.5, 6), (1.01, 5), (1.1, 5), (2.6, 10)])
def test_factors_are_rounded_to_at_least_one_more(factor: float, filters: int) -> None:
    child = wider(small_ggcnn(), 1, factor)
    assert child.get_layer("conv2d_1").filters == filters
    assert history_of(child)[0]["filters"] == filters


def train(model: keras.Model, optimizer: str, steps: int = 8) -> None:
    rng = np.random.default_rng(0)
    model.compile(optimizer, loss="mse")
    x = rng.uniform(-1, 1, size=(4, 24, 24, 1)).astype("float32")
    y = [rng.uniform(-1, 1, size=(4, 24, 24, 1)).astype("float32") for _ in gn.architecture.HEADS]
    for _ in range(steps):
        model.train_on_batch(x, y)


@pytest.mark.slow
@pytest.mark.parametrize("optimizer", ["sgd", "rmsprop", "adam"])
def test_copies_stay_together_without_noise_and_part_with_it(optimizer: str) -> None:
    distances = {}
    for noise in (0.0, gn.CORRECTED.wider_noise):
        child = wider(small_ggcnn(), 2, noise=noise)
        kernel = child.get_layer("conv2d_2").get_weights()[0]
        copied = np.random.default_rng(0).integers(4, size=4)
        np.testing.assert_array_equal(kernel[..., 4:], kernel[..., copied])
        train(child, optimizer)
        trained = child.get_layer("conv2d_2").get_weights()[0]
        moved = np.abs(trained - kernel).mean()
        distances[noise] = np.abs(trained[..., 4:] - trained[..., copied]).mean() / moved
    together, apart = distances.values()
    assert together < 1e-4
    assert apart > 0.05


def test_a_skip_connection_widens_all_that_it_adds() -> None:
    inputs = keras.Input((8, 8, 2))
    first = L.Conv2D(3, 3, padding="same", name="first")(inputs)
    second = L.BatchNormalization()(L.Conv2D(3, 3, padding="same", name="second")(L.ReLU()(first)))
    third = L.Conv2DTranspose(3, 3, padding="same", name="third")(second)
    total = L.Add()([first, L.LeakyReLU()(second), third])
    model = keras.Model(inputs, [L.Conv2D(1, 2, name="a")(total), L.Conv2D(2, 1, name="b")(total)])
    randomize(model, 0)
    x = np.random.default_rng(0).normal(size=(2, 8, 8, 2)).astype("float32")
    for layer in ("first", "second", "third"):
        child = wider(model, layer, filters=5, noise=0.3)
        assert [child.get_layer(name).filters for name in ("first", "second", "third")] == [5, 5, 5]
        assert relative_difference(model, child, x) < 1e-5


def test_concatenated_channels_are_widened_apart_and_summed_ones_along() -> None:
    inputs = keras.Input((6, 6, 1))
    left = L.Conv2D(2, 3, padding="same", name="left")(inputs)
    right = L.Conv2D(3, 3, padding="same", name="right")(inputs)
    joined = L.Concatenate()([left, right, left])
    whole = L.Conv2D(7, 3, padding="same", name="whole")(inputs)
    after = L.Conv2D(2, 2, name="after")(joined)
    model = keras.Model(inputs, L.Conv2D(1, 1, name="head")(after))
    summed = keras.Model(inputs, L.Dense(1, name="out")(L.Flatten()(L.Add()([joined, whole]))))
    x = np.random.default_rng(0).normal(size=(2, 6, 6, 1)).astype("float32")
    for network in (model, summed):
        randomize(network, 1)
    child = wider(model, "right", filters=5)
    assert child.get_layer("left").filters == 2
    assert child.get_layer("after").get_weights()[0].shape[2] == 9
    assert relative_difference(model, child, x) < 1e-5
    child = wider(summed, "right", filters=5, noise=0.5)
    assert (child.get_layer("left").filters, child.get_layer("whole").filters) == (2, 9)
    assert relative_difference(summed, child, x) < 1e-5
    child = wider(summed, "left", filters=3)
    assert (child.get_layer("right").filters, child.get_layer("whole").filters) == (3, 9)
    assert relative_difference(summed, child, x) < 1e-5


def test_a_network_in_the_manner_of_ggcnn2() -> None:
    inputs = keras.Input((24, 24, 1))
    x = L.Conv2D(4, 11, padding="same", activation="relu")(inputs)
    x = L.Conv2D(4, 5, padding="same", activation="relu")(x)
    x = L.MaxPooling2D()(x)
    x = L.Conv2D(4, 5, dilation_rate=2, padding="same", activation="relu", name="dilated")(x)
    x = L.Conv2D(4, 5, dilation_rate=4, padding="same", activation="relu")(x)
    x = L.UpSampling2D(2, interpolation="bilinear")(x)
    x = L.Conv2D(4, 3, padding="same", activation="relu")(L.Dropout(0.3)(x))
    model = keras.Model(inputs, [L.Conv2D(1, 1, activation="tanh", name=name)(x) for name in "abcd"])
    child = gn.net2net.apply_operations(model, "wider(1), deeper(dilated), wider(3, factor=1.5), deeper(6), wider(2)")
    image = np.random.default_rng(0).normal(size=(1, 24, 24, 1)).astype("float32")
    assert max_difference(model, child, image) < 1e-5
