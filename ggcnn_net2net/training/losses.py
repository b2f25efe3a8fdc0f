"""The loss of a GG-CNN: as published, and with what lies outside of the labels left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ggcnn_net2net.protocol import Protocol

if TYPE_CHECKING:
    import tensorflow as tf

HeadLosses = Callable[["tf.Tensor", "tf.Tensor"], "tf.Tensor"]
"""(maps (n, H, W, 4), targets (n, H, W, 4)) -> loss of each head (4,); their sum is the loss."""

MASKED_WEIGHT = 0.03
"""Weight of cos, sin and width in the masked loss: about the share of the pixels of Cornell samples that is labelled.
A labelled pixel then counts as in the published loss, where only background is added, and quality is not drowned."""


def losses_of(protocol: Protocol) -> HeadLosses:
    """The loss that `protocol` asks for."""
    return masked_losses if protocol.masked_loss else paper_losses


def paper_losses(maps: tf.Tensor, targets: tf.Tensor) -> tf.Tensor:
    """Mean squared error of each head over all pixels of all images, as Keras' "mse" on four heads."""
    import tensorflow as tf

    errors = tf.square(maps - targets)
    return _sum_of_pixels(errors) / _n_pixels(errors)


def masked_losses(maps: tf.Tensor, targets: tf.Tensor) -> tf.Tensor:
    """Squared errors of quality over all pixels, those of cos, sin and width over the labelled ones.

    Quality: mean over all pixels, as published. The others: `MASKED_WEIGHT` times the mean over all pixels of the batch
    whose target quality is above 0; 0 for a batch without such pixels.

    Args:
        maps: (n, H, W, 4) predictions in the order of the heads.
        targets: (n, H, W, 4).

    Returns:
        (4,) losses of the heads.
    """
    import tensorflow as tf

    labelled = tf.cast(targets[..., :1] > 0, targets.dtype)
    of_pixel = 1 / _n_pixels(targets)
    of_labelled = MASKED_WEIGHT / tf.maximum(_sum_of_pixels(labelled)[0], 1.0)
    # One weight for each error, because taking the heads' errors apart is slow backwards.
    weights = labelled * [0.0, of_labelled, of_labelled, of_labelled] + [of_pixel, 0.0, 0.0, 0.0]
    return _sum_of_pixels(weights * tf.square(maps - targets))


def _sum_of_pixels(images: tf.Tensor) -> tf.Tensor:
    """(n, H, W, channels) -> (channels,)."""
    import tensorflow as tf

    # First along the rows: one sum over 360,000 pixels would lose five bits to rounding.
    return tf.reduce_sum(tf.reduce_sum(images, axis=2), axis=(0, 1))


def _n_pixels(images: tf.Tensor) -> tf.Tensor:
    import tensorflow as tf

    return tf.cast(tf.reduce_prod(tf.shape(images)[:3]), images.dtype)
