from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import keras
import numpy as np
import pytest
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st
from training_images import SyntheticGrasps, sha256_of_weights

import ggcnn_net2net as gn
from ggcnn_net2net.errors import TrainingError
from ggcnn_net2net.protocol import CORRECTED
from ggcnn_net2net.training import Recipe, train
from ggcnn_net2net.training.distillation import Distilled
from ggcnn_net2net.training.losses import paper_losses

WEIGHTS = st.floats(0, 1, exclude_min=True)
TINY = "C3x3x2_T3x3x2"


@pytest.fixture(scope="module")
def teacher():
    """A network of other form than the student."""
    return gn.build_ggcnn("shallow", input_size=36, seed=7)


def in_float64(model):
    """The same network in double precision, where rounding cannot hide a mistake."""

    def clone(layer):
        return type(layer).from_config({**layer.get_config(), "dtype": "float64"})

    double = keras.models.clone_model(model, clone_function=clone)
    double.set_weights(model.get_weights())
    return double


class InDouble(SyntheticGrasps):
    """The same images in double precision."""

    def batch(self, rows, epoch):
        inputs, targets = super().batch(rows, epoch)
        return inputs.astype(np.float64), targets.astype(np.float64)


def maps_of(model, inputs):
    return np.concatenate([np.asarray(head) for head in model(inputs, training=False)], axis=-1)


@given(weight=WEIGHTS, rows=st.lists(st.integers(0, 4), min_size=1, max_size=6))
@settings(deadline=None, max_examples=30)
def test_targets_are_labels_and_maps_mixed(weight, rows):
    data = InDouble(5, 8, seed=3)
    network = in_float64(gn.build_ggcnn(TINY, input_size=8, seed=7))
    labels = data.batch(rows, 0)[1]
    inputs, targets = Distilled(data, network, weight).batch(rows, 0)
    np.testing.assert_array_equal(inputs, data.batch(rows, 0)[0])
    np.testing.assert_allclose(targets, labels + weight * (maps_of(network, inputs) - labels), rtol=0, atol=1e-12)


