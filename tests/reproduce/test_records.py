"""The rows of grasps.csv."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.reproduce.records import COLUMNS, GraspRecord, RecordFile

# More than an object may be called, but not what breaks lines; surrogates cannot be written as UTF-8.
names = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0\r\n"), min_size=1)
numbers = st.none() | st.floats(allow_nan=False)
records = st.builds(
    GraspRecord,
    **dict.fromkeys(("model", "weights", "object", "category", "outcome"), names),
    **dict.fromkeys(("pose", "steps"), st.integers(0, 10**6)),
    **dict.fromkeys(("success", "in_bin"), st.booleans()),
    distance=st.floats(allow_nan=False),
    **dict.fromkeys(("row", "col", "angle", "width_px", "quality", "x", "y", "z", "opening"), numbers),
)


@settings(deadline=None)
@given(st.lists(records, min_size=1, max_size=4), st.data())
def test_what_is_appended_is_read_and_only_a_torn_record_is_lost(written, data):
    with TemporaryDirectory() as folder:
        file = RecordFile(Path(folder) / "grasps.csv")
        file.rewrite(written[:-1])
        whole = file.path.stat().st_size
        file.append(written[-1])
        assert file.read() == written
        content = file.path.read_bytes()
        file.path.write_bytes(content[: data.draw(st.integers(whole, len(content) - 1))])
        assert file.read() == written[:-1]


def test_records_in_another_encoding(tmp_path):
    (tmp_path / "grasps.csv").write_bytes((",".join(COLUMNS) + "\nStück\n").encode("cp1252"))
    with pytest.raises(ResultsError, match=r"grasps\.csv: UnicodeDecodeError"):
        RecordFile(tmp_path / "grasps.csv").read()
