"""Put a network into the zoo, if it is small, works, and what made it is on record."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ggcnn_net2net.atomic import replacing, write_text
from ggcnn_net2net.errors import ModelFileError, VerificationError
from ggcnn_net2net.reference_data import sha256_of
from ggcnn_net2net.zoo import files
from ggcnn_net2net.zoo.measured import MEASURED

MAX_BYTES = 400_000
"""Largest file of the zoo."""

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_SHA256 = re.compile(r"[0-9a-f]{64}")


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and bool(value.strip())


def _is_hash(value: Any) -> bool:
    return isinstance(value, str) and _SHA256.fullmatch(value) is not None


REQUIRED_FIELDS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "command": (
        "a command line or a list of them",
        lambda value: _is_text(value) or (isinstance(value, list) and bool(value) and all(map(_is_text, value))),
    ),
    "recipe.seed": ("an integer", lambda value: isinstance(value, int) and not isinstance(value, bool)),
    "recipe.protocol": (
        "the fields of a Protocol",
        lambda value: isinstance(value, dict) and _is_text(value.get("name")),
    ),
    "data.sha256": ("64 hex digits", _is_hash),
    "versions": (
        "version numbers by package",
        lambda value: isinstance(value, dict) and bool(value) and all(map(_is_text, value.values())),
    ),
    "model_sha256": ("64 hex digits, of the model file", _is_hash),
}
"""What a provenance must hold: name of the field -> the expected value in words, and the check of a value."""


def add(model_file: Path, provenance: Path | Mapping[str, Any], name: str, folder: Path | None = None) -> Path:
    """Add a network to the zoo, or replace the one of this name.

    Its weights and its operation history are kept, an optimizer is not.

    Args:
        model_file: the network, in any format that `load_ggcnn` reads.
        provenance: what made it, as `ggcnn-net2net train` writes it in OUTPUT.json: a file or its content. It must have
            `REQUIRED_FIELDS`, and may have more, such as what `measured` returns; all of it is kept.
        name: of lower case letters, digits and underscores.
        folder: where to; by default the package's zoo.

    Returns:
        The file that was written, NAME.hdf5; NAME.json is beside it.

    Raises:
        ModelFileError: a file that is no working GG-CNN or has more than `MAX_BYTES` without its optimizer, a
            provenance that is not complete, or another kind of name.
        VerificationError: the provenance is of another model file.

    Example:
        zoo.add(Path("extended.hdf5"), Path("extended.json"), "extended")
    """
    from ggcnn_net2net.model_files import load_ggcnn, model_summary, save_ggcnn  # they open the zoo's files

    if not _NAME.fullmatch(name):
        raise ModelFileError(f"expected a name of lower case letters, digits and underscores, received {name!r}")
    facts = dict(provenance) if isinstance(provenance, Mapping) else read_provenance(provenance)
    problems = list(_problems(facts))
    if problems:
        raise ModelFileError(f"expected a complete provenance of {model_file}, it lacks: {'; '.join(problems)}")
    model = load_ggcnn(model_file)
    received = sha256_of(model_file)
    if received != facts["model_sha256"]:
        raise VerificationError(
            f"expected {model_file} with the SHA-256 of its provenance, {facts['model_sha256']}, received {received}: "
            "they are of different trainings; name the two that belong together"
        )
    target = (folder or files.FOLDER) / f"{name}.hdf5"
    with replacing(target) as temporary:
        save_ggcnn(model, temporary)
        size = temporary.stat().st_size
        if size > MAX_BYTES:
            raise ModelFileError(
                f"expected a network of at most {MAX_BYTES:,} bytes without its optimizer, received {model_file} of "
                f"{size:,}: the zoo is for small ones"
            )
        summary = model_summary(temporary)
        facts |= {
            "architecture": summary.architecture,
            "parameters": summary.parameters,
            "trained_sha256": facts.get("trained_sha256", received),
            "model_sha256": summary.sha256,
        }
        # Before the network takes its place: a provenance without its network is passed over, the reverse is not.
        write_text(target.with_suffix(".json"), json.dumps(facts, indent=2) + "\n")
    return target


def read_provenance(provenance: Path) -> dict[str, Any]:
    """What made a network, from a file of `ggcnn-net2net train`.

    Args:
        provenance: the .json beside the model file.

    Returns:
        Its content, complete or not.

    Raises:
        ModelFileError: no such file, or no JSON object in it.
    """
    try:
        return dict(json.loads(Path(provenance).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise ModelFileError(
            f"expected a provenance as `ggcnn-net2net train` writes it beside the model, cannot read {provenance}: "
            f"{error!r}"
        ) from error


def _problems(facts: Mapping[str, Any]) -> Iterator[str]:
    for place, (expected, is_good) in REQUIRED_FIELDS.items():
        value: Any = facts
        for key in place.split("."):
            value = value.get(key) if isinstance(value, Mapping) else None
        if not is_good(value):
            yield f"{place} ({expected}), received {value!r}"
    for name in MEASURED:
        entries = facts.get(name, [])
        if not isinstance(entries, list) or not all(isinstance(entry, Mapping) for entry in entries):
            yield f"{name} (entries as zoo.measured returns them), received {entries!r}"
