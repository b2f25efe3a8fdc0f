"""Which room imports which: as the table in docs/contributing.md says, and no other way."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "ggcnn_net2net"
PAGE = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8")


def names_in(text: str) -> set[str]:
    return {name.removesuffix(".py").rstrip("/") for name in re.findall(r"`([a-z0-9_./]+)`", text)}


def table() -> dict[str, tuple[set[str], set[str]]]:
    """Room -> what it imports at the top of its modules, and what inside of functions."""
    rooms = {}
    for room, knows in re.findall(r"^\| `([a-z0-9_./]+)` \|.*\| ([^|]+) \|$", PAGE, re.MULTILINE):
        at_the_top = names_in(re.sub(r"\(.*?\)", "", knows))
        rooms[room.removesuffix(".py").rstrip("/")] = at_the_top, at_the_top | names_in(knows)
    return rooms


def imports(module: Path) -> Iterator[tuple[str, bool]]:
    """Rooms that a module imports, and whether it does so when it is imported itself."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    top = {id(node) for node in tree.body}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ggcnn_net2net"):
            _, _, path = (node.module or "").partition(".")
            for room in [path.partition(".")[0]] if path else [alias.name for alias in node.names]:
                yield room, id(node) in top


ROOMS = table()
COMMON = names_in(re.search(r"needed\. (.*?) belong to all", PAGE, re.DOTALL)[1])


def test_the_table_has_all_rooms():
    there = {path.stem for path in PACKAGE.iterdir() if not path.name.startswith("_") and path.suffix in ("", ".py")}
    assert there - COMMON == set(ROOMS)


@pytest.mark.parametrize("room", [room for room in ROOMS if room != "cli"])
def test_a_room_imports_what_the_table_says(room):
    modules = sorted((PACKAGE / room).rglob("*.py")) or [PACKAGE / f"{room}.py"]
    at_the_top, inside = ROOMS[room]
    wrong = [
        f"{module.relative_to(PACKAGE)} imports {other}{'' if first else ' inside'}"
        for module in modules
        for other, first in imports(module)
        if module.name != "__main__.py" and other not in {room, "_version", *COMMON, *(at_the_top if first else inside)}
    ]
    assert wrong == []
