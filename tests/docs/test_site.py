"""The documentation as a site: built strictly, so that a broken link fails, and opened in a browser."""

import subprocess
import sys
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest
from docs_commands import ROOT
from headless import CHROMIUM, chromium

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


def test_the_reference_has_names_with_their_arguments(site):
    page = (site / "api" / "layers.html").read_text("utf-8")
    assert 'id="sextant.layers.PushPullConv2d"' in page
    assert "&gt;&gt;&gt;" in page
    assert ":class:" not in page


@pytest.fixture
def address(site):
    """Of a server of the site on the loopback interface; without one the site lacks its search and nothing else."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(SimpleHTTPRequestHandler, directory=site)) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium")
def test_the_front_page_shows_its_pictures_and_asks_no_other_host(address, tmp_path):
    with chromium(tmp_path) as tab:
        tab.open(address)
        assert tab.run("document.title") == "Sextant"
        assert tab.run("[...document.images].filter((i) => i.naturalWidth === 0).map((i) => i.src)") == []
        assert tab.run("document.images.length") >= 6
        assert [request for request in tab.requests if not request.startswith((address, "data:"))] == []
        assert [(complaint.get("text"), complaint.get("url")) for complaint in tab.complaints] == []


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium")
def test_what_is_wider_than_a_page_is_scrolled_by_keys(address, tmp_path):
    with chromium(tmp_path) as tab:
        tab.open(f"{address}results/push_pull/digits_weather/report.html")
        tab.run("new Promise((then) => setTimeout(then, 500))")
        wide = "[...document.querySelectorAll('.md-typeset__scrollwrap')].filter((t) => t.scrollWidth > t.clientWidth)"
        assert tab.run(f"{wide}.length") > 0
        assert tab.run(f"{wide}.filter((t) => t.tabIndex !== 0).length") == 0


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium")
def test_search_works_where_the_pages_are_opened_from_a_folder(site, tmp_path):
    with chromium(tmp_path) as tab:
        tab.open((site / "index.html").as_uri())
        found = tab.run(
            """new Promise((then) => {
                 const query = document.querySelector("[data-md-component=search-query]");
                 query.focus();
                 query.value = "push-pull";
                 query.dispatchEvent(new Event("keyup", { bubbles: true }));
                 query.dispatchEvent(new Event("input", { bubbles: true }));
                 const look = (left) => {
                   const links = [...document.querySelectorAll(".md-search-result__link")].map((link) => link.href);
                   if (links.length || !left) then(links.join(" "));
                   else setTimeout(look, 200, left - 1);
                 };
                 look(100);
               })"""
        )
        assert "push_pull.html" in found


def test_an_equation_is_drawn_without_a_script(site):
    page = (site / "tutorials" / "push_pull.html").read_text("utf-8")
    assert page.count("<math") >= 5
    assert "arithmatex" not in page


def test_each_task_has_a_page_of_its_options(site):
    for name in ("calibration", "place_recognition", "localization", "cosfire", "classification"):
        page = (site / "options" / f"{name}.html").read_text("utf-8")
        assert "<code>dataset=" in page
        assert "<code>task." in page
