"""Tables of metrics of made-up runs, with numbers worked out by hand."""

import csv
import io

import numpy as np
import pytest
from scipy import stats

from sextant.atomic_files import write_json
from sextant.lifecycle.results import sweep_results
from sextant.reports.metric import Metric, metric_of
from sextant.reports.metrics_report import TOGETHER, metric_summaries, metrics_section
from sextant.reports.sweep_report import write_report
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan

LIMITS = "0.5m_10deg_10f"
CONDITIONS = ("summer_noon, none", "summer_noon, kidnap")


def run_metrics(error, us=None, kidnapped=None):
    found = {f"test/position_error_median_{LIMITS}/summer_noon/none": error, "test/success": 0.5}
    if us is not None:
        found["test/us_per_particle"] = us
    return found | {f"test/position_error_median_{LIMITS}/summer_noon/kidnap": kidnapped}


def sweep_of(folder, arms, **definition):
    """The results of a sweep of localizers; ``arms`` gives the metrics of each seed, or (metrics, outcome)."""
    cells = []
    for arm, runs in arms.items():
        for pair, run in enumerate(runs):
            metrics, outcome = run if isinstance(run, tuple) else (run, "finished")
            directory = RunDirectory(folder / "runs" / "localization" / f"{arm}-{pair}")
            cells.append(Cell({}, arm, pair, pair, arm, directory.path.relative_to(folder).as_posix()))
            directory.path.mkdir(parents=True)
            np.savez_compressed(directory.arrays, **{f"success/{name}": np.arange(4) % 2 for name in CONDITIONS})
            results = {"outcome": outcome, "metrics": metrics, "parameters": 5, "timing": {"fit_s": 1.0}}
            write_json(directory.metrics, results)
    return sweep_results(SweepPlan("made_up", definition, [], cells).write(folder))


@pytest.fixture
def sweep(tmp_path):
    """Of the exact arm one seed has no error after a kidnap, and one diverged; the other arm is of older code."""
    exact = [run_metrics(0.1, 700.0, 0.3), run_metrics(0.2, 800.0), (run_metrics(9.0, 9.0, 9.0), "diverged")]
    return sweep_of(tmp_path, {"exact": exact, "cached": [run_metrics(0.15, kidnapped=0.25)] * 2})


def rows_of(results, *names):
    rows = metric_summaries(results, [metric_of(name) for name in names])
    return {(row.arm, row.condition, row.metric.name): row for row in rows}


def test_a_metric_is_found_under_its_protocol_and_condition():
    metrics = {
        f"test/position_error_median_{LIMITS}/summer_noon/kidnap": 1.0,
        "test/position_error_median_2frames_10f/winter": 2.0,
        f"test/position_error_rmse_{LIMITS}/summer_noon/kidnap": 3.0,
        "test/position_error_median": 4.0,
        "val/position_error_median": 5.0,
    }
    told = Metric("position_error_median", "error", scale=10).values(metrics, CONDITIONS)
    assert told == {"summer_noon, kidnap": 10, "winter": 20, "": 40}
    assert metric_of("val/position_error_median").values(metrics, CONDITIONS) == {"": 5}


def test_a_mean_is_of_the_conditions_of_a_run_and_then_of_runs(sweep):
    rows = rows_of(sweep, "position_error_median", "us_per_particle", "success")
    error = rows["cached", TOGETHER, "position_error_median"]
    assert (error.mean, error.told, error.asked, error.spread) == (pytest.approx(0.2), 4, 4, pytest.approx(0))
    missing = rows["exact", TOGETHER, "position_error_median"]
    assert (missing.mean, missing.told, missing.asked, missing.runs) == (pytest.approx(0.2), 3, 4, 2)
    kidnapped = rows["exact", "summer_noon, kidnap", "position_error_median"]
    assert (kidnapped.mean, kidnapped.told, kidnapped.asked) == (pytest.approx(0.3), 1, 2)
    assert np.isnan(kidnapped.low)
    assert rows["exact", TOGETHER, "success"].mean == 50
    assert ("cached", TOGETHER, "us_per_particle") not in rows


def test_intervals_are_of_student_over_converged_runs(sweep):
    row = rows_of(sweep, "us_per_particle")["exact", TOGETHER, "us_per_particle"]
    half = stats.t.ppf(0.975, 1) * np.std([700, 800], ddof=1) / np.sqrt(2)
    assert (row.low, row.high) == (pytest.approx(750 - half), pytest.approx(750 + half))


def test_the_report_has_a_table_and_a_file_without_columns_that_no_run_tells(sweep):
    paths = {path.name: path for path in write_report(sweep)}
    report = paths["report.md"].read_text()
    assert report.index("## Further metrics") < report.index("## Cost")
    head = next(line for line in report.splitlines() if line.startswith("| setting | arm | success, % |"))
    assert head == "| setting | arm | success, % | position error | µs a particle |"
    assert "| - | cached | 50.0 | 0.200 [0.200, 0.200] | – |" in report  # shares that agree tell no interval
    assert "(3 of 4)" in report
    assert "NEES" not in report
    assert "| summer_noon, kidnap | - | exact | 0.300 (1 of 2) |" in report
    rows = list(csv.DictReader(paths["metrics.csv"].open()))
    assert {row["metric"] for row in rows} == {"success, %", "position error", "µs a particle"}
    assert {row["condition"] for row in rows} == {TOGETHER, *CONDITIONS}


def test_a_sweep_names_its_metrics(tmp_path):
    names = ["us_per_particle", "made_up", "test/success"]
    section = metrics_section(sweep_of(tmp_path, {"a": [run_metrics(0.1, 0.0521)] * 2}, metrics=names))
    assert "| setting | arm | µs a particle | test/success |" in section.text
    assert "| - | a | 0.0521 [0.0521, 0.0521] | 0.500 |" in section.text  # shares that agree tell no interval
    assert "No run has made_up." in section.text
    assert len(list(csv.reader(io.StringIO(section.files["metrics.csv"])))) == 3


def test_runs_that_tell_nothing_have_no_section(tmp_path):
    section = metrics_section(sweep_of(tmp_path, {"a": [{}] * 2}))
    assert (section.text, section.files) == ("", {})


def test_contrasts_in_metrics_are_of_pairs_in_which_both_have_a_value(tmp_path):
    """A seed without an error after a kidnap is left out there alone, and one that diverged everywhere."""
    exact = [run_metrics(0.1, kidnapped=0.3), run_metrics(0.2), run_metrics(0.4), (run_metrics(9.0), "diverged")]
    cached = [run_metrics(0.3, kidnapped=0.2), run_metrics(0.3), run_metrics(0.3), run_metrics(0.3)]
    sides = {"cheaper": {"treatment": "cached", "control": "exact"}}
    section = metrics_section(sweep_of(tmp_path, {"exact": exact, "cached": cached}, contrasts=sides))
    rows = list(csv.DictReader(io.StringIO(section.files["differences.csv"])))
    found = {(row["condition"], row["metric"]): row for row in rows}
    whole, kidnap = (found[condition, "position_error_median"] for condition in CONDITIONS)
    assert (whole["contrast"], whole["seeds"], whole["replicate"]) == ("cheaper", "3", "seeds")
    assert float(whole["mean"]) == pytest.approx(0.2 / 3)
    half = stats.t.ppf(0.975, 2) * np.std([0.2, 0.1, -0.1], ddof=1) / np.sqrt(3)
    assert float(whole["high"]) == pytest.approx(0.2 / 3 + half)
    assert (kidnap["seeds"], float(kidnap["mean"])) == ("1", pytest.approx(-0.1))
