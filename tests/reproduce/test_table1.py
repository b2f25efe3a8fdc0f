import json
from dataclasses import replace

import pytest

from ggcnn_net2net.architecture import build_ggcnn
from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.model_files import PUBLISHED_SHA256, save_ggcnn
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.reproduce.networks import load_networks
from ggcnn_net2net.reproduce.records import COLUMNS, RecordFile
from ggcnn_net2net.reproduce.table1 import run_table1
from ggcnn_net2net.simulation import benchmark
from ggcnn_net2net.simulation.trial import Outcome


@pytest.fixture
def original(network):
    return network("original", 45.0, PUBLISHED_SHA256)


def run(networks, objects, output, **options):
    return run_table1(networks, objects, output, poses=2, **options)


def test_table_and_files(original, network, objects, tmp_path):
    blind = network("blind", 0, "b" * 64)
    table = run([original, blind, *load_networks(["optimized"])], objects, tmp_path / "out", command="me", workers=2)
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
    assert (tmp_path / "grasps.csv").read_bytes() == before


def test_lost_grasps_are_said_and_repeated(original, objects, tmp_path, monkeypatch):
    whole = benchmark.run_parallel

    def lose_one(function, inputs, workers):
        for index, result in whole(function, inputs, workers):
            yield index, benchmark.Crash(11, 2) if index == 4 else result

    monkeypatch.setattr(benchmark, "run_parallel", lose_one)
    table = run([original], objects, tmp_path)
    assert table.crashed == 2  # one without a scene, one without a trial
    assert table.rows[0].success.trials == 6
    assert json.loads((tmp_path / "results.json").read_text())["finished"] is False
    assert "INCOMPLETE: 2 grasp(s)" in (tmp_path / "table1.md").read_text()
    monkeypatch.undo()


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


def test_networks_need_names_of_their_own():
    with pytest.raises(ResultsError, match="different names"):
        load_networks(["extended", "extended"])
    with pytest.raises(ResultsError, match="none"):
        load_networks([])


def test_a_network_for_another_image_size_is_refused(tmp_path):
    path = save_ggcnn(build_ggcnn("shallow", input_size=120, seed=0), tmp_path / "small.hdf5")
    with pytest.raises(ResultsError, match="120"):
        load_networks([str(path)])


def test_a_file_of_the_users_is_not_taken_for_the_papers(tmp_path):
    path = save_ggcnn(build_ggcnn("narrow", seed=0), tmp_path / "extended.hdf5")
    (network,) = load_networks([str(path)])
    assert (network.name, network.parameters, network.paper) == ("extended", 4_508, None)


def test_published_network_end_to_end(objects, tmp_path, data_root):
    """The real network, predicted and simulated: no stand-ins."""
    networks = load_networks(["original"])
    assert networks[0].sha256 == PUBLISHED_SHA256
    assert networks[0].parameters == 62_420
    table = run(networks, objects, tmp_path, workers=2)
    assert table.rows[0].success.successes >= 4