@given(weight=WEIGHTS, seeds=st.tuples(st.integers(0, 99), st.integers(100, 199)))
@settings(deadline=None, max_examples=15)
def test_mixed_targets_have_the_gradients_of_mixed_losses(weight, seeds):
    data = InDouble(3, 8, seed=seeds[0])
    student, teacher = (in_float64(gn.build_ggcnn(TINY, input_size=8, seed=seed)) for seed in seeds)
    inputs, labels = data.batch(range(3), 0)
    mixed = Distilled(data, teacher, weight).batch(range(3), 0)[1]
    taught = maps_of(teacher, inputs)

    def gradients(loss):
        with tf.GradientTape() as tape:
            value = tf.reduce_sum(loss(tf.concat(student(inputs, training=True), axis=-1)))
        return tape.gradient(value, student.trainable_variables)

    ours = gradients(lambda maps: paper_losses(maps, mixed))
    expected = gradients(lambda maps: (1 - weight) * paper_losses(maps, labels) + weight * paper_losses(maps, taught))
    for one, other in zip(ours, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


def test_it_is_training_data(grasps, teacher):
    distilled = Distilled(grasps, teacher, 0.5)
    inputs, targets = distilled.batch([3, 1], 0)
    assert len(distilled) == len(grasps)
    assert inputs.dtype == targets.dtype == np.float32
    assert targets.shape == (2, 36, 36, 4)
    np.testing.assert_allclose(Distilled(grasps, teacher, 1).batch([3], 0)[1], maps_of(teacher, inputs[:1]), atol=1e-6)


def test_targets_depend_neither_on_the_batch_nor_on_the_thread(grasps, teacher):
    rows = list(range(12))
    together = Distilled(grasps, teacher, 0.5).batch(rows, 0)[1]
    shared = Distilled(grasps, teacher, 0.5)  # its first call comes from several threads at once
    with ThreadPoolExecutor(8) as pool:
        batches = [rows[start : start + size] for size in (1, 2, 3) for start in rows]
        for part, (_, targets) in zip(batches, pool.map(lambda part: shared.batch(part, 0), batches), strict=True):
            np.testing.assert_array_equal(targets, together[part])


def test_augmentations_of_an_epoch_reach_the_teacher(teacher):
    class Shifted(SyntheticGrasps):
        def batch(self, rows, epoch):
            inputs, targets = super().batch(rows, epoch)
            return inputs + np.float32(epoch), targets

    inputs, targets = Distilled(Shifted(2, 36), teacher, 1).batch([0, 1], 5)
    np.testing.assert_allclose(targets, maps_of(teacher, inputs), atol=1e-5)


def test_fingerprint_is_of_data_teacher_and_weight(grasps, teacher):
    variants = [
        Distilled(grasps, teacher, 0.5),
        Distilled(grasps, teacher, 0.25),
        Distilled(SyntheticGrasps(12, 36, seed=1), teacher, 0.5),
        Distilled(grasps, gn.build_ggcnn("shallow", input_size=36, seed=8), 0.5),
    ]
    assert len({variant.fingerprint for variant in variants} | {grasps.fingerprint}) == 5
    assert Distilled(grasps, teacher, 0.5).fingerprint == variants[0].fingerprint


def test_a_student_comes_closer_to_its_teacher_than_by_the_labels_alone(small, grasps):
    # The teacher learnt the same images with other angles and openings, so that the labels lead elsewhere.
    other = SyntheticGrasps(12, 36, seed=0)
    other.targets = np.where(other.targets[..., :1] > 0, np.float32([1, -1, 0, 1]), other.targets)
    teacher = train(gn.build_ggcnn("narrow", input_size=36, seed=4), other, Recipe(epochs=15)).model
    taught = maps_of(teacher, grasps.inputs)

    def distance(student):
        return float(np.square(maps_of(student, grasps.inputs) - taught).mean())

    recipe = Recipe(epochs=30)
    alone, half, whole = (
        distance(train(small, data, recipe).model)
        for data in (grasps, Distilled(grasps, teacher, 0.5), Distilled(grasps, teacher, 1))
    )
    assert whole < half < 0.7 * alone
    assert whole < 0.3 * alone < 0.3 * distance(small)


def test_training_twice_gives_the_same_bits_and_goes_on_from_its_checkpoint(small, grasps, teacher, tmp_path):
    def trained(epochs, **options):
        data = Distilled(grasps, teacher, 0.5)
        return sha256_of_weights(train(small, data, Recipe(epochs=epochs), validation=data, **options).model)

    once = trained(3)
    assert trained(3) == once
    trained(2, checkpoint_dir=tmp_path)
    assert trained(3, checkpoint_dir=tmp_path) == once
    with pytest.raises(TrainingError, match="another data"):
        train(small, Distilled(grasps, teacher, 0.4), Recipe(epochs=3), checkpoint_dir=tmp_path)


@pytest.mark.parametrize("weight", [0, -0.1, 1.1, float("nan")])
def test_an_impossible_weight_is_refused(grasps, teacher, weight):
    with pytest.raises(TrainingError, match="above 0 and at most 1, received"):
        Distilled(grasps, teacher, weight)


def test_a_teacher_of_another_size_is_refused(small, teacher):
    with pytest.raises(TrainingError, match=r"shape \(36, 36, 1\), as the teacher takes them, received \(48, 48, 1\)"):
        train(gn.build_ggcnn("narrow", input_size=48), Distilled(SyntheticGrasps(12, 48), teacher, 0.5), Recipe())


def test_the_masked_loss_is_refused(small, grasps, teacher):
    distilled = Distilled(grasps, teacher, 0.5)
    for data, validation in ((distilled, None), (grasps, distilled)):
        with pytest.raises(TrainingError, match=r"masked_loss=False\)"):
            train(small, data, Recipe(epochs=1, protocol=CORRECTED), validation=validation)
    train(small, distilled, Recipe(epochs=1, protocol=replace(CORRECTED, masked_loss=False)))
