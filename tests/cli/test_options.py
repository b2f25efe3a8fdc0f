"""Options that several commands share."""

import os
import sys
from pathlib import Path

import click
import pytest

from ggcnn_net2net.cli.options import OutputFile, OutputFolder, Picture, command_line


def test_a_file_may_lie_in_a_folder_that_is_made_later(tmp_path):
    path = tmp_path / "new" / "newer" / "rates.json"
    assert OutputFile().convert(str(path), None, None) == path
    assert not path.parent.exists()


def test_a_file_in_the_working_folder_needs_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert OutputFile().convert("rates.json", None, None) == Path("rates.json")


@pytest.mark.parametrize("name", ["", "."])
def test_a_file_has_a_name_and_a_folder_may_be_this_one(name):
    with pytest.raises(click.BadParameter):
        OutputFile().convert(name, None, None)
    assert OutputFolder().convert(".", None, None) == Path()


@pytest.mark.parametrize("name", ["rates.json", "new/rates.json"])
def test_a_file_below_a_file_is_refused_before_the_work(tmp_path, name):
    (tmp_path / "taken").write_text("")
    with pytest.raises(click.BadParameter, match=r"expected a folder to write rates.json to, .*taken is a file"):
        OutputFile().convert(str(tmp_path / "taken" / name), None, None)


def test_a_folder_without_permission_is_refused_before_the_work(tmp_path, monkeypatch):
    # The superuser, who may run the tests, may write anywhere.
    monkeypatch.setattr(os, "access", lambda path, mode: (Path(path), mode) != (tmp_path, os.W_OK))
    with pytest.raises(click.BadParameter, match="may not be written to"):
        OutputFile().convert(str(tmp_path / "new" / "rates.json"), None, None)


@pytest.mark.parametrize("name", ["sheet", "sheet.txt"])
def test_a_picture_has_the_suffix_of_one(tmp_path, name):
    with pytest.raises(click.BadParameter, match=r"expected a picture, \.png, .*received sheet"):
        Picture().convert(str(tmp_path / name), None, None)


def test_a_picture_may_have_its_suffix_in_capitals(tmp_path):
    assert Picture().convert(str(tmp_path / "SHEET.PNG"), None, None) == tmp_path / "SHEET.PNG"


@pytest.mark.parametrize(
    ("program", "shown"),
    [
        ("/usr/bin/ggcnn-net2net", "ggcnn-net2net"),
        ("/site/ggcnn_net2net/__main__.py", "python -m ggcnn_net2net"),
        ("/site/ggcnn_net2net/reproduce/__main__.py", "python -m ggcnn_net2net.reproduce"),
    ],
)
def test_the_recorded_command_can_be_run_again(program, shown, monkeypatch):
    monkeypatch.setattr(sys, "argv", [program, "table1", "-o", "my results"])
    assert command_line() == f"{shown} table1 -o 'my results'"
