"""One step of training, compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.fast_graph import fast_graph
from ggcnn_net2net.training.losses import HeadLosses

if TYPE_CHECKING:
    import keras
    import tensorflow as tf

Step = Callable[[Any, Any], tuple["tf.Tensor", "tf.Tensor"]]
"""(inputs, targets) -> loss of each head (4,), norm of the gradient."""
Evaluation = Callable[[Any, Any], "tf.Tensor"]
"""(inputs, targets) -> loss of each head (4,)."""


def step_and_loss(model: keras.Model, head_losses: HeadLosses) -> tuple[Step, Evaluation]:
    """The functions that train and that validate `model`, compiled, but not with XLA.

    Args:
        model: compiled with the optimizer that takes the steps.
        head_losses: the loss.

    Returns:
        A function that changes the weights, and one that gives the loss alone.
    """
    import tensorflow as tf

    maps = fast_graph(model)

    @tf.function
    def step(inputs: tf.Tensor, targets: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
        with tf.GradientTape() as tape:
            losses = head_losses(maps(inputs, True), targets)
            total = tf.add_n([tf.reduce_sum(losses), *model.losses])  # the others are regularizers of the layers
        variables = model.trainable_variables
        gradients = tape.gradient(total, variables)
        model.optimizer.apply(gradients, variables)
        return losses, tf.linalg.global_norm(gradients)

    @tf.function(reduce_retracing=True)
    def evaluate(inputs: tf.Tensor, targets: tf.Tensor) -> tf.Tensor:
        return head_losses(maps(inputs, False), targets)

    return step, evaluate
