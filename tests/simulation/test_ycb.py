"""The download of ycb40, from a server on this machine that serves boxes in place of the real meshes."""

import http.server
import threading
from functools import partial

import numpy as np
import pytest

from ggcnn_net2net.errors import VerificationError
from ggcnn_net2net.simulation import ycb
from ggcnn_net2net.simulation.convex import box, write_obj
from ggcnn_net2net.simulation.object_sets import load_object_set


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture
def server(tmp_path, monkeypatch):
    folder = tmp_path / "served"
    folder.mkdir()
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=folder)) as httpd:
        threading.Thread(target=httpd.serve_forever, daemon=True).start()
        monkeypatch.setattr(ycb, "YCB_URL", f"http://127.0.0.1:{httpd.server_port}/{{name}}.obj")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        monkeypatch.delenv("GGCNN_NET2NET_DATA", raising=False)
        yield folder
        httpd.shutdown()


def serve(folder, record, stretch=1.0):
    """Serve boxes, away from the origin as in the source, with the recorded number of parts and sides."""
    sides = np.array([float(record[axis]) for axis in "xyz"]) * stretch
    write_obj(folder / f"{record['name']}.obj", [box(sides, (0.3, -0.2, 0.1))] * int(record["parts"]))


def test_download_verifies_and_completes(server, tmp_path):
    for record in ycb._records():
        serve(server, record)
    objects = load_object_set("ycb40").objects
    assert len(objects) == 40
    assert tmp_path / "cache" in objects[0].mesh.parents
    for file in server.iterdir():
        file.unlink()
    assert len(load_object_set("ycb40").objects) == 40  # from the cache


def test_a_wrong_mesh_is_an_error_and_is_not_kept(server, tmp_path):
    records = ycb._records()
    for record in records:
        serve(server, record, stretch=1.02 if record is records[3] else 1.0)
    with pytest.raises(VerificationError, match=records[3]["name"]):
        load_object_set("ycb40")
    kept = {file.name for file in (tmp_path / "cache").rglob("*.obj")}
    assert kept == {f"{record['name']}_vhacd.obj" for record in records[:3]}
    assert not list((tmp_path / "cache").rglob("objects.csv"))
    serve(server, records[3])
    assert len(load_object_set("ycb40").objects) == 40  # goes on where it stopped


def test_records_are_those_of_the_reference_data(data_root):
    for record in ycb._records():
        ycb._verify(data_root / "objects" / "ycb40" / f"{record['name']}_vhacd.obj", record)
