"""The command `zoo`, on the networks that ship."""

import json

import pytest
from click.testing import CliRunner

from ggcnn_net2net import zoo
from ggcnn_net2net.cli.zoo import zoo_command
from ggcnn_net2net.errors import ModelFileError


def call(*arguments):
    result = CliRunner(env={"COLUMNS": "200"}).invoke(
        zoo_command, [str(part) for part in arguments], standalone_mode=False
    )
    if result.exception:
        raise result.exception
    return result.output


def test_list_shows_every_network_and_what_was_measured_of_it():
    rows = [line.split() for line in call("list").splitlines()]
    named = {row[0]: row[1:] for row in rows if row and row[0] in zoo.names()}
    assert set(named) == set(zoo.names())
    for name, row in named.items():
        facts = zoo.provenance(name)
        assert row[0] == f"{facts['parameters']:,}"
        sim = facts["sim"][0]
        assert row[1:3] == [sim["objects"], f"{sim['success']['successes']}/{sim['success']['trials']}"]


def test_show_prints_the_provenance():
    assert json.loads(call("show", "narrow")) == zoo.provenance("narrow")
    with pytest.raises(ModelFileError, match="nobody"):
        call("show", "nobody")


@pytest.mark.parametrize("content", ["[1]", '"text"', "{"])
def test_a_provenance_that_is_no_object_is_an_error_of_ours(content, tmp_path):
    (tmp_path / "mine.hdf5").write_bytes(b"")
    (tmp_path / "mine.json").write_text(content)
    with pytest.raises(ModelFileError, match=r"mine\.json"):
        call("add", tmp_path / "mine.hdf5", "mine")
