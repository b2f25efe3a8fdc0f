"""Load a GG-CNN from a file of any format that one was ever stored in."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ggcnn_net2net import reference_data, zoo
from ggcnn_net2net.errors import DataNotFoundError, ModelFileError
from ggcnn_net2net.model_files import hdf5, keras_archive, torch_ggcnn
from ggcnn_net2net.model_files.check import check_ggcnn
from ggcnn_net2net.model_files.published import PUBLISHED_SHA256, published_weights
from ggcnn_net2net.model_files.stored_model import StoredModel
from ggcnn_net2net.reference_data import sha256_of

if TYPE_CHECKING:
    import keras

PUBLISHED = "published"

_READERS: dict[str, Callable[[Path], StoredModel]] = {
    **dict.fromkeys(hdf5.SUFFIXES, hdf5.read_hdf5),
    **dict.fromkeys(keras_archive.SUFFIXES, keras_archive.read_keras),
    **dict.fromkeys(torch_ggcnn.SUFFIXES, torch_ggcnn.read_torch),
}


def load_ggcnn(source: str | Path) -> keras.Model:
    """Load a GG-CNN, or a close relative with the same four heads.

    Args:
        source: "published" for the network of the GG-CNN authors, "zoo:NAME" for one of this project (`zoo.names()`),
            or the path of a model file: .hdf5 or .h5 of Keras 2 or 3, .keras, or the PyTorch state_dict of the GG-CNN
            authors (.pt, .pth).

    Returns:
        A plain, uncompiled `keras.Model`: input (batch, 300, 300, 1), depth in metres minus the image's mean; outputs
        pos_out, cos_out, sin_out, width_out, each (batch, 300, 300, 1). Its operation history is that of the file.

    Warns:
        StandInWarning: the published file is nowhere, and the zoo's retrained network is used in its place.

    Raises:
        DataNotFoundError: the published file is nowhere, and nothing stands in for it.
        VerificationError: the published file, or one of the zoo, has a wrong SHA-256.
        ModelFileError: no such file, damaged, not a GG-CNN, heads missing or in another order, NaN weights, or a file
            that carries code (a Lambda layer, a custom object, a pickle of more than tensors).
    """
    path = source_path(source)
    stored = read_model_file(path)
    check_ggcnn(stored.model, origin=str(path))
    return stored.model


def source_path(source: str | Path) -> Path:
    """The existing file that `source`, a path, "published" or "zoo:NAME", means.

    Warns:
        StandInWarning: as `load_ggcnn`.

    Raises:
        ModelFileError: there is no such file, or no such network in the zoo.
        DataNotFoundError, VerificationError: as `load_ggcnn`.
    """
    name = str(source)
    if name == PUBLISHED:
        return _published_or_stand_in()
    if name.startswith(zoo.PREFIX):
        return zoo.network_file(name.removeprefix(zoo.PREFIX))
    path = Path(source)
    if not path.is_file():
        raise ModelFileError(
            f'expected a model file, {PUBLISHED!r} or "{zoo.PREFIX}NAME", received {name!r}, which is no file'
        )
    return path


def opened_name(source: str | Path, path: Path) -> str:
    """How records name what was opened.

    Args:
        source: as the user said it.
        path: what `source_path` made of it.

    Returns:
        `source`; "zoo:..." where the stand-in took the place of the published network.
    """
    if str(source) == PUBLISHED and sha256_of(path) != PUBLISHED_SHA256:
        return f"{zoo.PREFIX}{zoo.STAND_IN}"
    return str(source)


def _published_or_stand_in() -> Path:
    reference_data.data_root()  # a variable that names no folder is to be corrected, not to be worked around
    try:
        return published_weights()
    except DataNotFoundError as error:
        if zoo.STAND_IN not in zoo.names():
            raise
        path = zoo.network_file(zoo.STAND_IN)
        warnings.warn(
            f"NOT THE PUBLISHED NETWORK: {zoo.PREFIX}{zoo.STAND_IN} stands in for it, a network of the same "
            "architecture that this project trained, with other weights and other results. Why, and how to get the "
            f"real one: {error}",
            zoo.StandInWarning,
            stacklevel=3,
        )
        return path


def read_model_file(path: Path) -> StoredModel:
    """Read a model file of any known format, without checking that the model is a GG-CNN.

    Raises:
        ModelFileError: unknown suffix, damaged, or a model that cannot be rebuilt safely.
    """
    from ggcnn_net2net.net2net.history import set_history

    reader = _READERS.get(path.suffix)
    if reader is None:
        raise ModelFileError(
            f"expected a model file with one of the suffixes {', '.join(_READERS)}, received {str(path)!r}: convert it "
            "or correct its name"
        )
    try:
        stored = reader(path)
    except ModelFileError as error:
        raise ModelFileError(f"cannot load {path}: {error}") from error
    except Exception as error:  # Keras and h5py raise anything from KeyError to RuntimeError for odd content
        raise ModelFileError(
            f"cannot load {path}: expected a functional Keras model of standard layers, received something that cannot "
            f"be rebuilt: {error!r}"
        ) from error
    set_history(stored.model, stored.history)
    return stored
