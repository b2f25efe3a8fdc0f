"""The networks that are there: NAME.hdf5 with its provenance, NAME.json, beside this module."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ggcnn_net2net.errors import ModelFileError, VerificationError
from ggcnn_net2net.reference_data import sha256_of

PREFIX = "zoo:"
"""What stands before a network's name where a model file is expected."""

STAND_IN = "original_retrained"
"""The network that takes the place of the published one where that cannot be had."""

FOLDER = Path(__file__).resolve().parent


class StandInWarning(UserWarning):
    """A network of this project is used in place of the published one, which was not found."""


def names() -> tuple[str, ...]:
    """Names of the networks in the zoo, in alphabetical order."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.hdf5") if not path.name.startswith(".")))


def network_file(name: str) -> Path:
    """The model file of a network, verified: Keras 2 HDF5 without optimizer.

    Args:
        name: one of `names()`.

    Returns:
        Its path.

    Raises:
        ModelFileError: the zoo has no such network.
        VerificationError: the file is not the one that its provenance describes, or it has none.
    """
    expected, path = provenance(name)["model_sha256"], FOLDER / f"{name}.hdf5"
    received = sha256_of(path)
    if received != expected:
        raise VerificationError(
            f"expected {path} with the SHA-256 of its provenance, {expected}, received {received}: the file is damaged "
            "or was exchanged; install the package again, or add the network with zoo.add"
        )
    return path


def provenance(name: str) -> dict[str, Any]:
    """What made a network: command, recipe with seed and protocol, data with its hash, versions, parameters, results.

    Args:
        name: one of `names()`.

    Returns:
        What was given to `zoo.add`, with `architecture`, `parameters`, `model_sha256` (of the zoo's file) and
        `trained_sha256` (of the file that was added).

    Raises:
        ModelFileError: the zoo has no such network.
        VerificationError: the network has no provenance that can be read.
    """
    known = names()
    if name not in known:
        raise ModelFileError(
            f"expected a network of the zoo ({', '.join(known) or 'which is empty'}), received {name!r}"
        )
    path = FOLDER / f"{name}.json"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        content["model_sha256"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise VerificationError(
            f"expected the provenance of {PREFIX}{name} with its model_sha256 in {path}, cannot read it: {error!r}; "
            "install the package again, or add the network with zoo.add"
        ) from error
    return content
