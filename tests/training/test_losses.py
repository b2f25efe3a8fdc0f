import keras
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.training.losses import MASKED_WEIGHT, losses_of, masked_losses, paper_losses


def batch(seed, n=2, size=5, labelled=0.3):
    random = np.random.default_rng(seed)
    maps, targets = random.normal(size=(2, n, size, size, 4)).astype(np.float32)
    targets[..., 0] = random.random((n, size, size)) < labelled
    return maps, targets


def test_protocols_choose_the_loss():
    assert losses_of(PAPER) is paper_losses
    assert losses_of(CORRECTED) is masked_losses


def test_paper_loss_is_mse_on_four_heads():
    maps, targets = batch(0)
    mse = keras.losses.MeanSquaredError()
    expected = [float(mse(targets[..., head : head + 1], maps[..., head : head + 1])) for head in range(4)]
    np.testing.assert_allclose(paper_losses(maps, targets).numpy(), expected, rtol=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.02, 0.5, 1.0]))
def test_masked_loss_is_the_mean_over_labelled_pixels(seed, labelled):
    maps, targets = batch(seed, labelled=labelled)
    errors = [
        [float(maps[i][j] - targets[i][j]) ** 2 for i in np.ndindex(2, 5, 5) if j == 0 or targets[i][0] > 0]
        for j in range(4)
    ]
    expected = [np.mean(errors[0])] + [MASKED_WEIGHT * np.mean(e) if e else 0.0 for e in errors[1:]]
    np.testing.assert_allclose(masked_losses(maps, targets).numpy(), expected, rtol=1e-5)


def test_masked_loss_does_not_see_the_background():
    import tensorflow as tf

    maps, targets = batch(1)
    maps = tf.constant(maps)
    with tf.GradientTape() as tape:
        tape.watch(maps)
        loss = tf.reduce_sum(masked_losses(maps, tf.constant(targets)))
    gradient = tape.gradient(loss, maps).numpy()
    background = targets[..., 0] == 0
    assert background.any()
    assert (gradient[background][:, 1:] == 0).all()
    assert (gradient[~background] != 0).all()
    assert (gradient[..., 0] != 0).all()


def test_masked_loss_of_images_without_labels_has_finite_gradients():
    import tensorflow as tf

    maps, targets = batch(2, labelled=0.0)
    maps = tf.constant(maps)
    with tf.GradientTape() as tape:
        tape.watch(maps)
        losses = masked_losses(maps, tf.constant(targets))
    assert losses.numpy()[1:] == pytest.approx(0)
    assert np.isfinite(tape.gradient(losses, maps).numpy()).all()
