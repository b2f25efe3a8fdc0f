import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.datasets.splits import Split, make_split, read_split, write_split
from ggcnn_net2net.errors import DatasetError

OBJECTS = {f"pcd{index:04d}": f"object{index // 4}" for index in range(40)}


@given(
    st.dictionaries(st.text("abc", min_size=1), st.sampled_from("xyz"), min_size=2),
    st.sampled_from(["image", "object"]),
    st.floats(0.01, 0.99),
    st.integers(0, 99),
)
def test_every_scene_is_on_one_side(objects, by, fraction, seed):
    if by == "object" and len(set(objects.values())) < 2:
        return
    split = make_split(objects, by, fraction, seed)
    assert sorted(split.train + split.test) == sorted(objects)
    assert split.train
    assert split.test
    assert make_split(dict(reversed(objects.items())), by, fraction, seed) == split
    if by == "object":
        assert not {objects[name] for name in split.train} & {objects[name] for name in split.test}


def test_fraction_and_seed():
    assert len(make_split(OBJECTS, "image", 0.2, 0).test) == 8
    split = make_split(OBJECTS, "object", 0.2, 0)
    assert len({OBJECTS[name] for name in split.test}) == 2
    assert make_split(OBJECTS, "image", 0.2, 1) != make_split(OBJECTS, "image", 0.2, 0)


def test_the_draw_never_changes():
    """A golden value: files that name only a seed must keep their meaning."""
    assert make_split(OBJECTS, "image", 0.2, 0).sha256[:16] == "ce414aec62e23ed0"


def test_file_round_trip(tmp_path):
    split = make_split(OBJECTS, "object", 0.25, 7)
    write_split(tmp_path / "split.json", split)
    assert read_split(tmp_path / "split.json") == split


def test_files_made_by_hand(tmp_path):
    path = tmp_path / "split.json"
    path.write_text(json.dumps({"train": ["b", "a"], "test": ["c"]}))
    split = read_split(path)
    assert split.by == "unknown"
    assert split.sha256 == Split(("a", "b"), ("c",), "image", 3).sha256


def test_damaged_files_are_refused(tmp_path):
    path = tmp_path / "split.json"
    more, numbers = '{"train": ["a"], "test": ["b"], "more": 1}', '{"train": [100, "a"], "test": [102]}'
    for text in ("", "[]", "{}", '{"train": ["a"]}', more, numbers):
        path.write_text(text)
        with pytest.raises(DatasetError, match="split file"):
            read_split(path)
    with pytest.raises(DatasetError, match="split file"):
        read_split(tmp_path / "none.json")
    write_split(path, make_split(OBJECTS, "image", 0.2, 0))
    path.write_text(path.read_text().replace("pcd0003", "pcd9999"))
    with pytest.raises(DatasetError, match="was changed"):
        read_split(path)


def test_sides_of_a_dataset():
    split = Split(("a", "b"), ("c",))
    assert split.side_of(["c", "a", "b"]) == {"c": "test", "a": "train", "b": "train"}
    with pytest.raises(DatasetError, match=r"1 are not in it \(d\).*1 of it are not in the dataset \(b\)"):
        split.side_of(["a", "c", "d"])


@pytest.mark.parametrize(("train", "test"), [(("a",), ("a",)), (("a", "a"), ("b",)), ((), ("a",)), (("a",), ())])
def test_impossible_splits(train, test):
    with pytest.raises(DatasetError, match="one side"):
        Split(train, test)


@pytest.mark.parametrize(
    ("objects", "by", "fraction"),
    [(OBJECTS, "colour", 0.2), (OBJECTS, "image", 0), (OBJECTS, "image", 1), ({"a": "x", "b": "x"}, "object", 0.5)],
)
def test_impossible_draws(objects, by, fraction):
    with pytest.raises(DatasetError, match="expected"):
        make_split(objects, by, fraction, 0)
