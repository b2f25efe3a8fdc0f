"""The experiments as a table, and one of them run for real on a few small images."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from commands import call

from ggcnn_net2net import zoo
from ggcnn_net2net.architecture import NAMED
from ggcnn_net2net.cli import figures
from ggcnn_net2net.errors import GGCNNError, ResultsError
from ggcnn_net2net.parallel import Crash, LocalWorkers
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.reproduce import run_experiment as run_experiment_module
from ggcnn_net2net.reproduce.curves import IOU, SCORE, SIM, read_points, write_points
from ggcnn_net2net.reproduce.experiments import EXPERIMENTS, Curve, Experiment, part_of
from ggcnn_net2net.reproduce.run_experiment import Conditions, run_experiment
from ggcnn_net2net.search import load_history
from ggcnn_net2net.search.journal import read_events

FIG2 = EXPERIMENTS["fig2"]
SIZE = 300


def settings_of(name, budget="standard"):
    curves = {curve.name: curve for experiment in EXPERIMENTS.values() for curve in experiment.curves}
    return curves[name].settings(budget, PAPER, seed=3, threads=2)


def test_the_searches_are_the_papers():
    for experiment in EXPERIMENTS.values():
        for curve in experiment.curves:
            settings = curve.settings("paper", CORRECTED, seed=0, threads=1)
            assert (settings.width, settings.depth, settings.heuristic) == (3, 5, "iou")
            assert settings.recipe.images_per_epoch is settings.score_images is None
            assert settings.protocol == CORRECTED
    assert settings_of("e=2 r=8").retrain == 8
    assert settings_of("e=2 transpose").transpose
    assert not settings_of("e=2 no lookahead").lookahead
    assert settings_of("narrow").transpose
    assert settings_of("shallow").transpose
    assert settings_of("e=10").recipe.epochs == 10
    assert settings_of("e=2") == replace(settings_of("e=2 r=8"), retrain=0)
    assert (settings_of("e=2").recipe.images_per_epoch, settings_of("e=2").score_images) == (1500, 500)
    assert (settings_of("e=2").seed, settings_of("e=2").threads) == (3, 2)
    assert settings_of("e=2").max_parameters is None
    assert settings_of("e=2").recipe.learning_rate == 1e-3
    other = EXPERIMENTS["fig3"].curves[0].settings("quick", PAPER, 0, 1, max_parameters=16104, learning_rate=3e-4)
    assert (other.max_parameters, other.recipe.learning_rate) == (16104, 3e-4)


def test_folders_of_curves_differ():
    curves = {curve for experiment in EXPERIMENTS.values() for curve in experiment.curves}
    assert len({curve.slug for curve in curves}) == len(curves)
    assert Curve("e=2 no lookahead").slug == "e2-no-lookahead"


def test_part_of_an_experiment():
    part = part_of(FIG2, curves=["e=2"], protocols=[PAPER], networks={"e=2": "mine.hdf5"})
    assert part.curves == (Curve("e=2", network="mine.hdf5"),)
    assert part.protocols == (PAPER,)
    assert part_of(FIG2) == FIG2
    for unknown in ({"curves": ["e=3"]}, {"networks": {"e=3": "x"}}):
        with pytest.raises(ResultsError, match=r"e=2 r=8.*received e=3"):
            part_of(FIG2, **unknown)


@pytest.mark.parametrize("protocol", [PAPER, CORRECTED])
def test_a_curve_starts_from_a_network_of_the_protocols_loss(protocol):
    for curve in EXPERIMENTS["fig3"].curves:
        start = curve.of_protocol(protocol).network
        made = zoo.provenance(start.removeprefix(zoo.PREFIX))
        assert made["recipe"]["protocol"]["masked_loss"] == protocol.masked_loss
        assert made["architecture"] == str(NAMED[curve.name])
        chosen = part_of(EXPERIMENTS["fig3"], networks={curve.name: "mine.hdf5"}, curves=[curve.name])
        assert [curve.of_protocol(protocol).network for curve in chosen.curves] == ["mine.hdf5"]
    assert all(curve.of_protocol(protocol) == curve for curve in FIG2.curves)


@pytest.fixture(scope="module")
def conditions(tmp_path_factory):
    """Five images to train on, three to score: boxes on a plane."""
    from ggcnn_net2net.datasets.augmentation import Sample
    from ggcnn_net2net.datasets.hdf5 import DatasetWriter
    from ggcnn_net2net.datasets.label_maps import draw_label_maps
    from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle

    path = tmp_path_factory.mktemp("dataset") / "boxes.h5"
    random = np.random.default_rng(0)
    with DatasetWriter(path, {"source": "boxes"}) as writer:
        for number in range(8):
            row, col = random.integers(60, SIZE - 60, 2)
            depth = random.normal(0, 0.002, (SIZE, SIZE)).astype(np.float32)
            depth[row - 40 : row + 40, col - 15 : col + 15] -= 0.2
            rectangles = np.array([grasp_to_rectangle(Grasp(float(row), float(col), 0.0, 60.0))])
            maps = draw_label_maps(rectangles, (SIZE, SIZE))
            rgb = np.zeros((SIZE, SIZE, 3), np.uint8)
            sample = Sample(f"box{number}", depth - depth.mean(), rgb, rectangles, maps)
            writer.add("train" if number < 5 else "test", sample)
    return Conditions(path, "quick", objects="training:1", poses=1)


@pytest.fixture(scope="module")
def ran(conditions, tmp_path_factory):
    """An experiment of two short searches, run for real: (experiment, folder, points)."""
    from ggcnn_net2net.architecture import build_ggcnn
    from ggcnn_net2net.model_files import save_ggcnn

    folder = tmp_path_factory.mktemp("ran")
    network = str(save_ggcnn(build_ggcnn("C5x5x2_T5x5x2", seed=0), folder / "tiny.hdf5"))
    short = Curve("short", network, epochs=1, width=1, depth=1)
    experiment = Experiment("tiny", "Tiny", (short, replace(short, name="short r=1", retrain=1)))
    with LocalWorkers(2) as workers:
        points = run_experiment(experiment, conditions, folder / "out", workers, command="me")
    return experiment, folder / "out", points


@pytest.mark.slow
def test_a_run_judges_every_network_of_the_paths(ran, conditions):
    _, folder, points = ran
    assert points == read_points(folder / "results.csv")
    places = {(point.curve, point.metric, point.depth) for point in points}
    assert places == {(c, m, d) for c in ("short", "short r=1") for m in (IOU, SIM, SCORE) for d in (0, 1)}
    assert len(points) == len(places)
    history = load_history(folder / "searches" / "short-r1-paper")
    assert history.finished
    assert (folder / "searches" / "short-r1-paper" / "report" / "tree.svg").is_file()
    events = read_events(folder / "searches" / "short-r1-paper" / "journal.jsonl")
    trained = [event["operation"] for event in events if event["event"] == "scored" and "taken_from" not in event]
    assert trained == ["retrain(1)"]  # the other search had the rest
    mine = {(point.metric, point.depth): point for point in points if point.curve == "short r=1"}
    for candidate, score in history.path:
        assert mine[SCORE, candidate.depth].value == score
        assert mine[IOU, candidate.depth].parameters == candidate.parameters
    assert mine[SIM, 0].operation == "root"
    assert mine[SIM, 1].operation.endswith("(1), retrain(1)")  # deeper or wider of a layer, and further training
    assert mine[IOU, 1].trials == 3
    assert (mine[SIM, 1].trials, mine[SIM, 1].objects) == (1, "training:1, 1 pose(s) each")
    facts = {(point.figure, point.network, point.budget, point.seed, point.protocol) for point in points}
    assert facts == {("tiny", "tiny.hdf5", "quick", 0, "PAPER")}
    # All test images scored the candidates at this budget, so both counts are the same.
    assert mine[IOU, 1].value == pytest.approx(mine[SCORE, 1].value)


@pytest.mark.slow
def test_a_second_run_does_nothing_twice(ran, conditions, monkeypatch):
    """By the command this time, with another number of workers, so other threads."""
    experiment, folder, points = ran
    files = [folder / "iou.json", folder / "simulation-paper" / "grasps.csv"]
    files += [folder / "searches" / name / "journal.jsonl" for name in ("short-paper", "short-r1-paper")]
    before = [file.read_bytes() for file in files]
    assert len(json.loads(before[0])) == 3  # the networks of both paths: they have the first in common
    other = replace(points[0], curve="other")
    write_points(folder / "results.csv", [*points, other])  # another curve's results, from an earlier run
    monkeypatch.setitem(EXPERIMENTS, "fig2", experiment)
    same = ("--budget", "quick", "--objects", "training:1", "--poses", 1)
    shown = call(figures.fig2, "--run", "--data", conditions.data, "-o", folder, "--workers", 1, *same)
    assert [file.read_bytes() for file in files] == before
    assert sorted(read_points(folder / "results.csv"), key=repr) == sorted([*points, other], key=repr)
    assert f"Our numbers: {folder / 'results.csv'}." in shown
    assert "short r=1, protocol PAPER" in shown
    assert "retrain(1)" in (folder / "tiny.md").read_text()


def test_every_network_gets_its_own_rates(conditions, objects, network, tmp_path, monkeypatch):
    """Two curves that begin alike: one network finds every grasp, another none."""
    paths = {"up": (0, 60.0), "down": (0, 60.0, 1)}  # openings in pixels; 0: sees nothing

    def candidate(depth):
        operations = ("deeper(1)", "wider(2)")[:depth]
        return SimpleNamespace(depth=depth, operations=operations, operation=operations[-1] if depth else "root")

    def search(curve, *_):
        path = [(candidate(depth), depth / 10) for depth in range(len(paths[curve.name]))]
        return SimpleNamespace(path=path, data={"test": "0123456789"}, settings=SimpleNamespace(threads=1))

    def networks_of(curve, *_):
        return [
            network(f"{curve.name}, {n}", opening, str(opening).ljust(64, "x"))
            for n, opening in enumerate(paths[curve.name])
        ]

    def iou_counts(path, *_):
        curve, depth = path.stem.split(", ")
        return [2 if paths[curve][int(depth)] == 60.0 else 0, 3]

    def run(function, inputs):  # last first: results come in no order
        yield from reversed([(index, function(*values)) for index, values in enumerate(inputs)])

    monkeypatch.setattr(run_experiment_module, "_prepare", lambda *_: None)
    monkeypatch.setattr(run_experiment_module, "_search", search)
    monkeypatch.setattr(run_experiment_module, "_networks_of", networks_of)
    monkeypatch.setattr(run_experiment_module, "_iou_counts", iou_counts)
    monkeypatch.setattr("ggcnn_net2net.simulation.object_sets.load_object_set", lambda *_: objects)
    experiment = Experiment("two", "Two", (Curve("up"), Curve("down")))
    points = run_experiment(experiment, conditions, tmp_path, SimpleNamespace(count=2, run=run))
    found = {(point.curve, point.depth, point.metric): point for point in points}
    assert len(found) == len(points) == 5 * 3
    for curve, openings in paths.items():
        for depth, opening in enumerate(openings):
            iou, sim, score = (found[curve, depth, metric] for metric in (IOU, SIM, SCORE))
            assert (iou.successes, iou.trials) == (2 if opening == 60.0 else 0, 3)
            assert (sim.successes >= 2) == (opening == 60.0)
            assert sim.trials == 3
            assert score.value == depth / 10
            assert (iou.operation, iou.objects) == (["root", "deeper(1)", "wider(2)"][depth], "boxes.h5 (01234567)")


def test_a_rate_that_workers_died_on_is_an_error(conditions, network, tmp_path):
    workers = SimpleNamespace(run=lambda *_: [(0, Crash(-9, 2))])
    found = [network("a", 60.0, "x" * 64)]
    with pytest.raises(ResultsError, match=r"died 2 times.*again"):
        run_experiment_module._iou_rates(
            found, tmp_path, conditions.data, PAPER, 1, workers, tmp_path / "iou.json", lambda *_: None
        )
    assert not (tmp_path / "iou.json").exists()


def test_no_other_network_takes_the_place_of_the_published_one(conditions, tmp_path, monkeypatch):
    from ggcnn_net2net.reproduce import networks

    stand_in = networks.Network("original (stand-in)", "C1x1x1", 17, model=object(), stand_in=True)
    monkeypatch.setattr(networks, "load_networks", lambda _: [stand_in])
    with pytest.raises(ResultsError, match=r"published.*such as zoo:original_retrained"):
        run_experiment(part_of(FIG2, curves=["e=2"]), conditions, tmp_path, None)


@pytest.mark.parametrize("protocol", [PAPER, CORRECTED])
def test_a_run_starts_from_the_network_of_the_protocol(protocol, conditions, tmp_path, monkeypatch):
    class Stop(Exception):
        pass

    def load(specs):
        raise Stop(*specs)

    monkeypatch.setattr("ggcnn_net2net.reproduce.networks.load_networks", load)
    curve = Curve("two", network="masked.hdf5", paper_network="all_pixels.hdf5")
    with pytest.raises(Stop, match="masked.hdf5" if protocol.masked_loss else "all_pixels.hdf5"):
        run_experiment(Experiment("two", "Two", (curve,), (protocol,)), conditions, tmp_path, SimpleNamespace(count=1))


@pytest.mark.parametrize("protocol", ["paper", "corrected"])
def test_the_default_starts_have_learnt_with_the_loss_to_come(protocol, asked):
    options = ("--run", "--data", "my.h5", "--workers", 1, "--protocol", protocol)
    assert "was trained with the loss of" not in call(figures.fig3, *options)
    assert (
        "zoo:narrow was trained with the loss of CORRECTED"
        in call(figures.fig3, *options, "--networks", "narrow=zoo:narrow")
    ) == (protocol == "paper")


@pytest.mark.slow
def test_what_a_later_search_would_refuse_is_refused_before_the_first(ran, conditions, tmp_path):
    experiment, _, _ = ran
    first = experiment.curves[0]
    with LocalWorkers(1) as workers:
        for later, message in (
            (replace(first, name="later", network="typo.hdf5"), "typo.hdf5"),
            (replace(first, name="later", epochs=0), "epochs"),
        ):
            with pytest.raises(GGCNNError, match=message):
                run_experiment(Experiment("two", "Two", (first, later), (PAPER,)), conditions, tmp_path, workers)
    assert not (tmp_path / "searches").exists()


@pytest.mark.slow
def test_another_experiment_is_not_continued(ran, conditions):
    experiment, folder, _ = ran
    with LocalWorkers(1) as workers:
        with pytest.raises(ResultsError, match=r"received other settings: choose another --output"):
            run_experiment(experiment, replace(conditions, learning_rate=3e-4), folder, workers)
        with pytest.raises(ResultsError, match=r"with the scenes it was begun with"):  # before any search
            run_experiment(experiment, replace(conditions, seed=1), folder, workers)


@pytest.mark.slow
def test_searches_that_could_not_begin_are_in_nobodys_way(ran, conditions, tmp_path, monkeypatch):
    told = []

    class Stop(Exception):
        pass

    def start(*_, reuse, **options):
        told.append((reuse, options))
        raise Stop

    monkeypatch.setattr("ggcnn_net2net.search.start_search", start)
    searches = tmp_path / "searches"
    for name in ("short-paper", "other-paper"):  # the second is this one's neighbour
        (searches / name).mkdir(parents=True)
        (searches / name / "journal.jsonl").touch()
    experiment = part_of(ran[0], curves=["short"], protocols=[PAPER])
    with LocalWorkers(1) as workers, pytest.raises(Stop):
        run_experiment(experiment, conditions, tmp_path, workers)
    assert told[0][0] == []


@pytest.mark.slow
def test_curves_have_the_threads_of_those_that_were_begun(ran, conditions, tmp_path, monkeypatch):
    """A worker process serves several curves, and cannot change its threads."""
    _, folder, _ = ran
    begun = load_history(folder / "searches" / "short-paper")
    told = []

    class Stop(Exception):
        pass

    def start(model, data, settings, *_, **options):
        told.append((settings.threads, options["reuse"]))
        raise Stop

    monkeypatch.setattr("ggcnn_net2net.search.start_search", start)
    shutil.copytree(folder / "searches" / "short-paper", tmp_path / "searches" / "short-paper")
    experiment = Experiment("tiny", "Tiny", (replace(ran[0].curves[0], name="new"),), (PAPER,))
    monkeypatch.setattr("os.cpu_count", lambda: 64)
    with LocalWorkers(1) as workers, pytest.raises(Stop):
        run_experiment(experiment, conditions, tmp_path, workers)
    assert told == [(begun.settings.threads, [tmp_path / "searches" / "short-paper"])]


def test_a_figure_from_shipped_results(tmp_path):
    for command in (figures.fig2, figures.fig3, figures.epochs):
        shown = call(command, "-o", tmp_path / command.name)
        assert "results that ship with the package" in shown
        for suffix in (".png", ".md", ".csv"):
            assert (tmp_path / command.name / f"{command.name}{suffix}").stat().st_size > 0


@pytest.fixture
def asked(monkeypatch, tmp_path):
    """Part of an experiment and conditions that a command line asks for, by experiment; nothing is run."""
    found = {}

    def run(experiment, conditions, output, workers, *, work, **_):
        found[experiment.name] = (experiment, conditions, output, work)

    monkeypatch.setattr("ggcnn_net2net.reproduce.run_experiment.run_experiment", run)
    monkeypatch.chdir(tmp_path)
    Path("my.h5").touch()
    return found


def test_what_the_options_ask_for(asked):
    options = ("--run", "--data", "my.h5", "--workers", 1)
    call(figures.fig2, *options, "--budget", "quick", "--network", "a.hdf5", "--curves", "e=2, e=2 r=8", "--seed", 4)
    experiment, conditions, output, work = asked["fig2"]
    assert [(curve.name, curve.network) for curve in experiment.curves] == [("e=2", "a.hdf5"), ("e=2 r=8", "a.hdf5")]
    assert experiment.protocols == (PAPER, CORRECTED)
    assert (str(conditions.data), conditions.budget, conditions.seed) == ("my.h5", "quick", 4)
    assert (conditions.objects, conditions.poses) == ("procedural40", 5)
    assert (conditions.max_parameters, conditions.effort) == (None, "quick")
    assert (str(output), work) == ("results/fig2", None)
    beside = ("--max-params", 16104, "--learning-rate", 3e-4)
    call(figures.fig3, *options, *beside, "--networks", "narrow=n.hdf5", "--protocol", "corrected", "-o", "mine")
    experiment, conditions, output, _ = asked["fig3"]
    assert conditions.effort == "standard, at most 16,104 parameters, learning rate 0.0003"
    assert [curve.network for curve in experiment.curves] == ["n.hdf5", "zoo:shallow"]
    assert experiment.protocols == (CORRECTED,)
    assert str(output) == "mine"


@pytest.mark.parametrize("folder", [None, "mine"])
def test_all_runs_a_search_of_two_figures_once(asked, monkeypatch, folder):
    import click

    from ggcnn_net2net.cli import reproduce

    told = {}
    monkeypatch.setattr(
        reproduce, "table1", click.Command("table1", callback=lambda **options: told.update(options) or 3)
    )
    monkeypatch.setattr(figures, "fig1", click.Command("fig1", callback=lambda output: told.update(fig1=str(output))))
    options = ["--run", "--data", "my.h5", "--workers", "1", "--poses", "2", "--objects", "ycb40", "--seed", "4"]
    options += ["-o", folder] if folder else []
    result = CliRunner().invoke(figures.everything, options, standalone_mode=False)
    assert result.return_value == 3  # grasps were lost
    assert told == {
        "objects_spec": "ycb40",
        "poses": 2,
        "seed": 4,
        "protocol_name": "paper",
        "workers": 1,
        "output": Path(folder) / "table1" if folder else None,
        "fig1": f"{folder or 'results'}/fig1/fig1.png",
    }
    assert set(asked) == {"fig2", "fig3", "epochs"}
    assert {str(work) for _, _, _, work in asked.values()} == {f"{folder or 'results'}/runs"}
    assert str(asked["fig2"][2]) == f"{folder or 'results'}/fig2"
    assert "e=2" in {curve.name for curve in asked["epochs"][0].curves}


@pytest.mark.parametrize("wrong", [("--network", "typo.hdf5"), ("--networks", "shallow=typo.hdf5")])
def test_all_refuses_a_wrong_network_before_table1(wrong, asked, monkeypatch):
    import click

    from ggcnn_net2net.cli import reproduce

    ran = []
    monkeypatch.setattr(reproduce, "table1", click.Command("table1", callback=lambda **options: ran.append(options)))
    with pytest.raises(ResultsError, match=r"typo\.hdf5"):
        call(figures.everything, "--run", "--data", "my.h5", *wrong)
    assert not ran


@pytest.mark.parametrize(
    ("command", "options", "message"),
    [
        (figures.fig2, ["--run"], "needs --data"),
        (figures.fig2, ["--run", "--data", "typo.h5"], "typo.h5"),
        (figures.everything, ["--run"], "needs --data"),
        (figures.fig3, ["--networks", "narrow"], "CURVE=MODEL"),
    ],
)
def test_wrong_usage(command, options, message):
    result = CliRunner().invoke(command, options)
    assert result.exit_code == 2
    assert message in result.output


def test_help_does_not_wait_for_tensorflow():
    code = (
        "import sys; from ggcnn_net2net.cli.figures import *; "
        "fig2.main(['--help'], standalone_mode=False); "
        "print(sorted({'tensorflow', 'keras', 'matplotlib', 'h5py', 'pybullet'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "--curves" in done.stdout
    assert done.stdout.strip().endswith("[]")
