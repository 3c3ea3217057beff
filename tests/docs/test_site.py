"""The site builds without a warning, contains every page, and needs no network."""

import fcntl
import importlib.util
import os
import re
import runpy
import shutil
import subprocess
import sys
import threading
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace
from urllib.parse import quote

import pytest

from blocks.mathematics import Gain
from tests.checkout import ROOT
from tests.diagrams.robots import ROBOTS
from tests.docs import block_examples, block_pages
from tests.docs.block_pages import INDEX
from tests.docs.pages import DOCS, PAGES
from tests.docs.site import list_versions
from tests.graph.drawing.browser import needs_browser
from tests.runtime.record.panel.chromium import browser


@pytest.fixture(scope="module")
def site():
    """Folder of a site without pictures of blocks and with notebooks that are not executed.

    Only pages that have changed since the last time are built again, and once for all workers.
    """
    for library in ("myst_nb", "pydata_sphinx_theme"):
        if importlib.util.find_spec(library) is None:
            pytest.skip(f"{library} is not installed")
    folder = ROOT / "build" / "quick-site"
    folder.mkdir(parents=True, exist_ok=True)
    options = ["-W", "-q", "--keep-going", "-b", "html", "-d", str(folder / "doctrees")]
    command = [sys.executable, "-m", "sphinx", *options, "docs", str(folder / "1.0")]
    environment = os.environ | {"DOCS_QUICK": "1"}
    with open(ROOT / "build" / "quick-site.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # beside the same tests in another process
        session, by = os.environ.get("PYTEST_XDIST_TESTRUNUID", ""), folder / "session"
        if session and by.exists() and by.read_text() == session:
            return folder / "1.0"
        built = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
        if built.returncode or built.stderr:
            shutil.rmtree(folder)  # so that all warnings are printed again
        else:
            by.write_text(session)
    assert (built.returncode, built.stderr) == (0, "")
    return folder / "1.0"


def test_a_click_on_a_drawing_opens_its_page_with_zoom(tmp_path):
    """Of a robot, of a block and of the tutorial, whose pages show the drawing under the name that the script reads."""
    pytest.importorskip("docutils")
    draw_with_zoom = runpy.run_path(str(DOCS / "conf.py"))["draw_with_zoom"]
    draw_with_zoom.__globals__.update(QUICK=False, ROBOTS=["hip_exo_bilateral"])
    made, images = tmp_path / "_images", tmp_path / "api" / "blocks" / "images"
    made.mkdir()
    images.mkdir(parents=True)
    with block_examples.folder():
        page = block_pages.page(Gain, "blocks.mathematics", images, pictures=False)
    assert "![block diagram with Gain](images/Gain.svg)" in page
    draw_with_zoom(SimpleNamespace(outdir=tmp_path, srcdir=tmp_path), None)
    for name, path in (("hip_exo_bilateral", "left/hip"), ("Gain", "block"), ("exo", "knee")):
        page = (made / f"{name}.html").read_text()
        assert '<svg id="canvas"' in page and f'data-path="{path}' in page
    shown = 'picture.alt.startsWith("block diagram") ? picture.src.replace(/svg$/, "html")'
    assert shown in (DOCS / "_static" / "site.js").read_text()
    for robot in ROBOTS:
        assert f"![block diagram](images/{robot}.svg)" in (DOCS / "robots" / f"{robot}.md").read_text()
    for page in ("index", "3_strides"):
        assert re.search(r"!\[block diagram of .*\]\(images/exo.svg\)", (DOCS / "tutorial" / f"{page}.md").read_text())


@pytest.mark.soak
def test_every_page_is_in_the_site_and_in_its_navigation(site):
    pages = [page.relative_to(DOCS).with_suffix("") for page in PAGES if DOCS in page.parents and page != INDEX]
    start = (site / "index.html").read_text()
    for page in pages:
        assert (site / page.with_suffix(".html")).exists(), page
    for section in ("tutorial", "how_to", "reference", "explanation", "hardware"):
        assert f'href="{section}/index.html"' in start


@pytest.mark.soak
def test_pages_load_nothing_from_a_network(site):
    for page in site.rglob("*.html"):
        loaded = re.findall(r"<(?:script|link|img|iframe)\b[^>]*?(?:src|href)=\"(https?:[^\"]*)", page.read_text())
        assert not loaded, (page, loaded)


@pytest.mark.soak
def test_no_template_of_the_theme_is_in_the_site(site):
    assert [page for page in site.rglob("*.html") if "{{" in page.read_text() and "pathto(" in page.read_text()] == []


@pytest.mark.soak
def test_names_of_blocks_link_to_their_pages(site):
    assert 'href="../api/blocks/CubeMars.html"' in (site / "reference" / "actuators.html").read_text()


@pytest.mark.soak
def test_page_of_a_trial_lists_the_inherited_members(site):
    page = (site / "api" / "python" / "runtime.record.analysis.trial.html").read_text()
    for name in ("__getitem__", "fault", "strides", "time", "unit"):
        assert f'id="runtime.record.analysis.trial.Trial.{name}"' in page


def test_versions_are_listed_newest_first(tmp_path):
    for version in ("0.2.0", "0.10.0", "0.9.1"):
        (tmp_path / version).mkdir()
        (tmp_path / version / "index.html").write_text("")
    list_versions(tmp_path)
    assert (tmp_path / "versions.js").read_text() == 'window.TICKWORK_VERSIONS = ["0.10.0", "0.9.1", "0.2.0"];\n'
    assert "url=0.10.0/index.html" in (tmp_path / "index.html").read_text()


@needs_browser
@pytest.mark.parametrize("asked", ["0.2.0/how_to/gait_phase.html", "gait_phase", "0.1.0/gait-phase.html"])
@pytest.mark.soak
def test_an_address_without_a_page_leads_to_the_start_and_to_a_search(tmp_path, asked):
    """In a folder of the server, as for the pages of a project."""
    (tmp_path / "tickwork" / "0.2.0").mkdir(parents=True)
    (tmp_path / "tickwork" / "0.2.0" / "index.html").write_text("")
    list_versions(tmp_path / "tickwork")
    page = (tmp_path / "tickwork" / "404.html").read_bytes()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(404)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, *words):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server, browser(tmp_path) as new_tab:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        base = f"http://127.0.0.1:{server.server_port}/tickwork/"
        tab = new_tab(base + asked)
        assert tab.evaluate("document.getElementById('start').href") == base + "0.2.0/index.html"
        assert tab.evaluate("document.getElementById('search').href") == base + "0.2.0/search.html?q=gait%20phase"
        assert tab.text("#search") == "Search for “gait phase”"
        server.shutdown()


