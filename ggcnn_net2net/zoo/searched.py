"""The search that a network comes from, taken from the search's folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ggcnn_net2net.errors import ResultsError


def searched(directory: Path, architecture: str) -> dict[str, Any]:
    """What found a network, for its provenance.

    Args:
        directory: folder of a finished search.
        architecture: of the network, in the paper's notation: that of the search's best.

    Returns:
        The command, settings, dataset and versions of the search, how many candidates it trained and how many seconds
        all of them took, and the path that it committed to, root first, with every network's score.

    Raises:
        SearchError: `directory` holds no search.
        ResultsError: the search is not finished, or its best network is another one.
    """
    from ggcnn_net2net.search import load_history  # searches open the zoo's files
    from ggcnn_net2net.search.journal import resume_command

    history = load_history(directory)
    best = history.best
    if not history.finished or best is None:
        raise ResultsError(
            f"expected a finished search in {directory}, received one that is not: go on with it, "
            f"`{resume_command(directory)}`"
        )
    if best.architecture != architecture:
        raise ResultsError(
            f"expected the search whose best network has the architecture {architecture}, received {directory}, whose "
            f"best has {best.architecture}: name the search that the network comes from"
        )
    return {
        "command": history.command,
        "network": Path(history.network).name,
        "settings": history.settings.as_dict(),
        "data": {**history.data, "path": Path(history.data["path"]).name},
        "versions": dict(history.versions),
        "candidates": history.trained,
        "seconds": round(history.seconds),
        "path": [
            {"operation": step.operation, "parameters": step.parameters, "score": round(score, 4)}
            for step, score in history.path
        ],
    }
