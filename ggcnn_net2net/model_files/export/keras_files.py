"""Keras' own files: `.keras` for Keras 3, and the Keras 2 `.hdf5` that old grasp stacks give to `load_model`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ggcnn_net2net.model_files.check import output_names
from ggcnn_net2net.model_files.export.runtime import Job, Runtime
from ggcnn_net2net.model_files.save import save_ggcnn


def write_keras(job: Job, path: Path) -> None:
    """Write either file; the suffix decides."""
    save_ggcnn(job.model, path)


def open_keras3(path: Path) -> Runtime:
    """Open a `.keras` file with Keras 3."""
    import keras

    model = keras.models.load_model(path, compile=False)
    return Runtime(tuple(output_names(model)), lambda image: _run(model, image))


def open_keras2(path: Path) -> Runtime:
    """Open an `.hdf5` file with Keras 2, as the public GG-CNN nodes do."""
    import tf_keras

    model = tf_keras.models.load_model(str(path))
    return Runtime(tuple(model.output_names), lambda image: _run(model, image))


def _run(model: Any, image: Any) -> list[Any]:
    return [output.numpy() for output in model(image, training=False)]
