"""Networks as the user names them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import keras


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
    from ggcnn_net2net.model_files.load import opened_name, source_path
    from ggcnn_net2net.zoo import PREFIX

    is_file = network == "published" or network.startswith(PREFIX) or Path(network).suffix or Path(network).exists()
    if not is_file:
        return build_ggcnn(network, input_size=input_size, seed=seed), network
    path = source_path(network)
    return load_ggcnn(path), opened_name(network, path)
