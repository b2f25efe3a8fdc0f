"""Operations as text: `deeper(3)`, `wider(conv2d_3, filters=24)`, and sequences of them."""

from __future__ import annotations

import operator
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ggcnn_net2net.errors import SurgeryError

_OPERATION = re.compile(r"\s*(?P<name>\w+)\s*\((?P<arguments>[^()]*)\)\s*")
_LAYER = re.compile(r"[^\s,()=]([^,()=]*[^\s,()=])?\Z")
_KERNEL_SIZE = re.compile(r"([1-9]\d*)(?:x([1-9]\d*))?\Z")
_OPTIONS = {"deeper": ("kernel_size",), "wider": ("factor", "filters")}
_SYNTAX = "deeper(3), deeper(3, kernel_size=5), wider(conv2d_3), wider(3, factor=1.5) or wider(3, filters=24)"


@dataclass(frozen=True)
class Operation:
    """*deeper* or *wider* of one layer. `str()` gives the text that `parse` reads."""

    name: str
    """"deeper" or "wider"."""

    layer: int | str
    """The paper's index of the layer (1-based), or the layer's name."""

    kernel_size: tuple[int, int] | None = None
    """*deeper*: kernel size of the new layer; None for that of the layer before."""

    factor: float = 2.0
    """*wider*: new number of filters relative to the present one."""

    filters: int | None = None
    """*wider*: new number of filters; None to go by `factor`."""

    def __post_init__(self) -> None:
        if hasattr(self.layer, "__index__"):  # of NumPy, too
            object.__setattr__(self, "layer", operator.index(self.layer))
        if self.name not in _OPTIONS:
            raise SurgeryError(f"expected an operation 'deeper' or 'wider', received {self.name!r}")
        if not (self.layer >= 1 if isinstance(self.layer, int) else _LAYER.match(self.layer)):
            raise SurgeryError(f"expected a layer index of 1 or more, or a layer name, received {self.layer!r}")

    @classmethod
    def parse(cls, text: str) -> Operation:
        """Read one operation.

        Args:
            text: for example `deeper(3)`, `deeper(conv2d_3, kernel_size=5)`, `deeper(3, kernel_size=3x5)`,
                `wider(3)`, `wider(3, factor=1.5)`, `wider(3, filters=24)`.

        Returns:
            The operation; `str()` of it gives the text back.

        Raises:
            SurgeryError: the text is no such operation.
        """
        operations = parse_operations(text)
        if len(operations) != 1:
            raise SurgeryError(f"expected one operation, received {len(operations)} in {text!r}")
        return operations[0]

    def __str__(self) -> str:
        arguments = [str(self.layer)]
        if self.kernel_size is not None:
            arguments.append("kernel_size=" + "x".join(map(str, dict.fromkeys(self.kernel_size))))
        if self.filters is not None:
            arguments.append(f"filters={self.filters}")
        elif self.factor != 2:
            arguments.append(f"factor={self.factor}")
        return f"{self.name}({', '.join(arguments)})"


def parse_operations(text: str) -> list[Operation]:
    """Read a comma-separated sequence of operations, `deeper(3), deeper(4), wider(3), deeper(3)`.

    Args:
        text: operations as `Operation.parse` reads them; an empty text is none.

    Returns:
        The operations in order.

    Raises:
        SurgeryError: the text is no such sequence.
    """
    return list(_parsed(text)) if text.strip() else []


def _parsed(text: str) -> Iterator[Operation]:
    position = 0
    while True:
        match = _OPERATION.match(text, position)
        if match is None:
            raise SurgeryError(f"expected {_SYNTAX}, received {text[position:]!r} in {text!r}")
        yield _operation(match["name"], match["arguments"], match[0].strip())
        position = match.end()
        if position == len(text):
            return
        if text[position] != ",":
            raise SurgeryError(f"expected ',' between operations, received {text[position:]!r} in {text!r}")
        position += 1


def _operation(name: str, arguments: str, text: str) -> Operation:
    layer, *options = (argument.strip() for argument in arguments.split(","))
    values: dict[str, Any] = {}
    for option in options:
        key, equals, value = (part.strip() for part in option.partition("="))
        if not equals or key not in _OPTIONS.get(name, ()) or values:
            raise SurgeryError(f"expected {_SYNTAX}, received {text!r}")
        values[key] = _value(key, value, text)
    return Operation(name, int(layer) if layer.isdecimal() else layer, **values)


def _value(key: str, value: str, text: str) -> Any:
    try:
        if key == "kernel_size":
            match = _KERNEL_SIZE.match(value)
            if match is None:
                raise ValueError("expected a size like 5 or 3x5")
            return int(match[1]), int(match[2] or match[1])
        return float(value) if key == "factor" else int(value)
    except ValueError as error:
        raise SurgeryError(f"expected a number for {key} in {text!r}, received {value!r}: {error}") from error
