"""Networks as the user names them."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    import keras

    from ggcnn_net2net.protocol import Protocol


def open_network(network: str, input_size: int, seed: int) -> tuple[keras.Model, str]:
    """A network with its weights, or a new one, and its name for the record.

    Args:
        network: "published", "zoo:NAME" or a model file; or an architecture, in the paper's notation or by name.
        input_size: side of the images that a new network is to take, in pixels.
        seed: of a new network's weights.

    Returns:
        The network; and `network`, or the name of what stands in for it.

    Raises:
        ModelFileError: a file that cannot be read.
        ArchitectureError: neither a file nor an architecture.
    """
    from ggcnn_net2net.architecture import build_ggcnn
    from ggcnn_net2net.model_files import load_ggcnn
    from ggcnn_net2net.model_files.load import opened_name

    path = file_of(network)
    if path is None:
        model = build_ggcnn(network, input_size=input_size, seed=seed)
        click.echo(f"{network}: an architecture, with new weights", err=True)
        return model, network
    return load_ggcnn(path), opened_name(network, path)


def made_by(network: str) -> dict[str, Any] | None:
    """The record of a network's training that `ggcnn-net2net train` and the zoo write beside the model file.

    Args:
        network: as for `open_network`.

    Returns:
        The record without what was measured of the network later; None where there is none for this very file.
    """
    from ggcnn_net2net.reference_data import sha256_of
    from ggcnn_net2net.zoo import MEASURED

    path = file_of(network)
    if path is None:
        return None
    try:
        record = dict(json.loads(path.with_suffix(".json").read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None
    if record.get("model_sha256") != sha256_of(path):
        return None
    return {name: value for name, value in record.items() if name not in MEASURED}


def keep_record(output: Path, network: str | None) -> None:
    """Refuse an output that would overwrite the record of a network that is read, or would look like it.

    Args:
        output: file to write.
        network: as for `open_network`; None: nothing is read.

    Raises:
        ModelFileError: the network has a record, in a .json of the same name as `output`.
    """
    from ggcnn_net2net.errors import ModelFileError

    source = None if network is None else file_of(network)
    if source is None or network is None or made_by(network) is None:
        return
    if source.resolve().with_suffix("") == output.resolve().with_suffix(""):
        raise ModelFileError(
            f"expected another name than that of the network, whose record {source.with_suffix('.json')} would be "
            f"lost, received {str(output)!r}"
        )


def note_other_loss(network: str, protocol: Protocol) -> None:
    """Print a note if a network trained with the masked loss is to be trained further with the published one.

    The published loss counts all pixels: most of the first steps go into the maps where nothing is labelled, for which
    the network never had a target.

    Args:
        network: as for `open_network`.
        protocol: of the training to come.
    """
    from ggcnn_net2net.errors import ModelFileError
    from ggcnn_net2net.model_files.load import PUBLISHED

    record = None
    if network != PUBLISHED:  # which is looked for once: that may be a download
        with suppress(ModelFileError):  # raised again where the network is opened
            record = made_by(network)
    learnt = ((record or {}).get("recipe") or {}).get("protocol") or {}
    if learnt.get("masked_loss") and not protocol.masked_loss:
        click.echo(
            f"Note: {network} was trained with the loss of {learnt['name']}, over labelled pixels. That of "
            f"{protocol.name} counts all pixels, and at first undoes what was learnt: use --protocol corrected, or "
            "start from a network that was trained with --protocol paper",
            err=True,
        )


def file_of(network: str) -> Path | None:
    """The model file that is meant; None for an architecture."""
    from ggcnn_net2net.model_files.load import PUBLISHED, source_path
    from ggcnn_net2net.zoo import PREFIX

    is_file = network == PUBLISHED or network.startswith(PREFIX) or Path(network).suffix or Path(network).is_file()
    return source_path(network) if is_file else None
