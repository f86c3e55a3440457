"""Runs that did not learn are explained: in a report, on the page of a sweep and in a browser, without empty tables."""

import re

import pytest
import yaml
from headless import CHROMIUM, chromium
from made_up_sweep import MadeUpRun, made_up_sweep

from sextant.cli.report import _show
from sextant.kit.measure import ACCURACY
from sextant.reports.divergence import divergence, what_to_do
from sextant.reports.page.html_page import html_page
from sextant.reports.page.report_page import write_report_page
from sextant.reports.results import SweepResults, Training
from sextant.reports.sweep_page import Progress, outcomes_told, sweep_page
from sextant.reports.sweep_report import write_report
from sextant.runs.directory import RunDirectory

GOOD, BAD = MadeUpRun({"clean": 2}, protocol=None), MadeUpRun({"clean": 18}, "diverged", protocol=None)


def reported(results: SweepResults) -> str:
    return write_report(results)[0].read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_sweep_of_which_no_run_learnt_says_why_and_shows_what_was_reached(tmp_path):
    results = made_up_sweep(tmp_path, {"none": [BAD] * 2, "push_pull": [BAD] * 2})
    text = reported(results)
    assert "**None of the runs learnt.**" in text
    assert "A run has diverged if its validation accuracy after training is nearer to chance than to 1." in text
    assert "10.00" in text  # per cent, of the runs that diverged
    assert "–" not in text.partition("## Cost")[0]
    assert not list((results.directory / "report").glob("*.png"))
    assert "data-chart=" not in write_report_page(results, tmp_path).read_text(encoding="utf-8")
    page, metrics = sweep_page(results.plan, Progress(4, 4), results, tmp_path)
    assert "None of the runs learnt" in page
    assert (metrics["runs/diverged"], outcomes_told(results)) == (4.0, "4 diverged")


def test_one_arm_of_which_no_run_learnt_is_in_no_table_but_that_of_runs(tmp_path):
    results = made_up_sweep(tmp_path, {"none": [GOOD] * 2, "push_pull": [BAD] * 2})
    text = reported(results)
    assert "**2 of 4 runs did not learn.**" in text
    assert "No pair of runs converged" in text
    assert len(re.findall(r"^\| net \| push_pull \|", text.partition("## Cost")[0], re.MULTILINE)) == 1
    assert not (results.directory / "report" / "contrast_push_pull-none.png").exists()


@pytest.mark.parametrize(("none", "push_pull", "pairs"), [(2, 2, 2), (2, 1, 1), (1, 2, 1), (1, 1, 1), (2, 0, 0)])
def test_a_dash_where_few_pairs_learnt_is_explained(tmp_path, capsys, none, push_pull, pairs):
    """Boundaries: two pairs, which have an interval; one, where its partner diverged; none."""
    arms = {"none": [GOOD] * none + [BAD] * (2 - none), "push_pull": [GOOD] * push_pull + [BAD] * (2 - push_pull)}
    results = made_up_sweep(tmp_path, arms)
    page, _ = sweep_page(results.plan, Progress(4, 4), results, tmp_path)
    _show(results)
    for text in (reported(results), page, capsys.readouterr().out):
        contrast = text.partition("push_pull - none")[2].partition("\n## ")[0]
        assert ("one pair has neither an interval nor a p" in " ".join(text.split())) is (pairs == 1)
        assert pairs == 1 or "–" not in contrast
        assert "1 pairs" not in text


@pytest.mark.parametrize(
    ("rate", "proposed"), [("1e6", 0.1), ("1.5", 0.1), ("1", 0.1), ("0.3", 0.03), ("0.02", 0.002), ("5e-7", 5e-8)]
)
def test_the_rate_that_is_proposed_may_work(tmp_path, rate, proposed):
    """Boundaries: rates so high that a tenth is as well; one that is usual; a tiny one."""
    run = RunDirectory(tmp_path)
    run.config.write_text(yaml.safe_dump({"trainer": {"max_epochs": 2}, "optimizer": {"lr": float(rate)}}))
    text = what_to_do(ACCURACY, [Training.of(run)], ["train", "trainer=fast", f"optimizer.lr={rate}"])
    assert text.endswith(f"Try `sextant train trainer=fast optimizer.lr={proposed:g}`")


def test_nothing_is_said_where_all_learnt(tmp_path):
    results = made_up_sweep(tmp_path, {"none": [GOOD] * 2, "push_pull": [GOOD] * 2})
    assert divergence(results) == ""
    assert "did not learn" not in reported(results)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium")
@pytest.mark.parametrize("columns", [3, 8, 13, 15])
def test_no_column_is_cut_on_a_screen_and_a_phone_scrolls_within_the_table(tmp_path, columns):
    row = ["a_long_setting/of_the_network", *["-12.34 [-45.67, +89.01]"] * (columns - 1)]
    head = ["setting", *["95 % over seeds and images"] * (columns - 1)]
    text = "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * columns, row))
    page = tmp_path / "page.html"
    page.write_text(html_page("Widths", f"{text}\n", {}), encoding="utf-8")
    widths = "[document.documentElement, document.querySelector('.table')].map((e) => e.scrollWidth - e.clientWidth)"
    with chromium(tmp_path / "profile") as tab:
        for width in (1280, 390):
            tab.call("Emulation.setDeviceMetricsOverride", width=width, height=800, deviceScaleFactor=1, mobile=False)
            tab.open(f"file://{page}")
            body, table = tab.run(widths)
            assert body <= 0
            assert width < 1280 or table <= 0
