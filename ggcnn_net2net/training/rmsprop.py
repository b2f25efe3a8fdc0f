"""The optimizer that GG-CNN was trained with: RMSprop as Keras 2 computes it."""

from __future__ import annotations

from typing import Any

import keras
from keras import ops


@keras.saving.register_keras_serializable(package="ggcnn_net2net")
class Keras2RMSprop(keras.optimizers.Optimizer):
    """RMSprop with epsilon outside of the root: a = ρa + (1 - ρ)g², w -= lr · g / (sqrt(a) + ε).

    Keras 3 divides by sqrt(a + ε). Late in the training of a GG-CNN most of its a are far below ε = 1e-7, and
    steps shrink to a few per cent: there Keras 3's "rmsprop" is not the optimizer of the paper.

    Args:
        learning_rate: a float or a `keras.optimizers.schedules.LearningRateSchedule`.
        rho: ρ above.
        epsilon: ε above; 1e-7 is Keras 2's default. The published file was trained with 1e-8.
        name: name of the optimizer.
        **options: of `keras.optimizers.Optimizer`, such as `clipnorm`.

    References:
        `keras/optimizers.py` of Keras 2.0.8, class RMSprop.
    """

    def __init__(
        self, learning_rate: Any = 1e-3, rho: float = 0.9, epsilon: float = 1e-7, name: str = "rmsprop", **options: Any
    ) -> None:
        super().__init__(learning_rate=learning_rate, name=name, **options)
        self.rho = rho
        self.epsilon = epsilon

    def build(self, variables: list[Any]) -> None:
        """Make one accumulator, a, a variable."""
        if self.built:
            return
        super().build(variables)
        self._squares = self.add_optimizer_variables(variables, "velocity")

    def update_step(self, gradient: Any, variable: Any, learning_rate: Any) -> None:
        """Update one variable."""
        rate = ops.cast(learning_rate, variable.dtype)
        gradient = ops.cast(gradient, variable.dtype)
        squares = self._squares[self._get_variable_index(variable)]
        updated = self.rho * squares + (1.0 - self.rho) * ops.square(gradient)
        self.assign(squares, updated)
        self.assign_sub(variable, rate * gradient / (ops.sqrt(updated) + self.epsilon))

    def get_config(self) -> dict[str, Any]:
        """Everything that `from_config` needs."""
        return {**super().get_config(), "rho": self.rho, "epsilon": self.epsilon}
