import keras
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ggcnn_net2net.training.rmsprop import Keras2RMSprop

# From far below epsilon to far above it: there the forms differ, and here they do not.
MAGNITUDES = [1e-9, 1e-7, 1e-5, 1e-3, 1.0]


def steps(optimizer, gradients, variable_class=keras.Variable):
    weight = variable_class(np.zeros(gradients.shape[1], np.float32))
    values = []
    for gradient in gradients:
        optimizer.apply_gradients([(keras.ops.convert_to_tensor(gradient), weight)])
        values.append(np.asarray(weight))
    return np.array(values)


@pytest.fixture(scope="module")
def gradients():
    random = np.random.default_rng(0)
    return (random.normal(size=(20, len(MAGNITUDES))) * MAGNITUDES).astype(np.float32)


def test_steps_are_those_of_keras_2(gradients):
    import tensorflow as tf
    import tf_keras

    keras_2 = tf_keras.optimizers.legacy.RMSprop(1e-3)
    expected = steps(keras_2, gradients, tf.Variable)
    np.testing.assert_allclose(steps(Keras2RMSprop(1e-3), gradients), expected, rtol=1e-5, atol=1e-8)


def test_keras_3_is_another_optimizer(gradients):
    keras_3 = steps(keras.optimizers.RMSprop(1e-3), gradients)
    ours = steps(Keras2RMSprop(1e-3), gradients)
    ratio = abs(keras_3[0] / ours[0])
    assert ratio[1] < 0.01  # a gradient of about epsilon
    assert ratio[-1] == pytest.approx(1, abs=1e-3)


@settings(max_examples=25, deadline=None)
@given(
    arrays(np.float32, (4, 3), elements=st.floats(-10, 10, width=32)),
    st.sampled_from([1e-4, 1e-3, 0.1]),
    st.sampled_from([0.0, 0.5, 0.9]),
    st.sampled_from([1e-8, 1e-7, 1e-3]),
)
def test_steps_are_those_of_the_formula(gradients, rate, rho, epsilon):
    weight, squares = np.zeros(3), np.zeros(3)
    received = steps(Keras2RMSprop(rate, rho, epsilon), gradients)
    for gradient, value in zip(gradients.astype(float), received, strict=True):
        squares = rho * squares + (1 - rho) * gradient**2
        weight = weight - rate * gradient / (np.sqrt(squares) + epsilon)
        np.testing.assert_allclose(value, weight, rtol=1e-3, atol=1e-5 * rate)


def test_config_makes_the_same_optimizer(gradients):
    optimizer = Keras2RMSprop(0.01, rho=0.8, epsilon=1e-6)
    again = keras.optimizers.deserialize(keras.optimizers.serialize(optimizer))
    assert isinstance(again, Keras2RMSprop)
    np.testing.assert_array_equal(steps(again, gradients), steps(optimizer, gradients))


def test_takes_a_schedule(gradients):
    halved = keras.optimizers.schedules.InverseTimeDecay(1e-3, 1, 1.0)  # Keras 2's decay=1
    moved = np.diff(steps(Keras2RMSprop(halved), gradients), axis=0)
    reference = np.diff(steps(Keras2RMSprop(1e-3), gradients), axis=0)
    np.testing.assert_allclose(moved[0], reference[0] / 2, rtol=1e-3)
    np.testing.assert_allclose(moved[3], reference[3] / 5, rtol=1e-3)
