"""The command `search`, on a data file of a few small images."""

import csv
import json
import signal
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner

import ggcnn_net2net as gn
from ggcnn_net2net.cli.search import search_command
from ggcnn_net2net.errors import ArchitectureError, DatasetError, SearchError
from ggcnn_net2net.search import SearchSettings, load_history

ARCHITECTURE = "C5x5x2_C3x3x2_T3x3x2_T5x5x2"
SMALL = ("--beam", 1, "--depth", 1, "--epochs", 1, "--heuristic", "loss", "--workers", 2)


def call(*arguments):
    result = CliRunner().invoke(search_command, [str(part) for part in arguments], standalone_mode=False)
    if result.exception:
        raise result.exception
    return result.output


@pytest.fixture(scope="module")
def searched(dataset, tmp_path_factory):
    """A finished search: (folder, what was printed)."""
    directory = tmp_path_factory.mktemp("searched") / "search"
    return directory, call(ARCHITECTURE, dataset, "-o", directory, *SMALL)


@pytest.mark.slow
def test_it_writes_the_best_network_and_a_report(searched):
    directory, shown = searched
    history = load_history(directory)
    assert history.finished
    assert history.trained == 4
    best = gn.load_ggcnn(directory / "best.hdf5")
    assert str(gn.architecture_of(best)) == history.best.architecture
    assert "best.hdf5" in shown
    with (directory / "report" / "candidates.csv").open() as stream:
        assert len(list(csv.DictReader(stream))) == 5
    assert (directory / "report" / "tree.svg").stat().st_size > 0


@pytest.mark.slow
def test_report_and_resume_need_nothing_but_the_folder(searched, tmp_path):
    directory, _ = searched
    shown = call("report", directory, "-o", tmp_path / "elsewhere")
    assert "Path of the search" in shown
    assert (tmp_path / "elsewhere" / "report.md").is_file()
    before = (directory / "journal.jsonl").read_bytes()
    call("resume", directory)
    assert (directory / "journal.jsonl").read_bytes() == before


@pytest.mark.slow
def test_candidates_are_taken_from_another_search(searched, dataset, tmp_path):
    first, _ = searched
    call(ARCHITECTURE, dataset, "-o", tmp_path / "second", *SMALL, "--reuse", first)
    paths = [load_history(folder).path for folder in (tmp_path / "second", first)]
    second, other = ([(candidate.key, score) for candidate, score in path] for path in paths)
    assert second == other
    events = [json.loads(line) for line in (tmp_path / "second" / "journal.jsonl").read_text().splitlines()]
    assert {event["taken_from"] for event in events if event["event"] == "scored"} == {str(first)}
    assert (tmp_path / "second" / "best.hdf5").read_bytes() == (first / "best.hdf5").read_bytes()


@pytest.mark.slow
def test_a_folder_holds_one_search(searched, dataset):
    with pytest.raises(SearchError, match="search resume"):
        call(ARCHITECTURE, dataset, "-o", searched[0], *SMALL)


