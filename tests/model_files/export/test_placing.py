"""Files and folders that go into place together, or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from ggcnn_net2net.model_files.export.placing import placing


def content_of(folder: Path) -> dict[str, str]:
    return {str(file.relative_to(folder)): file.read_text() for file in folder.rglob("*") if file.is_file()}


def fill(folder: Path, text: str) -> None:
    """A file, a folder with a sub-folder, and the file that vouches for them."""
    (folder / "net").mkdir()
    (folder / "net" / "variables").mkdir()
    for name in ("net.bin", "net/saved_model.pb", "net/variables/data", "net.json"):
        (folder / name).write_text(text)


@pytest.fixture
def old(tmp_path):
    """A folder with an old export and something else."""
    fill(tmp_path, "old")
    (tmp_path / "net" / "left over").write_text("old")
    (tmp_path / "other").write_text("other")
    return tmp_path


def test_everything_is_replaced(old):
    with placing(old, "net.json") as folder:
        fill(folder, "new")
    expected = dict.fromkeys(("net.bin", "net/saved_model.pb", "net/variables/data", "net.json"), "new")
    assert content_of(old) == {**expected, "other": "other"}


def test_an_error_in_the_block_changes_nothing(old):
    before = content_of(old)
    with pytest.raises(KeyboardInterrupt), placing(old, "net.json") as folder:
        fill(folder, "new")
        raise KeyboardInterrupt
    assert content_of(old) == before


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize("failing", range(6))
def test_a_move_that_fails_is_undone(failing, there, old, tmp_path, monkeypatch):
    """Whichever rename fails, old content is back, and what was not there is not there."""
    target = old if there else tmp_path / "empty"
    target.mkdir(exist_ok=True)
    before = content_of(target)
    calls = []
    for method in ("rename", "replace"):
        original = getattr(Path, method)

        def move(self, other, original=original):
            calls.append(self)
            if len(calls) - 1 == failing:
                raise OSError("disk full")
            return original(self, other)

        monkeypatch.setattr(Path, method, move)
    moves = 4 if there else 3  # three go in, one folder goes out of the way
    if failing < moves:
        with pytest.raises(OSError, match="disk full"), placing(target, "net.json") as folder:
            fill(folder, "new")
        assert content_of(target) == before
    else:
        with placing(target, "net.json") as folder:
            fill(folder, "new")
        assert content_of(target)["net.json"] == "new"
    assert [path for path in target.iterdir() if path.name.startswith(".")] == []


def test_the_last_file_moves_last(tmp_path, monkeypatch):
    moved, replace = [], Path.replace
    monkeypatch.setattr(Path, "replace", lambda self, other: (moved.append(self.name), replace(self, other))[1])
    with placing(tmp_path / "new folder", "a.json") as folder:
        for name in ("b.bin", "a.json", "c.xml"):
            (folder / name).write_text("x")
    assert moved == ["b.bin", "c.xml", "a.json"]
