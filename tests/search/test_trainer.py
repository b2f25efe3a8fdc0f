"""Real searches, small ones: trained in worker processes, scored, killed, taken up again."""

from __future__ import annotations

import json
import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from search_data import ARCHITECTURE, SIZE, outcome_of, run_job_on_full_disk

from ggcnn_net2net.architecture import build_ggcnn
from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.inference import predict_grasps
from ggcnn_net2net.model_files import load_ggcnn, save_ggcnn
from ggcnn_net2net.net2net import history_of
from ggcnn_net2net.parallel import LocalWorkers
from ggcnn_net2net.protocol import CORRECTED
from ggcnn_net2net.search import SearchSettings, load_history, resume_search, start_search
from ggcnn_net2net.search.heuristics import prepare_simulation, score
from ggcnn_net2net.search.journal import read_events
from ggcnn_net2net.search.trainer import checkpoint_dir, model_file, run_job
from ggcnn_net2net.simulation.benchmark import prepare_scenes, run_trials
from ggcnn_net2net.simulation.object_sets import load_object_set
from ggcnn_net2net.simulation.scenes import SceneSettings, depth_images
from ggcnn_net2net.simulation.trial import decoding_of
from ggcnn_net2net.training import Recipe

PUBLISHED_LOSS = replace(CORRECTED, masked_loss=False)
SMALL = SearchSettings(width=2, depth=2, heuristic="loss", recipe=Recipe(epochs=2, protocol=PUBLISHED_LOSS))
ONE_STEP = replace(SMALL, depth=1)


@pytest.fixture(scope="module")
def model():
    return build_ggcnn(ARCHITECTURE, input_size=SIZE, seed=0)


@pytest.fixture(scope="module")
def pool():
    with LocalWorkers(2) as workers:
        yield workers


@pytest.fixture(scope="module")
def undisturbed(model, dataset, pool, tmp_path_factory):
    """What a search of two steps comes to."""
    directory = tmp_path_factory.mktemp("undisturbed") / "search"
    start_search(model, dataset, SMALL, directory, pool)
    return outcome_of(directory)


@pytest.fixture
def one_step(model, dataset, pool, tmp_path):
    """Search for one step; returns (history, folder)."""
    folders = iter(tmp_path / str(number) for number in range(100))

    def start(**options):
        directory = next(folders)
        settings = options.pop("settings", ONE_STEP)
        return start_search(model, dataset, replace(settings, **options), directory, pool), directory

    return start


def scores(history):
    return {one.sequence: one.score for one in history.candidates.values()}


@pytest.mark.slow
def test_a_search_finds_a_network_and_keeps_it(undisturbed, model, dataset, pool, tmp_path):
    assert all(math.isfinite(score) for score in undisturbed["scores"].values())
    assert len(set(undisturbed["weights"].values())) == len(undisturbed["weights"])
    history = start_search(model, dataset, SMALL, tmp_path / "search", pool)
    (_, first), *_, (last, score) = history.path
    assert score < first
    found = load_ggcnn(model_file(tmp_path / "search", last.key))
    assert [entry["operation"] for entry in history_of(found)] == list(last.operations)
    assert found.count_params() == last.parameters
    assert outcome_of(tmp_path / "search") == undisturbed
    assert not list((tmp_path / "search").glob("candidates/*/training_*"))


@pytest.mark.slow
def test_one_worker_is_enough(undisturbed, model, dataset, tmp_path):
    with LocalWorkers(1) as workers:
        start_search(model, dataset, SMALL, tmp_path / "search", workers)
    assert outcome_of(tmp_path / "search") == undisturbed


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_in_mid_training(undisturbed, model, dataset, tmp_path):
    from distributed import LocalCluster

    from ggcnn_net2net.cluster import DaskWorkers

    killed = []
    directory = tmp_path / "search"

    def kill_a_worker():
        """Wait for a training that has finished its first epoch."""
        while not list(directory.glob("candidates/*/training_0/checkpoint.npz")):
            time.sleep(0.01)
        nanny = next(iter(cluster.workers.values()))
        os.kill(nanny.pid, signal.SIGKILL)
        killed.append(nanny.pid)

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        threading.Thread(target=kill_a_worker, daemon=True).start()
        with DaskWorkers(cluster.scheduler_address) as workers:
            start_search(model, dataset, SMALL, directory, workers)
    assert killed
    assert outcome_of(directory) == undisturbed


@pytest.mark.slow
@pytest.mark.timeout(2400)  # starts TensorFlow 25 times: ten minutes and more on a slow machine
def test_kill_9_at_20_random_moments(undisturbed, dataset, tmp_path):
    """Five searches, each killed four times, the worker with it or not; all end with the same bits."""

    def search_with_kills(number):
        moments = random.Random(number)
        trained = []
        for _ in range(4):
            kill_at(tmp_path / str(number), dataset, moments)
            trained.append(count_scored(tmp_path / str(number)))
        with LocalWorkers(1) as workers:
            resume_search(tmp_path / str(number), workers)
        return trained, outcome_of(tmp_path / str(number))

    with ThreadPoolExecutor(2) as side_by_side:
        results = list(side_by_side.map(search_with_kills, range(5)))
    assert [outcome for _, outcome in results] == [undisturbed] * 5
    # The kills fell into the search, and not before or after it.
    trained = {count for counts, _ in results for count in counts}
    assert len({count for count in trained if 0 < count < len(undisturbed["scores"])}) >= 6