ASKED = {"stiffness": "Impedance", "damping": "Impedance", "integral gain": "PID", "low-pass": "Butterworth"}


@pytest.mark.soak
@needs_browser
def test_a_search_lists_the_block_first_that_the_words_describe(site, tmp_path):
    """Over HTTP, because the page reads the texts of what it has found."""
    handler = partial(SimpleHTTPRequestHandler, directory=str(site))
    handler.log_message = lambda *words: None
    first = "document.querySelector('#search-results li a')"
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, browser(tmp_path) as new_tab:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        for words, block in ASKED.items():
            tab = new_tab(f"http://127.0.0.1:{server.server_port}/search.html?q={quote(words)}")
            tab.wait_for(f"!!{first}")
            assert tab.evaluate(f"{first}.pathname") == f"/api/blocks/{block}.html", words
        server.shutdown()


@pytest.mark.soak
@needs_browser
def test_no_page_is_wider_than_a_phone(site, tmp_path):
    wide = {}
    with browser(tmp_path) as new_tab:
        tab = new_tab(f"file://{site}/index.html")
        tab.look(390, height=844)
        for page in sorted(site.rglob("*.html")):
            tab.open(f"file://{page}")
            if (width := tab.evaluate("document.documentElement.scrollWidth")) > 390:
                wide[str(page.relative_to(site))] = width
        tab.evaluate("document.querySelector('.bd-article, body').append('x'.repeat(999))")
        assert tab.evaluate("document.documentElement.scrollWidth") > 390  # it would be noticed
    assert not wide
