"""Write a GG-CNN to a file that other versions of Keras open."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ggcnn_net2net import atomic
from ggcnn_net2net.errors import ModelFileError
from ggcnn_net2net.model_files import hdf5, keras_archive
from ggcnn_net2net.model_files.check import check_ggcnn

if TYPE_CHECKING:
    import keras

_WRITERS: dict[str, Callable[[keras.Model, Path, list[dict[str, Any]]], None]] = {
    **dict.fromkeys(hdf5.SUFFIXES, hdf5.write_hdf5),
    **dict.fromkeys(keras_archive.SUFFIXES, keras_archive.write_keras),
}


def save_ggcnn(model: keras.Model, path: str | Path) -> Path:
    """Write a GG-CNN with its operation history, whole or not at all.

    Args:
        model: the network.
        path: where to; the suffix chooses the format. `.hdf5` and `.h5` are the schema of Keras 2.0, which every
            Keras since then opens (tf_keras, and Keras 3 with `compile=False`), without optimizer. `.keras` is
            Keras 3's own format, with the optimizer if the model is compiled with one of Keras' own.

    Returns:
        The path.

    Raises:
        ModelFileError: another suffix, or `model` is not a working GG-CNN.
    """
    from ggcnn_net2net.net2net.history import history_of

    path = Path(path)
    check_writable(path)
    check_ggcnn(model, origin=f"the model for {path}")
    with atomic.replacing(path) as temporary:
        _WRITERS[path.suffix](model, temporary, history_of(model))
    return path


def check_writable(path: Path, *inputs: Path | None) -> None:
    """See before the work that its result can be written.

    Args:
        path: what is to be written.
        inputs: files that are read; None is passed over.

    Raises:
        ModelFileError: `save_ggcnn` does not know the suffix of `path`, or `path` is one of the `inputs`, which would
            be lost.
    """
    if path.suffix not in _WRITERS:
        raise ModelFileError(
            f"expected an output file with one of the suffixes {', '.join(_WRITERS)}, received {str(path)!r}"
        )
    if atomic.is_one_of(path, inputs):
        raise ModelFileError(f"expected another output file than the input, received {str(path)!r} for both")
