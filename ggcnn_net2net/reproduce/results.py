"""Results of Table I as data: what was run, and what came of it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ggcnn_net2net.atomic import write_text
from ggcnn_net2net.errors import ResultsError, SimulationError
from ggcnn_net2net.model_files import PUBLISHED_SHA256
from ggcnn_net2net.protocol import Protocol
from ggcnn_net2net.reproduce.networks import CONTROL, Network, short_hash
from ggcnn_net2net.reproduce.records import GraspRecord, RecordFile
from ggcnn_net2net.reproduce.statistics import PairedComparison, Rate
from ggcnn_net2net.simulation import PAPER_GRIPPER, GripperSpec
from ggcnn_net2net.simulation.scenes import SceneSettings
from ggcnn_net2net.simulation.trial import Outcome
from ggcnn_net2net.versions import versions

Records = dict[tuple[str, int], GraspRecord]
"""Records of one network by object and pose."""


@dataclass(frozen=True)
class Table1Row:
    """One network of the table."""

    network: Network
    outcomes: Counter[str]
    """Trials by outcome."""
    success: Rate
    """The paper's rule: within 0.7 m of the bin's centre."""
    in_bin: Rate
    """The stricter rule: between the bin's walls."""
    comparison: PairedComparison | None
    """With the original on the same scenes: the published network, or its stand-in if that is in the table. None for
    itself, and where it was not run."""
    control_comparison: PairedComparison | None
    """With the control on the same scenes; None for itself, and where the table has none."""

    @property
    def crashed(self) -> int:
        """Trials lost because a worker process died."""
        return self.outcomes[Outcome.CRASHED.value]


@dataclass(frozen=True)
class Table1:
    """The table and what it was made of."""

    scenes: SceneSettings
    protocol: Protocol
    rows: tuple[Table1Row, ...]
    gripper: GripperSpec = PAPER_GRIPPER

    @property
    def crashed(self) -> int:
        """Trials of all networks lost because a worker process died."""
        return sum(row.crashed for row in self.rows)

    @property
    def has_stand_in(self) -> bool:
        """Whether the original is not the published network."""
        return any(row.network.stand_in for row in self.rows)

    @property
    def has_control(self) -> bool:
        """Whether the rows are compared with the control, too."""
        return any(row.control_comparison for row in self.rows)


def summarise(
    networks: Sequence[Network],
    records: Iterable[GraspRecord],
    scenes: SceneSettings,
    protocol: Protocol,
    gripper: GripperSpec = PAPER_GRIPPER,
) -> Table1:
    """Count the records of each network."""
    by_weights: dict[str, dict[tuple[str, int], GraspRecord]] = {}
    for record in records:
        by_weights.setdefault(record.weights, {})[record.object, record.pose] = record
    stand_ins = [network.weights for network in networks if network.stand_in]
    controls = [network.weights for network in networks if network.name == CONTROL]
    # The published network's grasps may be in the folder without a row.
    original = by_weights.get((stand_ins or [short_hash(PUBLISHED_SHA256)])[0], {})
    control = by_weights.get(controls[0], {}) if controls else {}
    return Table1(
        scenes,
        protocol,
        tuple(_row(network, by_weights.get(network.weights, {}), original, control) for network in networks),
        gripper,
    )


def _row(network: Network, own: Records, original: Records, control: Records) -> Table1Row:
    return Table1Row(
        network,
        Counter(record.outcome for record in own.values()),
        Rate(sum(record.success for record in own.values()), len(own)),
        Rate(sum(record.in_bin for record in own.values()), len(own)),
        _compared(original, own),
        _compared(control, own),
    )


def _compared(reference: Records, own: Records) -> PairedComparison | None:
    """Both on the scenes that both have grasped on; None where there are none, and of a network with itself."""
    common = [key for key in reference if key in own] if own is not reference else []
    if not common:
        return None
    return PairedComparison.of([reference[key].success for key in common], [own[key].success for key in common])


def settings_of(scenes: SceneSettings, protocol: Protocol, gripper: GripperSpec) -> dict[str, Any]:
    """Everything that a results folder's rows have in common; a gripper only where it is not the paper's."""
    settings = {"scenes": asdict(scenes), "protocol": protocol.as_dict(), **gripper.as_setting()}
    return {**settings, "versions": versions()}


