import sys
import threading

import keras
import numpy as np
import pytest
import tensorflow as tf

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.errors import ArchitectureError, DepthImageError, MissingExtraError
from ggcnn_net2net.inference.network import BACKENDS, compiled_network
from ggcnn_net2net.model_files.torch_ggcnn import build_torch_ggcnn

SIZE = 60
# One kernel of four filters may add in another order than four of one, and another runtime rounds otherwise.
TOLERANCE = {"tensorflow": 1e-7, "openvino": 1e-5}


@pytest.fixture(scope="module")
def images():
    return np.random.default_rng(0).normal(0, 0.1, (3, SIZE, SIZE)).astype(np.float32)


def maps_of(model, images):
    return np.stack([np.stack([head[0, ..., 0] for head in model(image[None, ..., None])]) for image in images])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ["original", "optimized", "C7x7x5s2_C4x4x3s1_T5x5x3s1_T6x6x7s2", "pytorch"])
def test_maps_are_those_of_the_model(backend, name, images):
    model = build_torch_ggcnn(SIZE) if name == "pytorch" else gn.build_ggcnn(name, input_size=SIZE, seed=1)
    received = compiled_network(model, backend)(images)
    assert received.dtype == np.float32
    np.testing.assert_allclose(received, maps_of(model, images), rtol=0, atol=TOLERANCE[backend])


@pytest.mark.parametrize("backend", BACKENDS)
def test_images_of_other_sizes_are_those_of_a_network_of_that_size(backend):
    image = np.random.default_rng(1).normal(0, 0.1, (1, 48, 84)).astype(np.float32)
    model = gn.build_ggcnn("original", input_size=SIZE, seed=1)
    free = keras.models.clone_model(model, input_tensors=keras.Input((48, 84, 1)))
    free.set_weights(model.get_weights())
    received = compiled_network(model, backend)(image)
    np.testing.assert_allclose(received, maps_of(free, image), rtol=0, atol=TOLERANCE[backend])


def test_a_size_that_the_strides_do_not_divide_is_refused():
    network = compiled_network(gn.build_ggcnn("original", input_size=SIZE))
    with pytest.raises(DepthImageError, match="multiple"):
        network(np.zeros((1, 50, 70)))


def test_a_network_that_is_not_convolutional_takes_its_own_size_alone():
    inputs = keras.Input((SIZE, SIZE, 1))
    dense = keras.layers.Dense(SIZE * SIZE)(keras.layers.Flatten()(inputs))
    features = keras.layers.Reshape((SIZE, SIZE, 1))(dense)
    model = keras.Model(inputs, [keras.layers.Conv2D(1, 2, padding="same", name=head)(features) for head in HEADS])
    network = compiled_network(model)
    assert network(np.zeros((1, SIZE, SIZE))).shape == (1, 4, SIZE, SIZE)
    with pytest.raises(DepthImageError, match=r"expected images of \(60, 60\)"):
        network(np.zeros((1, 72, 72)))


@pytest.mark.parametrize("shape", [(SIZE, SIZE), (1, SIZE, SIZE, 1), (1, 0, SIZE)])
def test_arrays_that_are_no_stack_of_images_are_refused(shape):
    with pytest.raises(DepthImageError, match="expected images as"):
        compiled_network(gn.build_ggcnn("narrow", input_size=SIZE))(np.zeros(shape))


def test_no_images_have_no_maps():
    assert compiled_network(gn.build_ggcnn("narrow", input_size=SIZE))(np.zeros((0, 60, 60))).shape == (0, 4, 60, 60)


def test_a_size_is_compiled_once(images, monkeypatch):
    traced = []
    monkeypatch.setattr("ggcnn_net2net.inference.network.fast_graph", lambda model: lambda image, _: count(image))

    def count(image):
        traced.append(image.shape)
        return tf.concat([image] * 4, axis=-1)

    network = compiled_network(gn.build_ggcnn("narrow", input_size=SIZE))
    for stack in (images, images[:1], images.astype(np.float64), images[:, ::-1], images[:, :48, :48], images):
        network(stack)
    assert traced == [(1, 60, 60, 1), (1, 48, 48, 1)]


def test_later_training_does_not_reach_a_compiled_network(images):
    model = gn.build_ggcnn("narrow", input_size=SIZE, seed=1)
    network = compiled_network(model)
    before = network(images)
    model.set_weights([np.zeros_like(weight) for weight in model.get_weights()])
    np.testing.assert_array_equal(network(images), before)


@pytest.mark.parametrize("backend", BACKENDS)
def test_threads_get_their_own_results(backend, images):
    network = compiled_network(gn.build_ggcnn("narrow", input_size=SIZE, seed=1), backend)
    expected = [network(images[[number]]) for number in range(3)]
    received = {}

    def run(number):
        received[number] = [network(images[[number % 3]]) for _ in range(20)]

    threads = [threading.Thread(target=run, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number, results in received.items():
        for result in results:
            np.testing.assert_array_equal(result, expected[number % 3])
    assert len(received) == 6


def test_unknown_and_missing_backends_are_named(monkeypatch):
    model = gn.build_ggcnn("narrow", input_size=SIZE)
    with pytest.raises(ArchitectureError, match="tensorflow, openvino, received 'onnx'"):
        compiled_network(model, "onnx")
    monkeypatch.setitem(sys.modules, "openvino", None)
    with pytest.raises(MissingExtraError, match=r"ggcnn_net2net\[export\]"):
        compiled_network(model, "openvino")