@pytest.mark.slow
def test_ctrl_c_tells_how_to_go_on(dataset, tmp_path):
    directory = tmp_path / "search"
    command = [sys.executable, "-m", "ggcnn_net2net", "search", ARCHITECTURE, dataset, "-o", directory, *SMALL]
    process = subprocess.Popen(
        [str(part) for part in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    while not list(directory.glob("candidates/*/training_0")):  # in mid-training
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"search resume {directory}" in errors
    assert "Traceback" not in errors
    call("resume", directory)
    assert load_history(directory).trained == 4


@pytest.fixture
def asked(dataset, tmp_path, monkeypatch):
    """The settings that a command line asks for; nothing is searched."""

    def settings_of(*options) -> SearchSettings:
        caught = []

        class Stop(Exception):
            pass

        def start_search(_network, _dataset, settings, *_, **__):
            caught.append(settings)
            raise Stop

        monkeypatch.setattr("ggcnn_net2net.search.start_search", start_search)
        with pytest.raises(Stop):
            call(ARCHITECTURE, dataset, "-o", tmp_path / "search", "--workers", 1, *options)
        return caught[0]

    return settings_of


def test_the_defaults_are_the_papers_at_standard_budget(asked):
    settings = asked()
    assert (settings.width, settings.depth, settings.lookahead, settings.retrain) == (3, 5, True, 0)
    assert (settings.recipe.epochs, settings.recipe.images_per_epoch) == (2, 1500)
    assert settings.protocol == gn.PAPER
    assert settings == SearchSettings(recipe=settings.recipe, score_images=500, threads=settings.threads)


def test_options_reach_the_settings(asked):
    settings = asked(
        *("--beam", 2, "--depth", 4, "--transpose", "--retrain", 8, "--epochs", 5),
        *("--budget", "quick", "--score-images", 7, "--max-params", 16104, "--patience", 2, "--heuristic", "loss"),
        *("--protocol", "corrected", "--wider-noise", 0.7, "--halving", "--replicates", 3, "--carry-optimizer"),
        *("--seed", 4, "--threads", 2, "--max-failures", 9, "--learning-rate", 1e-4),
    )
    assert (settings.width, settings.depth, settings.lookahead, settings.transpose) == (2, 4, True, True)
    assert not asked("--no-lookahead").lookahead
    assert (settings.retrain, settings.recipe.epochs, settings.recipe.learning_rate) == (8, 5, 1e-4)
    assert (settings.score_images, settings.max_parameters, settings.patience) == (7, 16104, 2)
    assert settings.recipe.images_per_epoch < 1000
    assert settings.protocol.wider_noise == 0.7
    assert settings.protocol.masked_loss
    assert (settings.halving, settings.replicates, settings.carry_optimizer) == (True, 3, True)
    assert (settings.seed, settings.threads, settings.max_failures) == (4, 2, 9)


def test_a_teacher_turns_the_masked_loss_off(asked):
    settings = asked("--protocol", "corrected", "--distil", "parent", "--distil-weight", 0.2)
    assert not settings.protocol.masked_loss
    assert (settings.distil, settings.distil_weight) == ("parent", 0.2)


def test_wrong_input(dataset, tmp_path):
    with pytest.raises(DatasetError, match="dataset build"):
        call(ARCHITECTURE, tmp_path / "missing.h5", "-o", tmp_path / "search")
    with pytest.raises(ArchitectureError):
        call("broad", dataset, "-o", tmp_path / "search")
    with pytest.raises(SearchError, match="folder of a search"):
        call("report", tmp_path)
    assert not (tmp_path / "search").exists()


def test_help_names_the_commands():
    shown = call("--help")
    for words in ("resume", "report", "search MODEL DATASET"):
        assert words in shown
    assert "--max-params" in call("run", "--help")


QUICK = """
import sys
from ggcnn_net2net.cli.search import search_command
search_command(["run", "--help"], standalone_mode=False)
sys.exit(any(name in sys.modules for name in ("tensorflow", "keras", "matplotlib")))
"""


def test_help_is_quick():
    assert subprocess.run([sys.executable, "-c", QUICK], check=False, capture_output=True).returncode == 0


@pytest.mark.slow
def test_the_journal_says_how_it_was_started(searched):
    event = json.loads((searched[0] / "journal.jsonl").open().readline())
    assert event["command"].startswith("ggcnn-net2net")
    assert event["network"] == ARCHITECTURE
    assert event["versions"]["keras"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "told"),
    [((), ""), (("--budget", "quick"), "it differs in recipe.images_per_epoch, score_images\n")],
)
def test_a_search_of_which_nothing_can_be_taken_is_named(searched, dataset, tmp_path, monkeypatch, options, told):
    def stop(*_, **__):
        raise SearchError("not in this test")

    monkeypatch.setattr("ggcnn_net2net.search.start_search", stop)
    arguments = (ARCHITECTURE, dataset, "-o", tmp_path / "second", *SMALL, "--reuse", searched[0], *options)
    result = CliRunner().invoke(search_command, [str(part) for part in arguments], standalone_mode=False)
    assert isinstance(result.exception, SearchError)
    assert result.stderr.startswith(f"{ARCHITECTURE}: an architecture, with new weights\n")
    assert (f"Nothing can be taken from {searched[0]}, " in result.stderr) is bool(told)
    assert result.stderr.endswith(told)
