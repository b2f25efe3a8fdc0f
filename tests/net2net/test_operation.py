"""Operations as text."""

from __future__ import annotations

import numpy as np
import pytest

from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net import EXTENDED_OPERATIONS, Operation, parse_operations


@pytest.mark.parametrize(
    ("text", "operation"),
    [
        ("deeper(3)", Operation("deeper", 3)),
        ("deeper(3, kernel_size=5)", Operation("deeper", 3, kernel_size=(5, 5))),
        ("deeper(conv2d_3, kernel_size=3x5)", Operation("deeper", "conv2d_3", kernel_size=(3, 5))),
        ("wider(3)", Operation("wider", 3)),
        ("wider(3, factor=1.5)", Operation("wider", 3, factor=1.5)),
        ("wider(conv2d_3, filters=24)", Operation("wider", "conv2d_3", filters=24)),
    ],
)
def test_text_and_operation_are_the_same(text: str, operation: Operation) -> None:
    assert Operation.parse(text) == operation
    assert str(operation) == text
    assert Operation.parse(f"  {text.replace(', ', ' ,  ')} ") == operation


def test_a_factor_of_many_digits_survives() -> None:
    operation = Operation("wider", 2, factor=4 / 3)
    assert Operation.parse(str(operation)) == operation


def test_a_sequence_keeps_its_order() -> None:
    assert parse_operations(EXTENDED_OPERATIONS) == [
        Operation("deeper", 3),
        Operation("deeper", 4),
        Operation("wider", 3),
        Operation("deeper", 3),
    ]
    assert parse_operations("wider(1,filters=3),deeper(b)") == [
        Operation("wider", 1, filters=3),
        Operation("deeper", "b"),
    ]
    assert parse_operations(" ") == []


@pytest.mark.parametrize(
    "text",
    [
        "deeper",
        "deeper(",
        "deeper()",
        "deeper(3",
        "deeper(3))",
        "deeper(3) wider(3)",
        "deeper(3),",
        "deeper(3),,wider(3)",
        "deeper(0)",
        "deeper(-1)x",
        "thicker(3)",
        "deeper(3, factor=2)",
        "deeper(3, 5)",
        "deeper(3, kernel_size=0)",
        "deeper(3, kernel_size=3x)",
        "wider(3, kernel_size=3)",
        "wider(3, factor=two)",
        "wider(3, filters=2.5)",
        "wider(3, factor=2, filters=8)",
        "wider(3, filters=8, filters=9)",
        "__import__('os').system('true')",
    ],
)
def test_anything_else_is_an_error_that_shows_it(text: str) -> None:
    with pytest.raises(SurgeryError, match="received"):
        parse_operations(text)


def test_parse_reads_exactly_one() -> None:
    with pytest.raises(SurgeryError, match="expected one operation, received 2"):
        Operation.parse("deeper(1), deeper(2)")


def test_indices_of_numpy_are_indices() -> None:
    assert str(Operation("wider", np.int64(3))) == "wider(3)"
    assert Operation("wider", np.int64(3)) == Operation("wider", 3)
