import inspect
import subprocess
import sys
import warnings
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from ggcnn_net2net import errors, reference_data, zoo
from ggcnn_net2net.cli.main import COMMANDS, GREETING, INTERRUPTED, cli, run
from ggcnn_net2net.errors import GGCNNError, SurgeryError
from ggcnn_net2net.model_files import published


def call(*arguments):
    return subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    "arguments",
    [("ggcnn_net2net", "--help"), ("ggcnn_net2net.reproduce", "--help"), ("ggcnn_net2net.reproduce", "table1", "-h")],
)
def test_modules_are_commands(arguments):
    done = call(*arguments)
    assert done.returncode == 0
    assert "Usage" in done.stdout


def test_help_imports_nothing_heavy():
    """So it answers at once."""
    code = (
        "import importlib, sys; from ggcnn_net2net.cli.main import COMMANDS; "
        "[importlib.import_module(f'ggcnn_net2net.cli.{module}') for module, _, _ in COMMANDS.values()]; "
        "print(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "ggcnn_net2net.cli.export" in loaded
    assert not {"keras", "tensorflow", "h5py", "numpy", "matplotlib", "pybullet", "rich"} & set(loaded)


def test_without_arguments_it_greets():
    done = call("ggcnn_net2net")
    assert done.returncode == 0
    assert "reproduce table1" in done.stdout
    named = {line.split()[1] for line in GREETING.splitlines() if line.startswith("  ggcnn-net2net ")}
    assert named <= set(COMMANDS)
    assert (Path(__file__).parents[2] / "docs" / "tutorial.md").is_file()


def commands_of(command, context):
    """Contexts of a command and of all commands below it."""
    yield context
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            yield from commands_of(below, click.Context(below, info_name=name, parent=context))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example(name):
    context = click.Context(cli, info_name="ggcnn-net2net")
    command = cli.get_command(context, name)
    helps = {
        below.command_path: below.get_help()
        for below in commands_of(command, click.Context(command, info_name=name, parent=context))
    }
    assert helps
    assert [path for path, text in helps.items() if "Example" not in text] == []


@pytest.mark.parametrize("kind", [kind for kind in vars(errors).values() if inspect.isclass(kind)])
def test_errors_point_to_a_page_that_exists(kind):
    assert kind is GGCNNError or (Path(__file__).parents[2] / kind.page).is_file()


@pytest.mark.parametrize(
    "arguments",
    [
        "grow x.hdf5 --ops deeper(1) -o y.hdf5 --draw z.foo",
        "objects procedural40 --sheet z.foo",
        "dataset preview x.h5 -o z.foo",
        "evaluate failures tests -o z.foo",
        "evaluate grasp published --picture z",
        "reproduce fig1 -o z.hdf5",
    ],
)
def test_a_picture_needs_the_suffix_of_one(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tests").mkdir()
    result = CliRunner().invoke(cli, arguments.split())
    assert result.exit_code == 2
    assert "expected a picture, .png, .pdf, .svg, .jpg; received z" in " ".join(result.output.split())


def exit_code(command, arguments, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["ggcnn-net2net", *arguments])
    with pytest.raises(SystemExit) as caught:
        run(command, "ggcnn-net2net")
    return caught.value.code


def test_exit_codes(monkeypatch, capsys):
    def failing(error):
        @click.command()
        def command():
            raise error

        return command

    assert exit_code(failing(GGCNNError("no such thing")), [], monkeypatch) == 1
    assert capsys.readouterr().err == "Error: no such thing\n"
    assert exit_code(failing(SurgeryError("no such layer")), [], monkeypatch) == 1
    assert capsys.readouterr().err == "Error: no such layer\nMore about this: docs/net2net.md\n"
    assert exit_code(failing(KeyboardInterrupt()), [], monkeypatch) == INTERRUPTED == 130
    assert exit_code(cli, ["nonsense"], monkeypatch) == 2
    assert "nonsense" in capsys.readouterr().err
    assert exit_code(cli, ["--version"], monkeypatch) == 0
    with pytest.raises(ZeroDivisionError):  # a bug of ours is not dressed up
        exit_code(failing(ZeroDivisionError()), [], monkeypatch)


def test_without_weights_and_network_it_says_what_to_do(monkeypatch, capsys, tmp_path):
    monkeypatch.delenv("GGCNN_NET2NET_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(reference_data, "checkout_root", lambda: tmp_path / "checkout")
    monkeypatch.setattr(published, "PUBLISHED_URL", "http://127.0.0.1:9/epoch_29_model.hdf5")
    monkeypatch.setattr(zoo.files, "FOLDER", tmp_path / "zoo")  # nothing stands in
    assert exit_code(cli, ["reproduce", "table1", "--output", str(tmp_path / "out")], monkeypatch) == 1
    message = capsys.readouterr().err
    for part in ("epoch_29_model.hdf5", "07ed61da", str(tmp_path / "cache"), str(tmp_path / "checkout"), "curl"):
        assert part in message
    assert not (tmp_path / "out").exists()


def test_our_warnings_are_one_line_without_source(monkeypatch, capsys):
    @click.command()
    def command():
        warnings.warn("another network stands in", zoo.StandInWarning, stacklevel=1)

    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)
    assert exit_code(command, [], monkeypatch) == 0
    assert capsys.readouterr().err == "Warning: another network stands in\n"


def test_what_the_system_refuses_is_no_traceback(monkeypatch, capsys, tmp_path):
    @click.command()
    def command():
        (tmp_path / "missing" / "file").write_text("")

    assert exit_code(command, [], monkeypatch) == 1
    assert capsys.readouterr().err == f"Error: No such file or directory: {tmp_path / 'missing' / 'file'}\n"
