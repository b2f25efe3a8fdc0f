import pickle
from dataclasses import asdict, fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.errors import GripperError
from ggcnn_net2net.simulation import PAPER_GRIPPER, GripperSpec, load_gripper

SMALL = """
palm = [0.10, 0.02, 0.01]
max_opening = 0.08
finger_length = 0.04
link_mass = 1  # a whole number
"""


@pytest.fixture
def toml(tmp_path):
    def write(text):
        path = tmp_path / "gripper.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_file_replaces_what_it_names(toml):
    expected = replace(PAPER_GRIPPER, palm=(0.1, 0.02, 0.01), max_opening=0.08, finger_length=0.04)
    assert load_gripper(toml(SMALL)) == expected
    assert expected.reach == pytest.approx(0.045)


def test_an_empty_file_is_the_papers_gripper(toml):
    assert load_gripper(toml("# all as in the paper\n")) == PAPER_GRIPPER


def test_every_field_can_be_set(toml):
    values = {name: value for name, value in asdict(PAPER_GRIPPER).items() if name != "palm"}
    text = "".join(f"{name} = {value * 1.1}\n" for name, value in values.items())
    found = load_gripper(toml(text + "palm = [0.4, 0.03, 0.02]\n"))
    assert [field.name for field in fields(GripperSpec) if getattr(found, field.name) == field.default] == []


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("max_opning = 0.08", "expected a gripper's palm, .*received max_opning"),
        ("[gripper]\nmax_opening = 0.08", "received gripper"),
        ('max_opening = "8 cm"', "expected a positive number for a gripper's max_opening, received '8 cm'"),
        ("max_opening = true", "received True"),
        ("max_opening = [0.08]", r"received \(0.08,\)"),
        ("max_opening = 0", "received 0"),
        ("friction = -0.5", "received -0.5"),
        ("force = inf", "received inf"),
        ("jaw_force = nan", "received nan"),
        ("palm = 0.1", "expected three positive numbers for a gripper's palm, received 0.1"),
        ("palm = [0.1, 0.02]", "expected three positive numbers"),
        ("palm = [0.1, 0.02, 0]", "expected three positive numbers"),
        ("finger_width = 20", "finger_width in metres, at most 1, received 20"),
        ("max_opening = 0.4", "jaw_speed of 0.333 or more.*jaws 0.6 s.*received 0.3"),
        ("jaw_speed = 0.2", "jaw_speed of 0.25 or more"),
        ("linear_speed = 0.3", "linear_speed of 0.375 or more"),
        ("angular_speed = 0.3", "angular_speed of 0.393 or more"),
        ("finger_length = 0.6", "reaches at most 0.5 m"),
        ("max_opening 0.08", "cannot read"),
    ],
)
def test_what_cannot_be_used_is_told_with_the_file(toml, text, told):
    with pytest.raises(GripperError, match=told) as caught:
        load_gripper(toml(text))
    assert "gripper.toml" in str(caught.value)


def test_a_file_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(GripperError, match=r"cannot read .*nowhere\.toml"):
        load_gripper(tmp_path / "nowhere.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(GripperError, match="cannot read"):
        load_gripper(tmp_path / "binary.toml")


sizes = st.floats(1e-3, 0.3)


@given(palm=st.tuples(sizes, sizes, sizes), opening=sizes, length=sizes, friction=st.floats(1e-3, 10))
def test_settings_tell_the_gripper(palm, opening, length, friction):
    gripper = GripperSpec(palm=palm, max_opening=opening, finger_length=length, friction=friction)
    assert GripperSpec.from_dict(gripper.as_setting()["gripper"]) == gripper
    assert pickle.loads(pickle.dumps(gripper)) == gripper


def test_the_papers_gripper_leaves_settings_as_they_are():
    assert PAPER_GRIPPER.as_setting() == {}
    assert GripperSpec.from_dict({}) == PAPER_GRIPPER


def test_the_papers_gripper():
    assert asdict(PAPER_GRIPPER) == {
        "palm": (0.32, 0.02, 0.01),
        "finger_length": 0.05,
        "finger_thickness": 0.01,
        "finger_width": 0.02,
        "max_opening": 0.30,
        "link_mass": 1.0,
        "friction": 1.0,
        "force": 1000.0,
        "jaw_force": 1000.0,
        "linear_speed": 0.5,
        "angular_speed": 2.0,
        "jaw_speed": 0.3,
        "position_gain": 0.3,
        "velocity_gain": 1.0,
    }
