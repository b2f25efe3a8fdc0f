import io
import json
from dataclasses import replace
from itertools import pairwise

import pytest
from matplotlib.figure import Figure
from rich.console import Console

from ggcnn_net2net.atomic import alone
from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.model_files import PUBLISHED_SHA256
from ggcnn_net2net.parallel import Crash, LocalWorkers
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.reproduce.networks import load_networks
from ggcnn_net2net.reproduce.records import COLUMNS, GraspRecord, RecordFile
from ggcnn_net2net.reproduce.report import print_table, write_chart, write_markdown
from ggcnn_net2net.reproduce.results import Table1, read_settings, settings_of, summarise, write_results
from ggcnn_net2net.reproduce.statistics import PairedComparison
from ggcnn_net2net.reproduce.table1 import run_table1
from ggcnn_net2net.simulation import PAPER_GRIPPER, GripperSpec
from ggcnn_net2net.simulation.scenes import SceneSettings
from ggcnn_net2net.simulation.trial import Outcome, decoding_of
from ggcnn_net2net.zoo import files


@pytest.fixture(autouse=True)
def empty_zoo(tmp_path, monkeypatch):
    """What ships has no part in these tests."""
    monkeypatch.setattr(files, "FOLDER", tmp_path / "zoo")


@pytest.fixture
def original(network):
    return network("original", 45.0, PUBLISHED_SHA256)


@pytest.fixture
def blind(network):
    """It sees no grasp, so that only scenes are made."""
    return network("blind", 0, "b" * 64)


def run(networks, objects, output, **options):
    return run_table1(networks, objects, output, poses=2, **options)


def test_table_and_files(original, blind, objects, tmp_path):
    with LocalWorkers(2) as workers:
        networks = [original, blind, *load_networks(["optimized"])]
        table = run(networks, objects, tmp_path / "out", command="me", workers=workers)
    first, second, missing = table.rows
    assert (first.success.trials, second.success.trials, missing.success.trials) == (6, 6, 0)
    assert first.success.successes >= 3
    assert second.outcomes == {Outcome.NO_GRASP: 6}
    assert first.comparison is None
    assert second.comparison.only_first == first.success.successes
    assert second.comparison.only_second == 0
    assert first.network.paper.accuracy == 0.785
    assert second.network.paper is None
    assert missing.network.note == "no trained model ships yet"

    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["finished"] is True
    assert results["command"] == "me"
    assert results["settings"]["protocol"]["name"] == "PAPER"
    assert results["settings"]["scenes"]["fingerprint"] == objects.fingerprint
    assert {"pybullet", "tensorflow", "keras", "numpy"} <= set(results["settings"]["versions"])
    row = results["networks"][0]
    assert row["sha256"] == PUBLISHED_SHA256
    assert row["success"]["wilson_95"] == list(first.success.interval)

    records = RecordFile(tmp_path / "out" / "grasps.csv").read()
    assert len(records) == 12
    assert sum(record.success for record in records) == first.success.successes
    seen = next(record for record in records if record.model == "original")
    assert seen.grasp.width_px == 45.0
    assert seen.opening == pytest.approx(45 * 1.45 / 412, rel=0.05)
    markdown = (tmp_path / "out" / "table1.md").read_text()
    assert f"{first.success.successes}/6" in markdown
    assert "`me`" in markdown
    assert PUBLISHED_SHA256 in markdown
    assert (tmp_path / "out" / "table1.png").stat().st_size > 5000


def test_an_interrupted_run_goes_on_where_it_stopped(original, objects, tmp_path):
    run([original], objects, tmp_path / "whole")
    done = []

    def stop(stage, count, _):
        done.append((stage, count))
        if (stage, count) == ("original", 2):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run([original], objects, tmp_path / "cut", on_progress=stop)
    assert json.loads((tmp_path / "cut" / "results.json").read_text())["finished"] is False
    csv = tmp_path / "cut" / "grasps.csv"
    assert len(RecordFile(csv).read()) == 2
    csv.write_text(csv.read_text() + "original,07ed61da2f5b5aa5,pla")  # torn by a kill

    done.clear()
    run([original], objects, tmp_path / "cut", on_progress=lambda *what: done.append(what[:2]))
    assert done == [("scenes", 6), *[("original", count) for count in range(2, 7)]]
    assert csv.read_bytes() == (tmp_path / "whole" / "grasps.csv").read_bytes()


