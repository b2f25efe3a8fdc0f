"""The networks that an experiment judges: those of the paper and of the zoo by name, the user's by file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ggcnn_net2net import zoo
from ggcnn_net2net.architecture import INPUT_SIZE, NAMED, architecture_of
from ggcnn_net2net.errors import ArchitectureError, ResultsError
from ggcnn_net2net.model_files import PUBLISHED_SHA256, load_ggcnn
from ggcnn_net2net.model_files.load import PUBLISHED, source_path
from ggcnn_net2net.reference_data import sha256_of
from ggcnn_net2net.reproduce.paper import TABLE1, PaperRow

if TYPE_CHECKING:
    import keras

ORIGINAL = "original"
CONTROL = "control"
"""The original architecture with as much more training, but not grown: what more training alone is worth."""

ROWS = (ORIGINAL, CONTROL, "extended", "optimized", "searched_extended", "searched_small")
"""Rows of Table I by default. Those of the paper are always there, the others if the zoo has them."""

NOT_SHIPPED = "no trained model ships yet"
STANDS_IN = "stand-in, trained by this project; the published file was not found"


@dataclass(frozen=True)
class Network:
    """A network of a results table."""

    name: str
    """Its row: original, "original (stand-in)", a name of the zoo, or the stem of the user's file."""
    architecture: str
    """The paper's notation; the class of network for one that the notation cannot express."""
    parameters: int
    file: str = ""
    """Name of the weights file, or "zoo:NAME"."""
    sha256: str = ""
    """Of the weights file; empty where no weights are at hand."""
    model: keras.Model | None = None
    """None where no weights are at hand."""
    paper: PaperRow | None = None
    """What the paper reports of its namesake; None for a network of the user's."""
    stand_in: bool = False
    """Whether it takes the place of the published network, which was not found."""

    @property
    def weights(self) -> str:
        """Short hash of the weights, by which records refer to the network; empty without weights."""
        return short_hash(self.sha256)

    @property
    def note(self) -> str:
        """Why the row has no result, or not that of the network it is named after; else empty."""
        if self.model is None:
            return NOT_SHIPPED
        return STANDS_IN if self.stand_in else ""


def short_hash(sha256: str) -> str:
    """The first 16 hex digits."""
    return sha256[:16]


def default_rows() -> list[str]:
    """The rows of Table I that are shown if nobody asks for others, as `load_networks` takes them."""
    return [name for name in ROWS if name in TABLE1 or name in zoo.names()]


def load_networks(specs: Iterable[str]) -> list[Network]:
    """Load the networks of a table.

    Args:
        specs: "original" (the published weights; where they cannot be had, the zoo's stand-in, which is named so), the
            others of `ROWS` (from the zoo; extended and optimized without weights if it lacks them), "zoo:NAME", or
            paths of model files.

    Returns:
        The networks in order; those that no weights are at hand for have no model.

    Raises:
        ResultsError: two networks of the same name, or none, or a name that is none of these.
        ModelFileError, DataNotFoundError, VerificationError: as `load_ggcnn`.
    """
    networks = [_load(spec) for spec in specs]
    names = [network.name for network in networks]
    if not names or len(set(names)) < len(names):
        raise ResultsError(
            f"expected one or more networks with different names, received {', '.join(names) or 'none'}: a network is "
            "named after its file, so rename one"
        )
    return networks


def _load(spec: str) -> Network:
    if spec in (ORIGINAL, PUBLISHED):
        path = source_path(PUBLISHED)
        if sha256_of(path) == PUBLISHED_SHA256:
            return _from_file(path, ORIGINAL, path.name, TABLE1[ORIGINAL])
        network = _from_file(path, f"{ORIGINAL} (stand-in)", f"{zoo.PREFIX}{zoo.STAND_IN}", TABLE1[ORIGINAL])
        return replace(network, stand_in=True)
    if spec in TABLE1 and spec not in zoo.names():
        architecture = NAMED[spec]
        return Network(spec, str(architecture), architecture.n_parameters, paper=TABLE1[spec])
    if spec in ROWS or spec.startswith(zoo.PREFIX):
        name = spec.removeprefix(zoo.PREFIX)
        return _from_file(zoo.network_file(name), name, f"{zoo.PREFIX}{name}", TABLE1.get(name))
    if not Path(spec).is_file():
        raise ResultsError(
            f"expected a network of a table, one of {', '.join(ROWS)}, {zoo.PREFIX}NAME or a model file, received "
            f"{spec!r}, which is none"
        )
    path = Path(spec)
    return _from_file(path, path.stem, path.name, None)


def _from_file(path: Path, name: str, file: str, paper: PaperRow | None) -> Network:
    model = load_ggcnn(path)
    if model.input_shape[1:3] != (INPUT_SIZE, INPUT_SIZE):
        raise ResultsError(
            f"expected a network for images of {INPUT_SIZE}x{INPUT_SIZE} px, as the simulated camera takes them, "
            f"received {path} for {model.input_shape[1:3]}"
        )
    try:
        notation = str(architecture_of(model))
    except ArchitectureError:
        notation = "other"
    return Network(name, notation, model.count_params(), file, sha256_of(path), model, paper)