def kill_at(directory: Path, dataset: Path, moments: random.Random) -> None:
    """Start the search, or go on with it, and kill it some candidates later."""
    script = Path(__file__).with_name("search_data.py")
    command = [sys.executable, str(script), str(directory), str(dataset), json.dumps(SMALL.as_dict()), "1"]
    enough = count_scored(directory) + moments.randint(1, 4)
    process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 300
    while count_scored(directory) < enough and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(moments.uniform(0, 1))
    if moments.random() < 0.5:
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()  # its worker notices by itself
    process.wait()


def count_scored(directory: Path) -> int:
    events = read_events(directory / "journal.jsonl")
    return sum(event["event"] == "scored" for event in events)


@pytest.mark.slow
def test_a_training_that_diverges_is_recorded(one_step, tmp_path):
    recipe = replace(ONE_STEP.recipe, learning_rate=1e30)
    with pytest.raises(SearchError, match=r"all 4 failed, the last with: TrainingError: expected a finite loss"):
        one_step(recipe=recipe, max_failures=100)
    history = load_history(tmp_path / "0")
    assert len(history.failed) == len(history.candidates) - 1 == 4
    assert not history.finished
    assert all("TrainingError: expected a finite loss" in one.error for one in history.failed)
    assert all("Traceback" in one.traceback for one in history.failed)
    assert [one.operation for one, _ in history.path] == ["root"]


class FullDisk:
    """Workers whose disk is full when they come to *deeper(2)*."""

    def __init__(self, pool):
        self._pool = pool
        self.count = pool.count

    def run(self, function, inputs):
        assert function is run_job
        return self._pool.run(run_job_on_full_disk, inputs)


@pytest.mark.slow
def test_a_full_disk_stops_the_search_and_fails_no_candidate(one_step, model, dataset, pool, tmp_path):
    whole, _ = one_step()
    with pytest.raises(
        SearchError, match=r"received cannot save: \[Errno 28\] No space left .* go on with `.* resume "
    ):
        start_search(model, dataset, ONE_STEP, tmp_path / "full", FullDisk(pool))
    before = load_history(tmp_path / "full")
    assert not before.failed
    assert not before.finished
    assert scores(resume_search(tmp_path / "full", pool)) == scores(whole)


@pytest.mark.slow
def test_what_goes_beyond_the_paper_makes_a_difference(one_step, tmp_path, model):
    plain = scores(one_step()[0])
    noisy = replace(PUBLISHED_LOSS, wider_noise=1.0)
    quiet = replace(PUBLISHED_LOSS, wider_noise=0.0)
    with_noise, without = (
        scores(one_step(recipe=replace(ONE_STEP.recipe, protocol=protocol))[0]) for protocol in (noisy, quiet)
    )
    changed = {name for name in with_noise if with_noise[name] != without[name]}
    assert changed == {"wider(1)", "wider(2)"}
    teacher = save_ggcnn(build_ggcnn(ARCHITECTURE, input_size=SIZE, seed=5), tmp_path / "teacher.hdf5")
    for distil in ("parent", str(teacher)):
        distilled = scores(one_step(distil=distil)[0])
        assert distilled["root"] == plain["root"]
        assert all(distilled[name] != plain[name] for name in plain if name != "root")


@pytest.mark.slow
def test_the_optimizer_is_carried_from_the_second_step_on(model, dataset, pool, tmp_path):
    results = {}
    for carry in (False, True):
        settings = replace(SMALL, carry_optimizer=carry, width=1, lookahead=False)
        directory = tmp_path / str(carry)
        results[carry] = start_search(model, dataset, settings, directory, pool)
        kept = [checkpoint_dir(directory, key).exists() for key in results[carry].candidates]
        assert kept == [carry and one.depth > 0 for one in results[carry].candidates.values()]
    fresh, carried = map(scores, (results[False], results[True]))
    first = [name for name in fresh if name == "root" or "," not in name]
    assert all(fresh[name] == carried[name] for name in first)
    assert all(fresh[name] != carried[name] for name in fresh.keys() & carried.keys() - set(first))
    assert len(fresh.keys() & carried.keys()) > len(first)


@pytest.mark.slow
def test_successive_halving_goes_on_where_a_rung_ended(one_step):
    recipe = replace(ONE_STEP.recipe, epochs=4)
    whole = one_step(recipe=recipe)[0]
    halved = one_step(recipe=recipe, halving=True, width=1)[0]
    states = {one.sequence: one.state for one in halved.candidates.values()}
    (survivor,) = [name for name, state in states.items() if state == "trained"]
    assert sorted(states.values()) == ["pruned"] * 3 + ["root", "trained"]
    assert scores(halved)[survivor] == scores(whole)[survivor]  # the same bits as in one go


@pytest.mark.slow
def test_the_score_in_simulation_is_the_benchmarks(data_root, dataset, tmp_path):
    settings = replace(SMALL, heuristic="sim", sim_objects="training:3:1", sim_poses=2)
    network = load_ggcnn("published")
    objects = load_object_set("training:3:1", settings.protocol)
    with LocalWorkers(2) as workers:
        prepare_simulation(settings, tmp_path, workers)
        scenes = prepare_scenes(tmp_path / "scenes.h5", objects, SceneSettings.of(objects, 2, 0), workers)
        grasps = predict_grasps(network, depth_images(scenes), decoding_of(settings.protocol))
        successes = [result.success for _, result in run_trials(scenes, grasps, settings.protocol, workers)]
    assert len(successes) == 6
    assert 0 < score(network, settings, dataset, tmp_path) == sum(successes) / 6
