"""The networks that an experiment judges: those of the paper by name, the user's by file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ggcnn_net2net.architecture import INPUT_SIZE, NAMED, architecture_of
from ggcnn_net2net.errors import ArchitectureError, ResultsError
from ggcnn_net2net.model_files import load_ggcnn, published_weights
from ggcnn_net2net.reference_data import sha256_of
from ggcnn_net2net.reproduce.paper import TABLE1, PaperRow

if TYPE_CHECKING:
    import keras

PAPER_NETWORKS = ("original", "extended", "optimized")
NOT_SHIPPED = "no trained model ships yet"


@dataclass(frozen=True)
class Network:
    """A network of a results table."""

    name: str
    """Its row: original, extended, optimized, or the stem of the user's file."""
    architecture: str
    """The paper's notation; the class of network for one that the notation cannot express."""
    parameters: int
    file: str = ""
    """Name of the weights file."""
    sha256: str = ""
    """Of the weights file; empty where no weights are at hand."""
    model: keras.Model | None = None
    """None where no weights are at hand."""
    paper: PaperRow | None = None
    """What the paper reports of it; None for a network of the user's."""

    @property
    def weights(self) -> str:
        """Short hash of the weights, by which records refer to the network; empty without weights."""
        return short_hash(self.sha256)

    @property
    def note(self) -> str:
        """Why the row has no result; empty for a network with weights."""
        return "" if self.model is not None else NOT_SHIPPED


def short_hash(sha256: str) -> str:
    """The first 16 hex digits."""
    return sha256[:16]


def load_networks(specs: Iterable[str]) -> list[Network]:
    """Load the networks of a table.

    Args:
        specs: "original" (the published weights), "extended", "optimized", or paths of model files.

    Raises:
        ResultsError: two networks of the same name, or none.
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
    if spec in PAPER_NETWORKS and spec != "original":
        architecture = NAMED[spec]
        return Network(spec, str(architecture), architecture.n_parameters, paper=TABLE1[spec])
    path = published_weights() if spec == "original" else Path(spec)
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
    name = spec if spec == "original" else path.stem
    return Network(name, notation, model.count_params(), path.name, sha256_of(path), model, TABLE1.get(spec))
