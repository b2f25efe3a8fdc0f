"""What training reads, in which order, and how it is read ahead."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import TrainingError

Batch = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]
"""Inputs (n, H, W, 1), depth in metres minus its mean, and targets (n, H, W, 4): quality, cos 2θ, sin 2θ, width / 150
px."""

_AHEAD = 2  # batches in memory besides the one in use


class TrainingData(Protocol):
    """Images with their targets, read in batches. Any object with these members does."""

    @property
    def fingerprint(self) -> str:
        """Hash of the content: two data sets with the same one train alike."""
        ...

    def __len__(self) -> int:
        """Images an epoch."""
        ...

    def batch(self, rows: Sequence[int], epoch: int) -> Batch:
        """Inputs and targets of some rows; `epoch` chooses their augmentation where that is made afresh.

        Args:
            rows: indices from 0 to `len` - 1, in any order.
            epoch: from 0.

        Returns:
            (n, H, W, 1) depth in metres minus each image's mean, and (n, H, W, 4) targets, float32.
        """
        ...


def batches_of_epoch(
    n_images: int, batch_size: int, epoch: int, *, seed: int, shuffled_rows: bool, budget: int | None = None
) -> list[list[int]]:
    """Rows of each batch of one epoch, a function of the arguments alone.

    What does not fill a batch is left out: with `shuffled_rows` other images every epoch, else always the last ones, as
    in the public code of the paper.

    Args:
        n_images: rows there are.
        batch_size: rows of a batch.
        epoch: from 0.
        seed: seed of the order.
        shuffled_rows: False takes batches of consecutive rows and shuffles the batches, as the public code of the paper
            does; True shuffles the rows.
        budget: images of the epoch, if it is not to see all of them.

    Raises:
        TrainingError: not even one batch.
    """
    wanted = n_images if budget is None else min(budget, n_images)
    if wanted < batch_size:
        raise TrainingError(
            f"expected at least one batch of {batch_size} images an epoch, received {n_images} images"
            + ("" if budget is None else f" and a budget of {budget}")
            + ": lower the batch size or use more images"
        )
    random = np.random.default_rng([seed, epoch])
    n_batches = n_images // batch_size
    if shuffled_rows:
        rows = random.permutation(n_images)[: n_batches * batch_size].reshape(n_batches, batch_size)
    else:
        rows = np.arange(n_batches * batch_size).reshape(n_batches, batch_size)[random.permutation(n_batches)]
    batches: list[list[int]] = rows[: wanted // batch_size].tolist()
    return batches


def read_ahead(data: TrainingData, batches: Sequence[Sequence[int]], epoch: int) -> Generator[Batch]:
    """Yield the batches in order while a thread reads the next ones, at most two of them.

    An error of `data.batch` is raised where its batch is due. Closing the generator ends the thread.
    """
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="read_ahead") as pool:
        pending: deque[Future[Batch]] = deque()
        try:
            for rows in batches:
                pending.append(pool.submit(data.batch, rows, epoch))
                if len(pending) > _AHEAD:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()
