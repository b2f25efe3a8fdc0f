"""The GG-CNN that its authors published: find it, verify it, or download it.

Source: github.com/dougsm/mvp_grasp at a fixed commit; Keras 2.0.8 full model, BSD-3-Clause, 551,760 bytes.
"""

from __future__ import annotations

import shlex
from pathlib import Path

from ggcnn_net2net import reference_data
from ggcnn_net2net.errors import DataNotFoundError

PUBLISHED_NAME = "epoch_29_model.hdf5"
PUBLISHED_SHA256 = "07ed61da2f5b5aa5d8d10a85c0a26023bae489c3b15fe16e58227c14738a3770"
"""SHA-256 of the published file; another file of this name is refused."""
PUBLISHED_URL = (
    "https://raw.githubusercontent.com/dougsm/mvp_grasp/c301ba2f4b0c0fb0c92b61a34f2821e56c693163/"
    f"ggcnn/src/ggcnn/models/{PUBLISHED_NAME}"
)
_FOLDER = "original_ggcnn_weights"


def published_weights(allow_download: bool = True) -> Path:
    """Path of the published weights, verified.

    Looked for in `$GGCNN_NET2NET_DATA/original_ggcnn_weights`, the checkout's `original_ggcnn_weights` and the user's
    cache, then downloaded into the cache.

    Args:
        allow_download: whether it may be fetched from its public source.

    Returns:
        The file: Keras 2.0.8 HDF5 of 551,760 bytes.

    Raises:
        VerificationError: the file that was found has a wrong SHA-256.
        DataNotFoundError: it is in none of the places and cannot be downloaded.
    """
    root = reference_data.data_root()
    cached = reference_data.cache_root() / _FOLDER / PUBLISHED_NAME
    checkout = reference_data.checkout_root() / _FOLDER / PUBLISHED_NAME
    places = [*([root / _FOLDER / PUBLISHED_NAME] if root else []), checkout, cached]
    for place in places:
        if place.is_file():
            return reference_data.verify(place, PUBLISHED_SHA256)
    reason = "downloading was not allowed"
    if allow_download:
        try:
            return reference_data.download(PUBLISHED_URL, cached, PUBLISHED_SHA256)
        except DataNotFoundError as error:
            reason = str(error)
    searched = "\n".join(f"  {place}" for place in places)
    raise DataNotFoundError(
        f"the published GG-CNN weights {PUBLISHED_NAME} (SHA-256 {PUBLISHED_SHA256}) were not found. Looked for:\n"
        f"{searched}\n  {PUBLISHED_URL}\n    ({reason})\n"
        f"On a machine with network access, this command fetches them:\n"
        f"  curl --create-dirs -fLo {shlex.quote(str(checkout))} {PUBLISHED_URL}"
    )
