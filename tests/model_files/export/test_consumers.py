"""The published network, opened by each consumer's own calls and by nothing of ours."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.model_files.export.samples import scene_images


def keras2(path, image):
    import tf_keras

    model = tf_keras.models.load_model(str(path))
    assert model.output_names == list(HEADS)
    return model.predict(image, verbose=0)


def keras3(path, image):
    import keras

    return keras.saving.load_model(path).predict(image, verbose=0)


def saved_model(path, image):
    import tensorflow as tf

    signature = tf.saved_model.load(str(path)).signatures["serving_default"]
    maps = signature(depth=tf.constant(image))
    return [maps[name].numpy() for name in HEADS]


def litert(path, image):
    from ai_edge_litert.interpreter import Interpreter

    interpreter = Interpreter(model_path=str(path))
    maps = interpreter.get_signature_runner("serving_default")(depth=image)
    interpreter.allocate_tensors()
    interpreter.set_tensor(interpreter.get_input_details()[0]["index"], image)
    interpreter.invoke()
    by_position = [interpreter.get_tensor(output["index"]) for output in interpreter.get_output_details()]
    for name, output in zip(HEADS, by_position, strict=True):
        np.testing.assert_array_equal(maps[name], output)
    return by_position


def onnx(path, image):
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path))
    assert [output.name for output in session.get_outputs()] == list(HEADS)
    batch = session.run(None, {"depth": np.concatenate([image, -image])})  # any number of images
    return [output[:1] for output in batch]


def openvino(path, image):
    import openvino

    model = openvino.compile_model(path, "CPU", {"INFERENCE_PRECISION_HINT": "f32"})
    assert [output.get_any_name() for output in model.outputs] == list(HEADS)
    return [model(image)[name] for name in HEADS]


@pytest.mark.parametrize(
    ("name", "consume"),
    [
        ("net.hdf5", keras2),
        ("net.keras", keras3),
        ("net", saved_model),
        ("net.tflite", litert),
        ("net.onnx", onnx),
        ("net.xml", openvino),
    ],
)
def test_consumers_see_the_published_maps(name, consume, data_root, tmp_path):
    model = gn.load_ggcnn("published")
    depth = scene_images(data_root / "cornell", 2, (300, 300))
    path = gn.export(model, tmp_path / name, samples=depth)
    image = (depth[:1] - depth[:1].mean())[..., None].astype(np.float32)
    for ours, theirs in zip(consume(path, image), model(image, training=False), strict=True):
        assert_allclose(ours, np.asarray(theirs), atol=2e-5)
