"""Pages of claims, reports and searches, opened in a browser without a window."""

import re

import pytest
from headless import CHROMIUM, chromium
from made_up_search import made_up_search
from made_up_sweep import MadeUpRun, made_up_sweep

from sextant import cli
from sextant.figures.interval_chart import IntervalRow, interval_chart
from sextant.lifecycle.claim_files import read_claims
from sextant.lifecycle.results import sweep_results
from sextant.reports.page.html_page import html_page
from sextant.reports.page.report_page import write_report_page
from sextant.reports.sweep_report import write_report

#: where there is a browser; the pages' charts are drawn by nothing else
in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium")
DRAWN = """new Promise((done) => {
  const told = () => done(Number(document.body.dataset.charts));
  if ("charts" in document.body.dataset) told();
  new MutationObserver(told).observe(document.body, { attributes: true, attributeFilter: ["data-charts"] });
})"""
POINT = "path[aria-roledescription=point]"
CLAIMS = read_claims()
ARMS = {"plain": [1, 2, 3], "<img src=x onerror=document.title='hit'>": [0, 1, 1]}


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("profile")) as page:
        yield page


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    folder = tmp_path_factory.mktemp("board")
    cli.run("claims", [f"html={folder}", f"output={folder}"])
    return folder / "claims.html"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The page of a sweep with an arm of a bad name."""
    folder = tmp_path_factory.mktemp("sweep")
    arms = {arm: [MadeUpRun({"clean": n, "noise/1": n + 3}, protocol=None) for n in ns] for arm, ns in ARMS.items()}
    contrasts = {"effect": {"treatment": [*arms][1], "control": "plain"}}
    results = made_up_sweep(folder, arms, contrasts=contrasts, question="Which is better?")
    write_report(results)
    return write_report_page(results, folder)


def shown(tab, page):
    """Open a page; how many charts it drew."""
    tab.complaints.clear()
    tab.requests.clear()
    tab.open(f"file://{page}")
    return tab.run(DRAWN)


def marks(tab, shape=POINT):
    """How many marks each chart of the page has."""
    return tab.run(f"[...document.querySelectorAll('[data-chart]')].map((c) => c.querySelectorAll('{shape}').length)")


def column(tab, heading):
    """The cells under a heading of the first table."""
    return tab.run(
        f"""(() => {{
          const table = document.querySelector("table");
          const at = [...table.tHead.rows[0].cells].findIndex((c) => c.textContent === "{heading}");
          return [...table.tBodies[0].rows].map((row) => row.cells[at].textContent);
        }})()"""
    )


def click(tab, heading):
    tab.run(f"""[...document.querySelectorAll("th")].find((c) => c.textContent === "{heading}").firstChild.click()""")


def move_to(tab, selector):
    """Move the pointer to the first of these; where that is."""
    box = f"document.querySelector('{selector}').getBoundingClientRect()"
    x, y = tab.run(f"(() => {{ const b = {box}; return [b.x + b.width / 2, b.y + b.height / 2]; }})()")
    tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    return x, y


def click_on(tab, selector):
    x, y = move_to(tab, selector)
    for kind in ("mousePressed", "mouseReleased"):
        tab.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)


@pytest.mark.slow
@in_a_browser
def test_the_board_is_drawn_from_one_file_without_a_complaint(tab, board):
    charts = shown(tab, board)
    assert charts >= 1 + len(CLAIMS)
    assert len(marks(tab)) == charts
    assert all(marks(tab))
    assert tab.complaints == []
    assert set(tab.requests) == {f"file://{board}"}


@pytest.mark.slow
@in_a_browser
def test_a_heading_sorts_its_column_by_numbers_and_back(tab, board):
    shown(tab, board)
    name = "effect in its favour"
    as_written = column(tab, name)
    click(tab, name)
    missing = [text for text in as_written if text == "not run yet"]
    there = len(as_written) - len(missing)
    rising = [float(text.split()[0]) for text in column(tab, name)[:there]]
    assert rising == sorted(rising)
    assert column(tab, name)[there:] == missing != []
    click(tab, name)
    assert [float(text.split()[0]) for text in column(tab, name)[:there]] == rising[::-1]
    assert column(tab, name)[there:] == missing
    assert sorted(column(tab, name)) == sorted(as_written)
    assert tab.run("document.querySelector('th[aria-sort]').ariaSort") == "descending"
    click(tab, "verdict")
    verdicts = column(tab, "verdict")
    assert verdicts == sorted(verdicts)


@pytest.mark.slow
@in_a_browser
@pytest.mark.parametrize("width", [1200, 390])
def test_the_board_fits_a_desk_and_a_telephone_by_day_and_by_night(tab, board, width, tmp_path):
    backgrounds = []
    for dark in (False, True):
        tab.look(tmp_path / "page.png", width=width, dark=dark)
        shown(tab, board)
        backgrounds.append(tab.run("getComputedStyle(document.body).backgroundColor"))
        texts = tab.run("getComputedStyle(document.querySelector('svg text')).fill")
        assert texts == tab.run("getComputedStyle(document.body).color")
        assert tab.run("document.documentElement.scrollWidth <= innerWidth")
    assert backgrounds == ["rgb(255, 255, 255)", "rgb(22, 24, 28)"]


@pytest.mark.slow
@in_a_browser
def test_a_click_on_a_claim_leads_to_its_section(tab, board):
    shown(tab, board)
    click_on(tab, POINT)
    assert tab.run("location.hash") == f"#{next(iter(CLAIMS))}"
    links = tab.run("[...document.querySelectorAll('a[href^=\"#\"]')].map((a) => a.getAttribute('href').slice(1))")
    assert set(links) == set(CLAIMS)
    assert tab.run(f"{sorted(CLAIMS)}.every((name) => document.getElementsByName(name).length === 1)")
    assert tab.run("document.querySelectorAll('a[href$=\".md\"]').length") == 0


@pytest.mark.slow
@in_a_browser
def test_a_report_has_its_arms_and_contrasts_and_runs_no_code_of_theirs(tab, report):
    assert shown(tab, report) == 2
    assert marks(tab) == [4, 2]
    assert (tab.run("document.title"), set(tab.requests)) == ("made_up", {f"file://{report}"})
    assert list(tab.complaints) == []


def test_names_are_shown_as_they_are(report):
    page = report.read_text().replace("<wbr>", "")
    assert "<img src=x" not in page
    assert "&lt;img src=x onerror" in page


def test_what_a_click_shows_is_in_the_page_and_its_words_alone():
    inside = "<details><summary>By corruption</summary>\n\n| a |\n| --- |\n| 1 |\n\n</details>\n"
    page = html_page("t", inside, {})
    assert "<details><summary>By corruption</summary>" in page
    assert page.count("</details>") == 1
    page = html_page("t", "<details><summary><img src=x></summary>\n\n<details open>\n", {})
    assert "<details" not in page


def test_markup_of_the_text_is_text_but_for_places_to_link_to():
    page = html_page("t", '## <a name="here"></a>`here`\n\n<form action=https://x><b>bold</b>\n\n<meta a>\n', {})
    assert '<a name="here"></a>' in page
    assert not any(tag in page.partition("<body>")[2] for tag in ("<form", "<b>", "<meta"))


@pytest.mark.slow
@in_a_browser
def test_a_search_has_its_trials(tab, tmp_path):
    outputs = tmp_path / "outputs"
    made_up_search(outputs, trials=4)
    results = sweep_results("search", outputs)
    write_report(results)
    assert shown(tab, write_report_page(results, tmp_path)) == 1
    assert marks(tab) == [4]
    assert tab.complaints == []
    assert tab.run("[...document.images].every((image) => image.naturalWidth > 0)")


@pytest.mark.slow
@in_a_browser
def test_the_pointer_is_told_and_the_legend_shows_one_kind_alone(tab, tmp_path):
    rows = [
        IntervalRow("a", 1.0, 0.5, 1.5, "first", tip={"x.y [z]": "11 < 12"}),
        IntervalRow("a", 2.0, 1.5, 2.5, "second"),
        IntervalRow("b", float("nan"), float("nan"), float("nan"), "second"),
    ]
    page = tmp_path / "page.html"
    page.write_text(html_page("t", "![chart](one.svg)", {"one": [interval_chart(rows, "x")]}))
    tab.call("Emulation.setDeviceMetricsOverride", width=800, height=600, deviceScaleFactor=1, mobile=False)
    shown(tab, page)
    move_to(tab, POINT)
    assert tab.run("document.getElementById('vg-tooltip-element').innerText").split() == ["x.y", "[z]", "11", "<", "12"]
    click_on(tab, ".role-legend-symbol path")
    faded = "[...document.querySelectorAll('path[aria-roledescription=point]')].map((p) => p.getAttribute('opacity'))"
    assert tab.run(faded)[:2] == ["1", "0.1"]
    assert tab.complaints == []


@pytest.mark.slow
def test_the_same_results_give_the_same_page(board, tmp_path):
    cli.run("claims", [f"html={tmp_path}", f"output={tmp_path}"])
    assert (tmp_path / "claims.html").read_bytes() == board.read_bytes()


def test_a_page_takes_in_pictures_that_are_there_and_names_the_others(tmp_path):
    (tmp_path / "there.png").write_bytes(b"picture")
    page = html_page("t", "![one](there.png) ![two](../gone.png) [text](other.md)", {}, tmp_path)
    assert re.findall(r'<img alt="(\w+)" src="([^"]*)"', page) == [("one", "data:image/png;base64,cGljdHVyZQ==")]
    assert "two" in page
    assert "other.md" not in page