def test_the_next_network_is_predicted_while_grasps_are_executed(network, objects, tmp_path):
    networks = [network("first", 45.0, "c" * 64), network("second", 60.0, "d" * 64)]
    done = []

    def stop(stage, count, _):
        done.append((stage, count))
        if (stage, count) == ("second", 2):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), LocalWorkers(1) as workers:
        run(networks, objects, tmp_path, workers=workers, on_progress=stop)
    assert done.index(("first", 1)) < done.index(("second", 0)) < done.index(("first", 6))

    done.clear()
    table = run(networks, objects, tmp_path, on_progress=lambda *what: done.append(what[:2]))
    assert done == [("scenes", 6), ("first", 6), *[("second", count) for count in range(2, 7)]]
    assert [row.success.trials for row in table.rows] == [6, 6]


def test_the_same_weights_under_two_names_are_judged_once(network, objects, tmp_path):
    table = run([network("mine", 45.0, "c" * 64), network("copy", 45.0, "c" * 64)], objects, tmp_path)
    assert [row.success.trials for row in table.rows] == [6, 6]
    assert {record.model for record in RecordFile(tmp_path / "grasps.csv").read()} == {"mine"}


def test_a_network_is_added_to_a_finished_table(original, network, objects, tmp_path):
    run([original], objects, tmp_path)
    before = RecordFile(tmp_path / "grasps.csv").read()
    table = run([network("mine", 60.0, "c" * 64)], objects, tmp_path)
    assert table.rows[0].comparison is not None  # with the published network's grasps, which are still there
    after = RecordFile(tmp_path / "grasps.csv").read()
    assert [record for record in after if record.model == "original"] == before
    assert len(after) == 12


def test_the_same_name_with_other_weights_is_another_network(network, objects, tmp_path):
    run([network("mine", 45.0, "c" * 64)], objects, tmp_path)
    table = run([network("mine", 0, "d" * 64)], objects, tmp_path)
    assert table.rows[0].outcomes == {Outcome.NO_GRASP: 6}


def test_another_experiment_is_not_continued(original, objects, tmp_path):
    run([original], objects, tmp_path)
    before = (tmp_path / "grasps.csv").read_bytes()
    for change in ({"seed": 1}, {"protocol": CORRECTED}, {"protocol": replace(PAPER, sim_angle_window=3)}):
        with pytest.raises(ResultsError, match="choose another --output"):
            run([original], objects, tmp_path, **change)
    (tmp_path / "results.json").unlink()  # without it nothing tells what they are
    with pytest.raises(ResultsError, match=r"results\.json.*put it back"):
        run([original], objects, tmp_path)
    assert (tmp_path / "grasps.csv").read_bytes() == before


SMALL = GripperSpec(palm=(0.1, 0.02, 0.01), finger_length=0.04, max_opening=0.08)


