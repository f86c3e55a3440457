"""Curves of made-up runs over factors that are numbers."""

from dataclasses import replace

import numpy as np
import pytest

from sextant.atomic_files import write_json
from sextant.lifecycle.results import sweep_results
from sextant.reports.factor_report import factor_section, numeric_factors
from sextant.reports.section import summarise
from sextant.reports.sweep_report import write_report
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan

LABELS = np.arange(100) % 10


def swept(folder, factors_of, seeds=2):
    """Runs of two arms in each setting; number ``n`` gets ``50 + 10 n`` per cent, the second arm 5 more."""
    cells = []
    for number, factors in enumerate(factors_of):
        for arm, more in (("a", 0), ("b", 5)):
            for seed in range(seeds):
                run = RunDirectory(folder / "runs" / "classification" / f"{number}{arm}-s{seed}")
                cells.append(Cell(factors, arm, seed, seed, f"{number}{arm}", run.path.relative_to(folder).as_posix()))
                right = np.arange(100) < 50 + 10 * number + more
                run.path.mkdir(parents=True)
                np.savez_compressed(run.arrays, labels=LABELS, clean=np.where(right, LABELS, (LABELS + 1) % 10))
                told = {"outcome": "finished", "metrics": {}, "timing": {"fit_s": 1.0}, "parameters": 7}
                write_json(run.metrics, told)
    return sweep_results(SweepPlan("made_up", {}, ["sweep=made_up"], cells).write(folder))


def test_a_line_an_arm_over_the_values_in_their_order(tmp_path):
    results = swept(tmp_path, [{"task.examples": "20"}, {"task.examples": "1"}, {"task.examples": "5"}])
    section = factor_section(results, summarise(results))
    ((name, figure),) = section.figures
    assert name == "curve_task.examples"
    assert "## By task.examples" in section.text
    assert "(curve_task.examples.png)" in section.text
    (axes,) = figure.axes
    lines = {line.get_label(): line.get_xydata() for line in axes.lines}
    np.testing.assert_allclose(lines["a"], [[1, 60], [5, 70], [20, 50]])
    np.testing.assert_allclose(lines["b"], [[1, 65], [5, 75], [20, 55]])
    assert axes.get_ylabel() == "accuracy (%)"
    names = {path.name for path in write_report(results)}
    assert {"curve_task.examples.png", "curve_task.examples.svg"} <= names


def test_a_picture_for_each_setting_of_the_other_factors(tmp_path):
    results = swept(tmp_path, [{"net": net, "k": k} for net in ("x", "y") for k in ("1", "2.5")])
    assert numeric_factors(results) == ["k"]
    made = dict(factor_section(results, summarise(results)).figures)
    assert list(made) == ["curve_k_net_x", "curve_k_net_y"]
    assert made["curve_k_net_y"].get_suptitle() == "net=y"
    np.testing.assert_allclose(made["curve_k_net_y"].axes[0].lines[1].get_xydata(), [[1, 70], [2.5, 80]])


def test_a_line_breaks_where_nothing_converged_and_a_setting_without_runs_has_no_picture(tmp_path):
    settings = [{"net": net, "k": k} for net in ("x", "y") for k in ("1", "2", "3")]
    results = swept(tmp_path, settings)
    lost = [
        replace(result, outcome="failed", values={})
        if result.cell.factors["net"] == "y" or (result.cell.factors["k"], result.cell.arm) == ("2", "a")
        else result
        for result in results.cells
    ]
    results = replace(results, cells=lost)
    ((name, figure),) = factor_section(results, summarise(results)).figures
    assert name == "curve_k_net_x"
    lines = {line.get_label(): line.get_ydata() for line in figure.axes[0].lines}
    np.testing.assert_allclose(lines["a"], [50, np.nan, 70])
    np.testing.assert_allclose(lines["b"], [55, 65, 75])


@pytest.mark.parametrize(("seeds", "drawn"), [(2, False), (3, True)])
def test_intervals_are_drawn_from_three_seeds_on(tmp_path, seeds, drawn):
    results = swept(tmp_path, [{"k": "1"}, {"k": "2"}], seeds)
    ((_, figure),) = factor_section(results, summarise(results)).figures
    bands = [band.get_paths() for band in figure.axes[0].collections]
    assert [any(len(path.vertices) for path in paths) for paths in bands] == [drawn, drawn]


@pytest.mark.parametrize("values", [["1"], ["1", "null"], ["[a]", "[b]"], ["1", "nan"]])
def test_nothing_without_a_factor_of_numbers(tmp_path, values):
    results = swept(tmp_path, [{"f": value} for value in values])
    section = factor_section(results, summarise(results))
    assert (section.text, list(section.figures)) == ("", [])
