import keras
import numpy as np
import pytest
import tensorflow as tf

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS, NAMED
from ggcnn_net2net.fast_graph import fast_graph
from ggcnn_net2net.model_files.torch_ggcnn import build_torch_ggcnn

SIZE = 60
RANDOM = "C7x7x5s2_C4x4x3s1_T5x5x3s1_T6x6x7s2"
NETWORKS = [*NAMED, RANDOM]


@pytest.fixture(scope="module")
def images():
    random = np.random.default_rng(0)
    return random.normal(0, 0.1, (2, SIZE, SIZE, 1)), random.random((2, SIZE, SIZE, len(HEADS)))


def network(name):
    if name == "pytorch":
        return build_torch_ggcnn(SIZE)
    return gn.build_ggcnn(name, input_size=SIZE, seed=3)


def in_float64(model):
    """The same network in double precision, where rounding cannot hide a mistake."""

    def clone(layer):
        return type(layer).from_config({**layer.get_config(), "dtype": "float64"})

    double = keras.models.clone_model(model, clone_function=clone)
    double.set_weights(model.get_weights())
    return double


def gradients(function, model, images):
    inputs, targets = images

    @tf.function
    def compute():
        with tf.GradientTape() as tape:
            maps = function(tf.constant(inputs), True)
            loss = tf.reduce_sum(tf.reduce_mean(tf.square(maps - targets), axis=(0, 1, 2)))
        return maps, tape.gradient(loss, model.trainable_variables)

    maps, found = compute()
    return [maps.numpy(), *(gradient.numpy() for gradient in found)]


@pytest.mark.parametrize("name", [*NETWORKS, "pytorch"])
def test_maps_and_gradients_are_those_of_the_model(name, images):
    model = in_float64(network(name))

    def four_heads(inputs, training):
        return tf.concat(model(inputs, training=training), axis=-1)

    expected = gradients(four_heads, model, images)
    received = gradients(fast_graph(model), model, images)
    assert len(received) == len(model.weights) + 1
    for one, other in zip(received, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12 * abs(other).max())


def count(model, kind):
    function = tf.function(lambda inputs: fast_graph(model)(inputs, False))
    graph = function.get_concrete_function(tf.TensorSpec((1, SIZE, SIZE, 1))).graph
    return sum(operation.type == kind for operation in graph.get_operations())


def test_four_heads_are_one_convolution():
    assert count(network("original"), "Conv2D") == 3 + 1


@pytest.mark.parametrize("change", [{"kernel_size": 3}, {"activation": "tanh"}, {"use_bias": False}])
def test_heads_of_different_forms_run_as_they_are(change, images):
    inputs = keras.Input((SIZE, SIZE, 1))
    features = keras.layers.Conv2D(3, 3, padding="same", activation="relu")(inputs)
    options = [{"kernel_size": 2}, {"kernel_size": 2, **change}, {"kernel_size": 2}, {"kernel_size": 2}]
    model = keras.Model(
        inputs,
        [
            keras.layers.Conv2D(1, padding="same", name=head, **option)(features)
            for head, option in zip(HEADS, options, strict=True)
        ],
    )
    assert count(model, "Conv2D") == 1 + 4
    expected = np.concatenate([output.numpy() for output in model(images[0])], axis=-1)
    np.testing.assert_array_equal(fast_graph(model)(tf.constant(images[0]), False).numpy(), expected)


def test_a_body_of_half_precision(images):
    inputs = keras.Input((SIZE, SIZE, 1))
    features = keras.layers.Conv2D(3, 3, padding="same", dtype="mixed_float16")(inputs)
    model = keras.Model(inputs, [keras.layers.Conv2D(1, 2, padding="same", name=head)(features) for head in HEADS])
    expected = np.concatenate([output.numpy() for output in model(images[0])], axis=-1)
    received = fast_graph(model)(tf.constant(images[0], tf.float32), False).numpy()
    np.testing.assert_allclose(received, expected, atol=1e-6)


def test_heads_of_different_tensors_run_as_they_are():
    inputs = keras.Input((SIZE, SIZE, 1))
    model = keras.Model(
        inputs,
        [
            keras.layers.Conv2D(1, 2, padding="same", name=head)(keras.layers.Conv2D(2, 3, padding="same")(inputs))
            for head in HEADS
        ],
    )
    assert count(model, "Conv2D") == 8


def test_heads_that_another_model_has_used_first_are_those_of_this_model(images):
    model = network("narrow")
    below = keras.Model(model.inputs, model.layers[-5].output)
    halved = keras.Input((SIZE, SIZE, 1))
    other = keras.Model(halved, [head(below(halved * 0.5)) for head in model.layers[-4:]])
    expected = np.concatenate([output.numpy() for output in other(images[0])], axis=-1)
    np.testing.assert_allclose(fast_graph(other)(tf.constant(images[0]), False).numpy(), expected, atol=1e-6)
