"""TensorFlow's SavedModel with one signature, whose input and outputs have the names of the network's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.model_files.export.runtime import INPUT, Job, Runtime, input_size

SIGNATURE = "serving_default"


def write_saved_model(job: Job, path: Path) -> None:
    """Write the folder; its signature takes any number of images."""
    save_signature(job, path, batch=None)


def save_signature(job: Job, path: Path, batch: int | None) -> None:
    """Write a SavedModel whose signature takes `batch` images, or any number."""
    import tensorflow as tf

    model = job.model
    spec = tf.TensorSpec((batch, *input_size(model), 1), tf.float32, name=INPUT)

    @tf.function(input_signature=[spec])
    def maps(depth: tf.Tensor) -> dict[str, tf.Tensor]:
        return dict(zip(HEADS, model(depth, training=False), strict=True))

    module = tf.Module()
    # Of the model only TensorFlow's variables: a converter does not find those inside of Keras' own, and makes NaN.
    module.weights = [weight.value for weight in model.weights]
    tf.saved_model.save(module, str(path), signatures={SIGNATURE: maps})


def open_saved_model(path: Path) -> Runtime:
    """Load the folder with TensorFlow. A signature names its outputs and has no order: that of the heads is taken."""
    import tensorflow as tf

    loaded = tf.saved_model.load(str(path))
    signature = loaded.signatures[SIGNATURE]
    found = set(signature.structured_outputs)
    names = (*(name for name in HEADS if name in found), *sorted(found - set(HEADS)))

    def run(image: Any) -> list[Any]:
        # `loaded` has to live as long as its signature, which does not keep the variables alive.
        maps = loaded.signatures[SIGNATURE](**{INPUT: tf.constant(image)})
        return [maps[name].numpy() for name in names]

    return Runtime(names, run)
