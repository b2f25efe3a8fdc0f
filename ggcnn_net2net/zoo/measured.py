"""What was measured of a network, taken from the files that the measurements wrote."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ggcnn_net2net.errors import ResultsError

MEASURED = ("sim", "iou")
"""Keys of what `measured` returns."""


def measured(sha256: str, results: Iterable[Path] = (), iou: Iterable[Path] = ()) -> dict[str, Any]:
    """Results of a network, for its provenance.

    Args:
        sha256: of the model file that was judged.
        results: folders of `reproduce table1`.
        iou: files of `evaluate iou --output`.

    Returns:
        "sim": success rates, one entry a folder; "iou": IoU rates, one entry a file and protocol; each with its Wilson
        interval and what it was measured on. Keys without an entry are left out.

    Raises:
        ResultsError: a file that cannot be read, that is of other networks, or a benchmark that is not finished.
    """
    found = {
        "sim": [_sim(sha256, folder / "results.json") for folder in results],
        "iou": [entry for file in iou for entry in _iou(sha256, file)],
    }
    return {name: entries for name, entries in found.items() if entries}


def _sim(sha256: str, file: Path) -> dict[str, Any]:
    content = _read(file)
    try:
        rows = [row for row in content["networks"] if row["sha256"] == sha256 and row["success"]]
        _expect_one(rows[:1], sha256, file)  # rows of the same weights have the same grasps
        if not content["finished"]:
            raise ResultsError(
                f"expected a finished benchmark in {file.parent}, received one without some of its grasps: run its "
                "command again, it does only what is missing"
            )
        settings = content["settings"]
        scenes = settings["scenes"]
        return {
            "objects": scenes["object_set"],
            "poses": scenes["poses"],
            "seed": scenes["seed"],
            "protocol": settings["protocol"]["name"],
            **{name: settings[name] for name in ("gripper",) if name in settings},  # where it is not the paper's
            "success": rows[0]["success"],
            "in_bin": rows[0]["in_bin"],
            "command": content["command"],
            "versions": settings["versions"],
        }
    except (KeyError, TypeError) as error:
        raise ResultsError(f"expected results of `reproduce table1` in {file}, it lacks {error!r}") from error


def _iou(sha256: str, file: Path) -> list[dict[str, Any]]:
    content = _read(file)
    try:
        _expect_one([content["model"]] if content["model"]["sha256"] == sha256 else [], sha256, file)
        data = {name: content["dataset"][name] for name in ("split", "images", "fingerprint")}
        return [
            {
                "protocol": rate["protocol"]["name"],
                **{name: rate[name] for name in ("successes", "images", "rate", "wilson_95")},
                "dataset": {"file": Path(content["dataset"]["file"]).name, **data},
                "versions": content["versions"],
            }
            for rate in content["rates"]
        ]
    except (KeyError, TypeError) as error:
        raise ResultsError(f"expected a result of `evaluate iou` in {file}, it lacks {error!r}") from error


def _read(file: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(Path(file).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise ResultsError(f"expected a file of results, cannot read {file}: {error!r}") from error


def _expect_one(rows: list[Any], sha256: str, file: Path) -> None:
    if len(rows) != 1:
        raise ResultsError(
            f"expected one result of the network with the SHA-256 {sha256} in {file}, received {len(rows)}: judge this "
            "model file, or name other results"
        )
