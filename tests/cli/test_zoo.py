"""The command `zoo`, on the networks that ship."""

import json
import re

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
    shown = call("list")
    assert [line.split()[0] for line in shown.splitlines() if line.split()[:1] and line.split()[0] in zoo.names()] == [
        *zoo.names()
    ]
    for name in zoo.names():
        facts = zoo.provenance(name)
        assert f"{facts['parameters']:,} parameters" in shown
        for one in facts["sim"]:
            rate = one["success"]
            line = f"SIM {one['objects']}\\s+{one['protocol']}\\s+{rate['successes']}/{rate['trials']} ="
            assert re.search(line, shown)
        for one in facts["iou"]:
            line = f"IoU {one['dataset']['file']}\\s+{one['protocol']}\\s+{one['successes']}/{one['images']} ="
            assert re.search(line, shown)


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