def test_one_run_at_a_time_writes_to_a_folder(blind, objects, tmp_path):
    run([blind], objects, tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with (
        alone(tmp_path / "grasps.lock", ResultsError("not this one")),
        pytest.raises(ResultsError, match="another process writes results there"),
    ):
        run([blind], objects, tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_another_gripper_is_on_record(original, objects, tmp_path):
    paper = run([original], objects, tmp_path / "paper")
    small = run([original], objects, tmp_path / "small", gripper=SMALL)
    assert 0 < small.rows[0].success.successes < paper.rows[0].success.successes  # it cannot hold the cube
    assert (tmp_path / "small" / "scenes.h5").stat().st_size == (tmp_path / "paper" / "scenes.h5").stat().st_size
    stored, _, _, found = read_settings(tmp_path / "small" / "results.json")
    assert found == SMALL
    assert stored["gripper"]["max_opening"] == 0.08
    told = "Gripper not the paper's: palm (0.1, 0.02, 0.01), finger_length 0.04, max_opening 0.08."
    assert told in (tmp_path / "small" / "table1.md").read_text()
    assert told in shown(small).replace("\n", " ")
    before = (tmp_path / "small" / "grasps.csv").read_bytes()
    assert run([original], objects, tmp_path / "small", gripper=SMALL).rows == small.rows
    assert (tmp_path / "small" / "grasps.csv").read_bytes() == before


def test_the_papers_gripper_leaves_no_trace(blind, objects, tmp_path):
    """Folders from before grippers could be chosen go on, and have the same files."""
    run([blind], objects, tmp_path, gripper=PAPER_GRIPPER)
    stored, _, _, found = read_settings(tmp_path / "results.json")
    assert list(stored) == ["scenes", "protocol", "versions"]
    assert found == PAPER_GRIPPER
    assert "Gripper" not in (tmp_path / "table1.md").read_text()


def test_a_folder_of_another_gripper_is_not_continued(blind, objects, tmp_path):
    other = replace(SMALL, max_opening=0.07)
    for first, second, told in (
        (PAPER_GRIPPER, SMALL, "begun with, the paper's, received.*0.08"),
        (SMALL, PAPER_GRIPPER, "begun with.*0.08.*received the paper's"),
        (SMALL, other, "begun with.*0.08.*received.*0.07"),
    ):
        folder = tmp_path / f"{first.max_opening}{second.max_opening}"
        run([blind], objects, folder, gripper=first)
        before = {path.name: path.read_bytes() for path in folder.iterdir()}
        with pytest.raises(ResultsError, match=told):
            run([blind], objects, folder, gripper=second)
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("gripper", [{"max_opning": 1}, {"max_opening": -1}, {"palm": 3}, [1], "small", 7])
def test_a_damaged_gripper_in_the_settings(objects, tmp_path, gripper):
    settings = settings_of(SceneSettings.of(objects, 2, 0), PAPER, PAPER_GRIPPER)
    path = tmp_path / "results.json"
    path.write_text(json.dumps({"settings": settings}))
    assert read_settings(path)[3] == PAPER_GRIPPER
    path.write_text(json.dumps({"settings": settings | {"gripper": gripper}}))
    with pytest.raises(ResultsError, match="name another folder"):
        read_settings(path)


@pytest.mark.parametrize("protocol", [PAPER, CORRECTED], ids=["PAPER", "CORRECTED"])
def test_maps_are_decoded_as_the_protocol_says(network, objects, tmp_path, protocol):
    run([network("blind", 0, "b" * 64)], objects, tmp_path, protocol=protocol)
    assert network.decodings == [decoding_of(protocol)]


def test_lost_grasps_are_said_and_repeated(original, objects, tmp_path):
    class Losing(LocalWorkers):
        def run(self, function, inputs):
            for index, result in super().run(function, inputs):
                yield index, Crash(11, 2) if index == 4 else result

    with Losing(1) as workers:
        table = run([original], objects, tmp_path, workers=workers)
    assert table.crashed == 2  # one without a scene, one without a trial
    assert table.rows[0].success.trials == 6
    assert json.loads((tmp_path / "results.json").read_text())["finished"] is False
    assert "INCOMPLETE: 2 grasp(s)" in (tmp_path / "table1.md").read_text()


def test_lost_grasps_are_run_again(original, objects, tmp_path):
    run([original], objects, tmp_path)
    good = (tmp_path / "grasps.csv").read_bytes()
    records = RecordFile(tmp_path / "grasps.csv").read()
    lost = replace(records[2], outcome=Outcome.CRASHED.value, success=False)
    RecordFile(tmp_path / "grasps.csv").rewrite([*records[:2], lost, *records[3:]])
    assert run([original], objects, tmp_path).crashed == 0
    assert (tmp_path / "grasps.csv").read_bytes() == good


@pytest.mark.parametrize(
    "text", ["model,object\n", ",".join(COLUMNS) + "\noriginal,x\n", ",".join(COLUMNS) + "\n" + "x," * 19 + "1\n"]
)
def test_a_csv_of_something_else(tmp_path, text):
    (tmp_path / "grasps.csv").write_text(text)
    with pytest.raises(ResultsError, match=r"grasps\.csv"):
        RecordFile(tmp_path / "grasps.csv").read()


@pytest.fixture
def counted(objects):
    """Function: the table of networks whose successes on 8 scenes are given as text, "1" for one and "0" for none."""

    def count(*rows) -> Table1:
        records = [
            replace(
                GraspRecord.lost(network.name, network.weights, objects.objects[0], pose),
                outcome=(Outcome.SUCCESS if mark == "1" else Outcome.MISSED).value,
                success=mark == "1",
                in_bin=mark == "1",
            )
            for network, marks in rows
            for pose, mark in enumerate(marks)
        ]
        return summarise([network for network, _ in rows], records, SceneSettings.of(objects, 8, 0), PAPER)

    return count


def shown(table: Table1, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width)
    print_table(console, table)
    return console.file.getvalue()


def test_all_are_compared_with_the_original_and_with_the_control(original, network, counted, tmp_path):
    control, grown = network("control", 1.0, "c" * 64), network("extended", 1.0, "e" * 64)
    table = counted((original, "10000000"), (control, "11110000"), (grown, "01111111"), *no_weights("optimized"))
    of_original, of_control, of_grown, of_missing = table.rows
    assert (of_original.comparison, of_control.control_comparison) == (None, None)
    assert (of_missing.comparison, of_missing.control_comparison) == (None, None)
    assert of_original.control_comparison == PairedComparison(3, 0)
    assert of_control.comparison == PairedComparison(0, 3)
    assert of_grown.comparison == PairedComparison(1, 7)
    assert of_grown.control_comparison == PairedComparison(1, 4)

    write_results(tmp_path / "results.json", table, {}, "me", finished=True)
    rows = json.loads((tmp_path / "results.json").read_text())["networks"]
    assert rows[2]["against_original"] == {"only_first": 1, "only_second": 7, "mcnemar_exact_p": 0.0703125}
    assert rows[2]["against_control"] == {"only_first": 1, "only_second": 4, "mcnemar_exact_p": 0.375}
    assert rows[1]["against_control"] is rows[3]["against_control"] is None
    write_markdown(tmp_path / "table1.md", table, "me", {})
    for text in ((tmp_path / "table1.md").read_text(), shown(table)):
        headings = [line for line in text.splitlines() if "p (control)" in line and "paper" in line]
        (row,) = (line for line in text.splitlines() if "7/8" in line)
        assert len(headings) == 1
        assert row.replace("|", " ").split()[-2:] == ["0.0703", "0.375"]
        assert "p (control): the same test against the row control" in text


def no_weights(*names):
    return [(network, "") for network in load_networks(names)]


def test_without_a_control_there_is_no_column_for_it(original, network, counted, tmp_path):
    table = counted((original, "10000000"), (network("mine", 1.0, "e" * 64), "01111111"))
    write_markdown(tmp_path / "table1.md", table, "me", {})
    assert "control" not in (tmp_path / "table1.md").read_text() + shown(table)
    assert table.rows[1].control_comparison is None


def test_a_stand_in_is_named_everywhere(original, network, counted, tmp_path):
    stand_in = replace(network("original (stand-in)", 1.0, "5" * 64), stand_in=True, paper=original.paper)
    table = counted((stand_in, "10000000"), (network("mine", 1.0, "e" * 64), "01111111"))
    assert table.rows[0].comparison is None
    assert table.rows[1].comparison == PairedComparison(1, 7)
    write_results(tmp_path / "results.json", table, {}, "me", finished=True)
    write_markdown(tmp_path / "table1.md", table, "me", {})
    rows = json.loads((tmp_path / "results.json").read_text())["networks"]
    assert [row["stand_in"] for row in rows] == [True, False]
    note = "stand-in, trained by this project; the published file was not found"
    assert rows[0]["note"] == note
    for text in ((tmp_path / "table1.md").read_text(), shown(table)):
        assert f"original (stand-in): {note}" in text
        assert "exact test against the stand-in of the published network" in text


def test_the_stand_in_is_what_counts_even_beside_results_of_the_published_network(original, network, counted):
    """Both have been run in one folder: rows are compared with what is in the table."""
    stand_in = replace(network("original (stand-in)", 1.0, "5" * 64), stand_in=True)
    mine = network("mine", 1.0, "e" * 64)
    table = counted((original, "11111111"), (stand_in, "00000000"), (mine, "11110000"))
    assert table.rows[2].comparison == PairedComparison(0, 4)


def test_a_narrow_terminal_cuts_no_numbers(original, network, counted):
    table = counted(
        (original, "1" * 8), (network("control", 1.0, "c" * 64), "0" * 8), (network("searched_extended", 1, "e"), "10")
    )
    text = shown(table, width=40)
    assert "…" not in text
    assert "1/2  0.500 (0.095-0.905)" in text
    (row,) = (line for line in text.splitlines() if line.startswith(" searched_extended  "))
    assert row.split()[-2:] == ["1", "1"]


def test_the_names_of_seven_rows_do_not_overlap_in_the_chart(original, network, counted, tmp_path, monkeypatch):
    drawn = []
    save = Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda self, *args, **kwargs: (drawn.append(self), save(self, *args, **kwargs))
    )
    names = ("control", "searched_extended", "searched_small", "a_network_of_the_user_with_a_long_name")
    others = [(network(name, 1.0, name[:1] * 64), "11110000") for name in names]
    stand_in = replace(original, name="original (stand-in)", stand_in=True)
    table = counted((stand_in, "1" * 8), *others, *no_weights("extended", "optimized"))
    write_chart(tmp_path / "table1.png", table)
    (figure,) = drawn
    figure.draw_without_rendering()  # in its own resolution again
    labels = figure.axes[0].get_xticklabels()
    places = [label.get_window_extent() for label in labels]
    assert [label.get_text().splitlines()[0] for label in labels][::6] == ["original", "optimized"]
    assert len(places) == 7
    for left, right in pairwise(places):
        assert left.x1 < right.x0


def test_the_name_of_an_object_set_is_no_formula(original, counted, tmp_path):
    table = counted((original, "1" * 8))
    scenes = replace(table.scenes, object_set="objects_$a_$b")
    write_chart(tmp_path / "table1.png", replace(table, scenes=scenes))
    assert (tmp_path / "table1.png").stat().st_size > 10_000


def test_published_network_end_to_end(objects, tmp_path, data_root):
    """The real network, predicted and simulated: no stand-ins."""
    networks = load_networks(["original"])
    assert networks[0].sha256 == PUBLISHED_SHA256
    assert networks[0].parameters == 62_420
    with LocalWorkers(2) as workers:
        table = run(networks, objects, tmp_path, workers=workers)
    assert table.rows[0].success.successes >= 4
