import threading
import time
from itertools import chain

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.errors import TrainingError
from ggcnn_net2net.training.data import batches_of_epoch, read_ahead

sizes = st.integers(1, 60)


def order(n, batch_size, epoch=0, seed=0, shuffled_rows=False, budget=None):
    return batches_of_epoch(n, batch_size, epoch, seed=seed, shuffled_rows=shuffled_rows, budget=budget)


@given(sizes, st.integers(1, 8), st.integers(0, 5), st.integers(0, 5), st.booleans())
def test_every_row_at_most_once_and_all_full_batches(n, batch_size, epoch, seed, shuffled_rows):
    if n < batch_size:
        with pytest.raises(TrainingError, match="at least one batch"):
            order(n, batch_size)
        return
    batches = order(n, batch_size, epoch, seed, shuffled_rows)
    assert len(batches) == n // batch_size
    assert {len(rows) for rows in batches} == {batch_size}
    rows = list(chain.from_iterable(batches))
    assert len(set(rows)) == len(rows)
    assert set(rows) <= set(range(n))
    assert batches == order(n, batch_size, epoch, seed, shuffled_rows)


@given(st.integers(4, 60))
def test_as_published_a_batch_is_consecutive_rows(n):
    for rows in order(n, 4):
        assert rows == list(range(rows[0], rows[0] + 4))
        assert rows[0] % 4 == 0


@pytest.mark.parametrize("shuffled_rows", [False, True])
def test_epochs_and_seeds_have_their_own_order(shuffled_rows):
    first = order(100, 4, shuffled_rows=shuffled_rows)
    assert order(100, 4, epoch=1, shuffled_rows=shuffled_rows) != first
    assert order(100, 4, seed=1, shuffled_rows=shuffled_rows) != first


def test_shuffled_rows_mix_scenes():
    assert any(np.ptp(rows) > 3 for rows in order(100, 4, shuffled_rows=True))


@pytest.mark.parametrize("shuffled_rows", [False, True])
def test_a_budget_cuts_the_epoch_but_reaches_all_rows(shuffled_rows):
    seen = set()
    for epoch in range(60):
        batches = order(40, 4, epoch, shuffled_rows=shuffled_rows, budget=11)
        assert len(batches) == 2
        seen |= set(chain.from_iterable(batches))
    assert seen == set(range(40))
    assert len(order(40, 4, budget=1000)) == 10
    with pytest.raises(TrainingError, match="a budget of 3"):
        order(40, 4, budget=3)


class Recorder:
    fingerprint = "recorder"

    def __init__(self, fail_at=None):
        self.asked, self.fail_at = [], fail_at

    def __len__(self):
        return 1000

    def batch(self, rows, epoch):
        if self.fail_at in rows:
            raise OSError(f"row {self.fail_at} is damaged")
        self.asked.append(rows[0])
        return np.full(1, rows[0]), np.full(1, epoch)


def reader_threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("read_ahead")]


def test_batches_come_in_order_and_the_thread_ends():
    batches = [[number] for number in range(50)]
    received = [(int(inputs[0]), int(targets[0])) for inputs, targets in read_ahead(Recorder(), batches, epoch=3)]
    assert received == [(number, 3) for number in range(50)]
    assert not reader_threads()


def test_at_most_two_batches_are_read_ahead():
    data = Recorder()
    reader = read_ahead(data, [[number] for number in range(50)], epoch=0)
    for used in range(1, 10):
        next(reader)
        time.sleep(0.01)
        assert len(data.asked) <= used + 2
    reader.close()
    assert not reader_threads()


def test_errors_come_where_their_batch_is_due():
    reader = read_ahead(Recorder(fail_at=4), [[number] for number in range(50)], epoch=0)
    assert [int(next(reader)[0][0]) for _ in range(4)] == [0, 1, 2, 3]
    with pytest.raises(OSError, match="row 4 is damaged"):
        next(reader)
    assert not reader_threads()


def test_an_interrupt_ends_the_thread():
    reader = read_ahead(Recorder(), [[number] for number in range(50)], epoch=0)
    next(reader)
    with pytest.raises(KeyboardInterrupt):
        reader.throw(KeyboardInterrupt())
    assert not reader_threads()