def read_settings(path: Path) -> tuple[dict[str, Any], SceneSettings, Protocol, GripperSpec]:
    """Settings that a results.json was made with: as stored, and its scenes, protocol and gripper.

    Args:
        path: the results.json.

    Returns:
        Settings as stored, scenes, protocol, gripper.

    Raises:
        ResultsError: no such file, or one that is damaged or of another version.
    """
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))["settings"]
        gripper = GripperSpec.from_dict(stored.get("gripper", {}))
        return stored, SceneSettings(**stored["scenes"]), Protocol(**stored["protocol"]), gripper
    except (OSError, ValueError, KeyError, TypeError, AttributeError, SimulationError) as error:
        raise ResultsError(
            f"expected {path} to hold the settings of a results folder, cannot read it: {error!r}; name another folder"
        ) from error


def current_records(folder: Path) -> list[GraspRecord]:
    """The grasps of a results folder, of one set of weights for each name.

    Records are kept by weights, under the name that these had first. Every row of the last run's table has the records
    of its weights here, also where another row has the same; of a name that it does not show, the weights that came
    last count.

    Args:
        folder: of `run_table1`.

    Returns:
        The records, row by row of the table, and then of other names in the order of grasps.csv.

    Raises:
        ResultsError: no such folder, or a damaged one.
    """
    file, results = folder / "grasps.csv", folder / "results.json"
    if not file.is_file():
        raise ResultsError(f"expected a folder of `reproduce table1`, received {folder}, which holds no grasps.csv")
    try:
        rows = json.loads(results.read_text(encoding="utf-8"))["networks"]
        shown = {row["name"]: short_hash(row["sha256"]) for row in rows if row["sha256"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultsError(
            f"expected {results} to list networks, cannot read it: {error!r}; name another folder"
        ) from error
    records = RecordFile(file).read()
    of_rows = [
        replace(record, model=name)
        for name, weights in shown.items()
        for record in records
        if record.weights == weights
    ]
    latest = {record.model: record.weights for record in records if record.model not in shown}
    return of_rows + [record for record in records if latest.get(record.model) == record.weights]


def check_settings(path: Path, settings: dict[str, Any]) -> None:
    """Refuse to continue a results folder that was made in another way.

    Args:
        path: the folder's results.json; a new folder has none.
        settings: of the run that is to come, see `settings_of`.

    Raises:
        ResultsError: other scenes, protocol, gripper or versions.
    """
    if not path.is_file():
        if path.with_name("grasps.csv").is_file():
            raise ResultsError(
                f"expected {path}, which tells how the grasps in {path.parent} were made, found none: put it back, or "
                "choose another --output"
            )
        return
    before, now = ({"gripper": "the paper's", **values} for values in (read_settings(path)[0], settings))
    for name, value in now.items():
        if _without_name(before.get(name)) != _without_name(value):
            raise ResultsError(
                f"expected to continue {path.parent} with the {name} it was begun with, {before.get(name)}, received "
                f"{value}: choose another --output"
            )


def _without_name(value: Any) -> Any:
    """Of scenes all but the name of the object set, whose fingerprint tells more."""
    return {key: item for key, item in value.items() if key != "object_set"} if isinstance(value, dict) else value


def write_results(path: Path, table: Table1, settings: dict[str, Any], command: str, finished: bool) -> None:
    """Write results.json."""
    content = {
        "experiment": "table1",
        "finished": finished,
        "command": command,
        "settings": settings,
        "networks": [_row_as_dict(row) for row in table.rows],
    }
    write_text(path, json.dumps(content, indent=2) + "\n")


def _row_as_dict(row: Table1Row) -> dict[str, Any]:
    network = row.network
    return {
        "name": network.name,
        "architecture": network.architecture,
        "parameters": network.parameters,
        "file": network.file,
        "sha256": network.sha256,
        "note": network.note,
        "stand_in": network.stand_in,
        "success": _rate_as_dict(row.success),
        "in_bin": _rate_as_dict(row.in_bin),
        "outcomes": dict(sorted(row.outcomes.items())),
        "paper": asdict(network.paper) if network.paper else None,
        "against_original": _comparison_as_dict(row.comparison),
        "against_control": _comparison_as_dict(row.control_comparison),
    }


def _comparison_as_dict(comparison: PairedComparison | None) -> dict[str, Any] | None:
    return {**asdict(comparison), "mcnemar_exact_p": comparison.p_value} if comparison else None


def _rate_as_dict(rate: Rate) -> dict[str, Any] | None:
    if not rate.trials:
        return None
    low, high = rate.interval
    return {
        "successes": rate.successes,
        "trials": rate.trials,
        "rate": rate.value,
        "wilson_95": [low, high],
    }
