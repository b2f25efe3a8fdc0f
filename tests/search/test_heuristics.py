"""The images that candidates are scored on."""

import pytest

from ggcnn_net2net.search.heuristics import EvenRows


class Recorder:
    """A dataset that tells what it was asked for."""

    fingerprint = "abc"

    def __init__(self, number):
        self.number = number
        self.asked = []

    def __len__(self):
        return self.number

    def batch(self, rows, epoch):
        self.asked.append(("batch", rows, epoch))

    def depth(self, row):
        self.asked.append(("depth", row))

    def rectangles(self, row):
        self.asked.append(("rectangles", row))


def test_rows_are_spread_over_the_dataset_and_belong_together():
    data = Recorder(100)
    rows = EvenRows(data, 5)
    assert rows.rows.tolist() == [0, 25, 50, 74, 99]
    rows.depth(2)
    rows.rectangles(3)
    rows.batch([4, 0], 7)
    assert data.asked == [("depth", 50), ("rectangles", 74), ("batch", [99, 0], 7)]
    assert rows.fingerprint != EvenRows(data, 6).fingerprint


@pytest.mark.parametrize("number", [4, 9])
def test_no_more_rows_than_there_are(number):
    assert EvenRows(Recorder(4), number).rows.tolist() == [0, 1, 2, 3]
