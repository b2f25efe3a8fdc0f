"""Finding, verifying and downloading reference data; every server here is on 127.0.0.1."""

from __future__ import annotations

import hashlib
import re
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from ggcnn_net2net import reference_data
from ggcnn_net2net.errors import DataNotFoundError, VerificationError
from ggcnn_net2net.model_files import published

CONTENT = bytes(range(256)) * 1024
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@dataclass
class FileServer:
    """Serves CONTENT at every path but /missing; can cut a transfer short and ignore ranges."""

    url: str = ""
    cut_after: int | None = None
    ranges: bool = True
    requested: list[str | None] = field(default_factory=list)


@pytest.fixture
def server() -> Iterator[FileServer]:
    settings = FileServer()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            wanted = self.headers.get("Range")
            settings.requested.append(wanted)
            if self.path == "/missing":
                self.send_error(404)
                return
            start = int(re.fullmatch(r"bytes=(\d+)-", wanted)[1]) if wanted and settings.ranges else 0
            if start >= len(CONTENT):
                self.send_error(416)
                return
            self.send_response(206 if wanted and settings.ranges else 200)
            self.send_header("Content-Length", str(len(CONTENT) - start))
            self.end_headers()
            stop = len(CONTENT) if settings.cut_after is None else start + settings.cut_after
            self.wfile.write(CONTENT[start:stop])

        def log_message(self, *_) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as httpd:
        settings.url = f"http://127.0.0.1:{httpd.server_port}/weights.bin"
        thread = threading.Thread(target=httpd.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield settings
        httpd.shutdown()
        thread.join()


@pytest.fixture
def target(tmp_path) -> Path:
    return tmp_path / "cache" / "weights.bin"


def files_below(folder: Path) -> list[str]:
    """All but the lock of a download, which stays."""
    return sorted(path.name for path in folder.rglob("*") if path.is_file() and path.suffix != ".lock")


def closed_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class TestDataRoot:
    def test_not_set(self, monkeypatch):
        monkeypatch.delenv("GGCNN_NET2NET_DATA", raising=False)
        assert reference_data.data_root() is None
        monkeypatch.setenv("GGCNN_NET2NET_DATA", "")
        assert reference_data.data_root() is None

    def test_folder(self, monkeypatch, tmp_path):
        monkeypatch.setenv("GGCNN_NET2NET_DATA", str(tmp_path))
        assert reference_data.data_root() == tmp_path

    def test_home_folder(self, monkeypatch, tmp_path):
        (tmp_path / "data").mkdir()
        monkeypatch.setenv("HOME", str(tmp_path))
        monkeypatch.setenv("GGCNN_NET2NET_DATA", "~/data")
        assert reference_data.data_root() == tmp_path / "data"

    @pytest.mark.parametrize("kind", ["absent", "file"])
    def test_no_folder(self, kind, monkeypatch, tmp_path):
        path = tmp_path / kind
        if kind == "file":
            path.write_text("x")
        monkeypatch.setenv("GGCNN_NET2NET_DATA", str(path))
        with pytest.raises(DataNotFoundError, match="GGCNN_NET2NET_DATA") as caught:
            reference_data.data_root()
        assert str(path) in str(caught.value)


def test_cache_root_follows_xdg(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert reference_data.cache_root() == tmp_path / "ggcnn_net2net"
    assert not reference_data.cache_root().exists()


def test_verify(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(CONTENT)
    assert reference_data.verify(path, SHA256) == path
    with pytest.raises(VerificationError) as caught:
        reference_data.verify(path, "0" * 64)
    for part in (str(path), "0" * 64, SHA256, f"{len(CONTENT)} bytes"):
        assert part in str(caught.value)


class TestDownload:
    def test_whole(self, server, target):
        assert reference_data.download(server.url, target, SHA256) == target
        assert target.read_bytes() == CONTENT
        assert files_below(target.parent) == ["weights.bin"]
        assert server.requested == [None]

    def test_two_at_a_time_do_not_mix(self, server, target, monkeypatch):
        both_ask, lock = threading.Barrier(2), reference_data.FileLock

        def lock_when_both_ask(path):
            both_ask.wait()
            return lock(path)

        monkeypatch.setattr(reference_data, "FileLock", lock_when_both_ask)
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda _: reference_data.download(server.url, target, SHA256), range(2)))
        assert target.read_bytes() == CONTENT
        assert server.requested == [None]

    def test_what_is_there_is_replaced(self, server, target):
        target.parent.mkdir()
        target.write_bytes(b"old")
        reference_data.download(server.url, target, SHA256)
        assert target.read_bytes() == CONTENT

    def test_without_a_known_hash(self, server, target):
        reference_data.download(server.url, target)
        assert target.read_bytes() == CONTENT

    def test_resumes_after_a_cut(self, server, target):
        server.cut_after = 100_000
        with pytest.raises(DataNotFoundError, match=re.escape(server.url)):
            reference_data.download(server.url, target, SHA256)
        assert files_below(target.parent) == ["weights.bin.part"]
        server.cut_after = None
        reference_data.download(server.url, target, SHA256)
        assert target.read_bytes() == CONTENT
        first, second = server.requested
        assert first is None
        assert 0 < int(second.removeprefix("bytes=").removesuffix("-")) <= 100_000
        assert files_below(target.parent) == ["weights.bin"]

    def test_server_without_ranges_starts_over(self, server, target):
        target.parent.mkdir(parents=True)
        target.with_name("weights.bin.part").write_bytes(b"old bytes")
        server.ranges = False
        reference_data.download(server.url, target, SHA256)
        assert target.read_bytes() == CONTENT

    def test_complete_part(self, server, target):
        target.parent.mkdir(parents=True)
        target.with_name("weights.bin.part").write_bytes(CONTENT)
        reference_data.download(server.url, target, SHA256)
        assert target.read_bytes() == CONTENT

    def test_wrong_hash_leaves_nothing(self, server, target):
        with pytest.raises(VerificationError):
            reference_data.download(server.url, target, "0" * 64)
        assert files_below(target.parent) == []

    def test_wrong_part_is_not_kept(self, server, target):
        """A part of another file ends in a wrong hash; the next attempt succeeds."""
        target.parent.mkdir(parents=True)
        target.with_name("weights.bin.part").write_bytes(b"other bytes")
        with pytest.raises(VerificationError):
            reference_data.download(server.url, target, SHA256)
        reference_data.download(server.url, target, SHA256)
        assert target.read_bytes() == CONTENT

    def test_file_that_the_server_lacks(self, server, target):
        with pytest.raises(DataNotFoundError, match="404"):
            reference_data.download(server.url.replace("weights.bin", "missing"), target, SHA256)
        assert files_below(target.parent) == []

    def test_a_place_that_cannot_be_written_to(self, server, tmp_path):
        (tmp_path / "file").write_text("")
        with pytest.raises(DataNotFoundError, match="cannot download"):
            reference_data.download(server.url, tmp_path / "file" / "weights.bin", SHA256)

    def test_unreachable_server(self, target):
        with pytest.raises(DataNotFoundError, match="cannot download"):
            reference_data.download(f"http://127.0.0.1:{closed_port()}/weights.bin", target, SHA256)


class TestPublishedWeights:
    """The order of the places: data root, checkout, cache, download."""

    @pytest.fixture
    def places(self, monkeypatch, tmp_path, server) -> dict[str, Path]:
        """Empty places; CONTENT stands for the published file."""
        monkeypatch.setenv("GGCNN_NET2NET_DATA", str(tmp_path / "root"))
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        monkeypatch.setattr(reference_data, "checkout_root", lambda: tmp_path / "checkout")
        monkeypatch.setattr(published, "PUBLISHED_SHA256", SHA256)
        monkeypatch.setattr(published, "PUBLISHED_URL", server.url)
        roots = {
            "root": tmp_path / "root", "checkout": tmp_path / "checkout",
            "cache": tmp_path / "cache" / "ggcnn_net2net",
        }  # fmt: skip
        places = {name: root / "original_ggcnn_weights" / published.PUBLISHED_NAME for name, root in roots.items()}
        for place in places.values():
            place.parent.mkdir(parents=True)
        return places

    def test_order(self, places, server):
        for name in ("cache", "checkout", "root"):
            places[name].write_bytes(CONTENT)
            assert published.published_weights() == places[name]
        assert server.requested == []

    def test_download_goes_to_the_cache(self, places, server):
        assert published.published_weights() == places["cache"]
        assert places["cache"].read_bytes() == CONTENT
        assert published.published_weights() == places["cache"]
        assert len(server.requested) == 1

    def test_without_data_root(self, places, monkeypatch):
        monkeypatch.delenv("GGCNN_NET2NET_DATA")
        places["checkout"].write_bytes(CONTENT)
        assert published.published_weights() == places["checkout"]

    @pytest.mark.parametrize("name", ["root", "checkout", "cache"])
    def test_a_wrong_file_is_an_error_and_not_passed_over(self, name, places, server):
        places[name].write_bytes(CONTENT[:-1])
        with pytest.raises(VerificationError, match=SHA256):
            published.published_weights()
        assert server.requested == []

    @pytest.mark.parametrize("allow_download", [False, True])
    def test_not_found_names_every_place_and_the_command(self, allow_download, places, monkeypatch):
        url = f"http://127.0.0.1:{closed_port()}/weights.bin"
        monkeypatch.setattr(published, "PUBLISHED_URL", url)
        with pytest.raises(DataNotFoundError) as caught:
            published.published_weights(allow_download=allow_download)
        message = str(caught.value)
        for part in (*map(str, places.values()), url, SHA256):
            assert part in message
        assert ("not allowed" in message) is not allow_download
        commands = [line.strip() for line in message.splitlines() if line.strip().startswith("curl")]
        assert commands == [f"curl --create-dirs -fLo {places['checkout']} {url}"]
