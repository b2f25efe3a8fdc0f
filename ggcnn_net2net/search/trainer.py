"""What a worker does: make a candidate, train it, score it. The candidate's folder takes what comes of it."""

from __future__ import annotations

import os
import platform
import time
import traceback
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.parallel import Crash
from ggcnn_net2net.search.candidates import ROOT, Candidate
from ggcnn_net2net.search.journal import Event, resume_command, score_to_json
from ggcnn_net2net.search.settings import FROM_PARENT, SearchSettings

if TYPE_CHECKING:
    import keras

    from ggcnn_net2net.training import Recipe, TrainingData

MODEL_FILE = "model.hdf5"
TEACHER_FILE = "teacher.hdf5"


def model_file(directory: Path, key: str) -> Path:
    """Where the weights of a candidate stand in the folder of a search."""
    return directory / "candidates" / key / MODEL_FILE


def checkpoint_dir(directory: Path, key: str, replicate: int = 0) -> Path:
    """Where a training of a candidate puts its state after every epoch."""
    return model_file(directory, key).parent / f"training_{replicate}"


@dataclass(frozen=True)
class Job:
    """One training of one candidate."""

    directory: Path
    """Folder of the search; all machines see it under this name."""
    settings: SearchSettings
    data: str
    """Dataset file."""
    candidate: Candidate
    epochs: int
    """Epochs that the candidate has seen in the end; 0 scores it as it is."""
    replicate: int
    """From 0; the weights of number 0 are kept."""
    seed: int
    """Of the surgery and the training."""

    @property
    def checkpoint_dir(self) -> Path:
        """Where the training puts its state after every epoch."""
        return checkpoint_dir(self.directory, self.candidate.key, self.replicate)

    @property
    def recipe(self) -> Recipe:
        """How this candidate is trained."""
        return replace(self.settings.recipe, epochs=self.epochs, seed=self.seed)

    def crashed(self, crash: Crash) -> Event:
        """What to tell of a job on which workers died."""
        last = "" if crash.exit_code is None else f", the last time with exit code {crash.exit_code}"
        error = f"the worker process died {crash.attempts} times{last}: is memory short?"
        return {"event": "failed", **self.facts(), "error": error, "traceback": "", "seconds": 0}

    def facts(self) -> Event:
        """What is the same for all outcomes."""
        return {**_names(self.candidate), "epochs": self.epochs, "replicate": self.replicate}


def _names(candidate: Candidate) -> dict[str, Any]:
    return {"candidate": candidate.key, "parent": candidate.parent, "operation": candidate.operation}


def run_job(job: Job) -> Event:
    """Make, train and score a candidate.

    Returns:
        An event of the journal: "scored", or "failed" with the traceback.

    Raises:
        SearchError: a file cannot be read or written, a full disk for one, or the dataset is damaged. That says nothing
            of the candidate, so it must not rank last for it.
        TrainingError: this process computes with another number of threads already, which says nothing of it either.
    """
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.training import set_threads

    import_tensorflow()
    set_threads(job.settings.threads)
    started = time.time()
    facts = {**job.facts(), "started": started, "worker": f"{platform.node()}:{os.getpid()}"}
    try:
        outcome = {"event": "scored", **facts, **_train_and_score(job)}
    except Exception as error:
        if _is_of_files(error):
            raise SearchError(
                f"expected to read and write {job.directory} and {job.data}, received {error}: mend it, then go on "
                f"with `{resume_command(job.directory)}`"
            ) from error
        message = " ".join(f"{type(error).__name__}: {error}".splitlines()[:1])
        outcome = {"event": "failed", **facts, "error": message, "traceback": traceback.format_exc()}
    _tidy_up()
    return {**outcome, "seconds": time.time() - started}


def _is_of_files(error: BaseException | None) -> bool:
    """Whether it is an error of the dataset or the disk, or comes from one."""
    from ggcnn_net2net.errors import DatasetError

    while error is not None:
        if isinstance(error, (OSError, DatasetError)):
            return True
        error = error.__cause__
    return False


def _train_and_score(job: Job) -> dict[str, Any]:
    from ggcnn_net2net.architecture import architecture_of
    from ggcnn_net2net.errors import ArchitectureError
    from ggcnn_net2net.model_files import save_ggcnn
    from ggcnn_net2net.net2net import operations, parameters_after
    from ggcnn_net2net.search.heuristics import score

    model, loss = _trained(job)
    if job.replicate == 0:
        save_ggcnn(model, model_file(job.directory, job.candidate.key))
    try:
        architecture = str(architecture_of(model))
    except ArchitectureError:  # a relative of GG-CNN that the notation cannot express
        architecture = ""
    following = operations(model, transpose=job.settings.transpose)
    return {
        "score": score_to_json(score(model, job.settings, Path(job.data), job.directory)),
        "loss": loss,
        "parameters": model.count_params(),
        "architecture": architecture,
        "operations": dict(zip(map(str, following), parameters_after(model, following), strict=True)),
    }


def _trained(job: Job) -> tuple[keras.Model, float | None]:
    """The candidate, and the mean loss of its last epoch."""
    from ggcnn_net2net.net2net import apply_operations
    from ggcnn_net2net.training import train

    settings, candidate = job.settings, job.candidate
    if candidate.operation == ROOT:
        return _load(model_file(job.directory, candidate.key)), None
    assert candidate.parent is not None
    parent = _load(model_file(job.directory, candidate.parent))
    carried = settings.carry_optimizer and _carry_optimizer(job, parent)
    start = parent
    if candidate.is_child:
        noise = settings.protocol.wider_noise
        start = apply_operations(parent, candidate.operation, job.seed, noise=noise, carry_optimizer=carried)
    result = train(
        start,
        _training_data(job, parent),
        job.recipe,
        checkpoint_dir=job.checkpoint_dir,
        carry_optimizer=carried,
    )
    return result.model, result.history[-1]["loss"]


def _load(path: Path) -> keras.Model:
    """A network of the search's own folder, which is at fault if that fails, and not the candidate."""
    from ggcnn_net2net.errors import ModelFileError
    from ggcnn_net2net.model_files import load_ggcnn

    try:
        return load_ggcnn(path)
    except ModelFileError as error:
        raise OSError(error) from error


def _training_data(job: Job, parent: keras.Model) -> TrainingData:
    """The train split, with a teacher's maps mixed into the labels where the search distils."""
    from ggcnn_net2net.datasets.hdf5 import GraspDataset
    from ggcnn_net2net.training.distillation import Distilled

    data = GraspDataset(Path(job.data), "train")
    if job.settings.distil is None:
        return data
    teacher = parent if job.settings.distil == FROM_PARENT else _load(job.directory / TEACHER_FILE)
    return Distilled(data, teacher, job.settings.distil_weight)


def _carry_optimizer(job: Job, parent: keras.Model) -> bool:
    """Give the parent the optimizer that its training ended with; the root of a search has none.

    Returns:
        Whether there is one.
    """
    from ggcnn_net2net.training.checkpoint import load_optimizer

    assert job.candidate.parent is not None
    trained = checkpoint_dir(job.directory, job.candidate.parent)
    if not trained.exists():
        return False
    parent.compile(optimizer=job.recipe.new_optimizer(steps_per_epoch=1))  # which only a schedule asks for
    load_optimizer(trained, parent)
    return True


def _tidy_up() -> None:
    """Leave nothing of a candidate in the process, which goes on to others."""
    import keras

    keras.backend.clear_session()
