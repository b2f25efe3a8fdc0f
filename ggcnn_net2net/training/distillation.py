"""Distillation: train towards a mixture of the labels and the maps of a teacher."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import TrainingError
from ggcnn_net2net.fast_graph import fast_graph
from ggcnn_net2net.training.checkpoint import fingerprint_of
from ggcnn_net2net.training.data import Batch, TrainingData

if TYPE_CHECKING:
    import keras


class Distilled:
    """Training data that is partly labelled by a teacher; itself `TrainingData`.

    Targets are (1 - weight) · labels + weight · the teacher's maps of the same inputs. For the published loss, the
    squared error over all pixels, that has the gradients of (1 - weight) times the loss against the labels plus weight
    times the squared distance to the teacher. `masked_loss` would take its mask from the mixed quality, of which
    rounding decides where it is above 0, so the protocol must be one without it; `train` refuses the other.

    Args:
        data: images and labels.
        teacher: a trained GG-CNN of the images' size; it is not changed, and must not be while this is in use.
        weight: above 0, which would be the labels alone, to 1, the teacher alone.

    Raises:
        TrainingError: another weight.

    References:
        Hinton, Vinyals and Dean, "Distilling the Knowledge in a Neural Network", 2015 (soft targets beside the labels);
        Romero et al., "FitNets", 2015 (squared distance to the teacher's maps).
    """

    # Why one target will do. With maps f, labels y, teacher t and m = (1 - w) y + w t, each pixel has
    #     (1 - w) (f - y)² + w (f - t)² = f² - 2 f m + (1 - w) y² + w t² = (f - m)² + w (1 - w) (y - t)²,
    # and the last term does not depend on f.

    def __init__(self, data: TrainingData, teacher: keras.Model, weight: float) -> None:
        import tensorflow as tf

        if not 0 < weight <= 1:
            raise TrainingError(f"expected a weight of the teacher above 0 and at most 1, received {weight}")
        self.data = data
        self.teacher = teacher
        self.weight = weight
        maps = fast_graph(teacher)
        self._maps = tf.function(lambda image: maps(image, False), reduce_retracing=True)

    @property
    def fingerprint(self) -> str:
        """Hash of the data, the teacher and its weight."""
        parts = [self.data.fingerprint, fingerprint_of(self.teacher), self.weight]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()

    def __len__(self) -> int:
        """Images an epoch."""
        return len(self.data)

    def batch(self, rows: Sequence[int], epoch: int) -> Batch:
        """Inputs and mixed targets of some rows; may be called from any thread.

        Args:
            rows: indices, in any order.
            epoch: is handed on to the data.

        Returns:
            As of the data, with the teacher's part in the targets.

        Raises:
            TrainingError: the teacher takes images of another size.
        """
        inputs, labels = self.data.batch(rows, epoch)
        expected = tuple(self.teacher.inputs[0].shape[1:])
        if any(size not in (None, given) for size, given in zip(expected, inputs.shape[1:], strict=True)):
            raise TrainingError(
                f"expected images of shape {expected}, as the teacher takes them, received {inputs.shape[1:]}: choose "
                "a teacher of the images' size"
            )
        return inputs, (1 - self.weight) * labels + self.weight * self._taught(inputs)

    def _taught(self, inputs: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """The teacher's maps (n, H, W, 4), one image at a time, so that they do not depend on the rest of the batch."""
        return np.concatenate([self._maps(image[None]).numpy() for image in inputs])
