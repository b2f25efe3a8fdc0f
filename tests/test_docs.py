"""The documentation's site builds without a warning, and the reference has every public name.

Sphinx warns of links into nowhere, missing pictures and pages outside of the navigation. The tutorial's cells, which
take minutes, are not run here, but by `.ci/run`.
"""

import pkgutil
import re
import subprocess
import sys
import zlib
from importlib import import_module
from pathlib import Path

import pytest

import ggcnn_net2net as gn
from ggcnn_net2net.cli.main import COMMANDS

ROOT = Path(__file__).parents[1]
ROOMS = [room.name for room in pkgutil.iter_modules(gn.__path__) if room.ispkg]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the built site."""
    folder = tmp_path_factory.mktemp("site")
    options = ("-W", "--keep-going", "-q", "-D", "nb_execution_mode=off", "-d", folder / "trees")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *options, ROOT / "docs", folder], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def names(site):
    """All names that the reference documents."""
    header, body = (site / "objects.inv").read_bytes().split(b"zlib.\n", 1)
    assert b"Sphinx inventory version 2" in header
    return {line.split()[0] for line in zlib.decompress(body).decode().splitlines()}


@pytest.mark.slow
def test_every_public_name_is_documented(names):
    public = {
        f"ggcnn_net2net.{room}.{name}"
        for room in ROOMS
        for name in getattr(import_module(f"ggcnn_net2net.{room}"), "__all__", ())
    }
    public |= {f"ggcnn_net2net.{gn._HOME[name]}.{name}" for name in gn.__all__ if name != "__version__"}
    assert public - names == set()


@pytest.mark.slow
@pytest.mark.parametrize("room", [room for room in ROOMS if room != "cli"])
def test_every_room_has_a_page(site, room):
    assert (site / "reference" / f"{room}.html").is_file()


@pytest.mark.slow
def test_every_command_is_documented(site):
    page = (site / "reference" / "cli.html").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f'id="ggcnn-net2net-{name}"' not in page] == []


@pytest.mark.slow
def test_pages_load_nothing_from_elsewhere(site):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"<(script|img)[^>]+src=\"https?:|<link[^>]+rel=\"stylesheet\"[^>]+href=\"https?:", text)


@pytest.mark.slow
def test_the_page_on_searches_and_the_search_of_the_site_are_both_there(site):
    assert "searchindex.js" in (site / "search.html").read_text(encoding="utf-8")
    assert "lookahead" in (site / "beam_search.html").read_text(encoding="utf-8")


def test_changelog_knows_the_version():
    assert gn.__version__ in (ROOT / "docs" / "changelog.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", ["README.md", "original_ggcnn_weights/README.md"])
def test_links_of_pages_outside_of_the_site(page):
    path = ROOT / page
    targets = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8"))
    local = [target for target in targets if "://" not in target]
    assert [target for target in local if not (path.parent / target).exists()] == []
