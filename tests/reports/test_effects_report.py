"""Several arms against one control: effects beside costs, and over a grid."""

import csv

import numpy as np
import pytest
from made_up_sweep import PROTOCOL, MadeUpRun, made_up_sweep
from scipy import stats

from sextant.atomic_files import write_json
from sextant.evaluation import holm
from sextant.lifecycle.results import sweep_results
from sextant.reports.contrasts import contrasts
from sextant.reports.corruption_contrasts import arm_errors
from sextant.reports.cost_report import cost_table
from sextant.reports.effects_report import effects_section
from sextant.reports.pooled_report import pooled_rows
from sextant.reports.section import summarise
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan

OF_SET = {**PROTOCOL, "severities": {"fog": [1]}}
#: wrong images of 20 by arm and seed: clean, fog, noise
FOUND = {
    "none": [(2, 8, 9), (2, 9, 9), (3, 8, 10), (2, 9, 11)],
    "first": [(2, 6, 6), (3, 6, 7), (3, 5, 7), (1, 7, 8)],
    "all": [(4, 8, 9), (3, 9, 8), (5, 9, 10), (4, 8, 11)],
    "late": [(2, 8, 8), (3, 9, 9), (2, 9, 10), (2, 8, 10)],
}


def run(wrong, cost, setting="net"):
    conditions = dict(zip(("clean", "fog/1", "gaussian/0.5"), wrong, strict=True))
    return MadeUpRun(conditions, protocol=OF_SET, cost={"multiplications": cost}, setting=setting)


def section(results):
    return effects_section(results, contrasts(results), summarise(results))


def sweep(folder, arms=tuple(FOUND), **definition):
    costs = {"none": 100, "first": 150, "all": 600, "late": 200}
    return made_up_sweep(folder, {arm: [run(w, costs[arm]) for w in FOUND[arm]] for arm in arms}, **definition)


def test_differences_costs_and_holm_over_the_arms_of_one_condition(tmp_path):
    found = section(sweep(tmp_path))
    rows = list(csv.DictReader(found.files["effects.csv"].splitlines()))
    assert [(row["arm"], row["condition"]) for row in rows][:3] == [(arm, "clean") for arm in ("first", "all", "late")]
    for place, condition in enumerate(("clean", "corrupted", "gaussian")):
        of = [row for row in rows if row["condition"] == condition]
        p = []
        for row in of:
            pairs = zip(FOUND[row["arm"]], FOUND["none"], strict=True)
            difference = np.array([5 * (t[place] - c[place]) for t, c in pairs])  # per cent of 20 images
            expected = stats.ttest_1samp(difference, 0)
            assert float(row["difference"]) == pytest.approx(difference.mean())
            assert float(row["high"]) == pytest.approx(expected.confidence_interval().high)
            p.append(float(expected.pvalue))
        assert [float(row["p_holm"]) for row in of] == pytest.approx(holm(p))
    assert [float(row["cost_ratio"]) for row in rows[:3]] == [1.5, 6.0, 2.0]
    assert "| net | first | 4† | 1.50× |" in found.text


def test_the_figure_has_a_panel_a_condition_and_fills_what_is_certain(tmp_path):
    ((name, figure),) = section(sweep(tmp_path)).figures
    assert name == "error_against_cost"
    assert [axes.get_ylabel().splitlines()[0] for axes in figure.axes] == [
        "clean",
        "mean of 1 corruptions",
        "gaussian noise",
    ]
    fog = figure.axes[1]
    assert [text.get_text() for text in fog.texts] == ["none", "first", "all", "late"]
    points = [container.lines[0] for container in fog.containers]
    assert [float(point.get_xdata()[0]) for point in points] == [1, 1.5, 6, 2]
    np.testing.assert_allclose([point.get_ydata()[0] for point in points], [42.5, 30, 42.5, 42.5])
    filled = [point.get_markerfacecolor() != "white" for point in points]
    assert filled == [False, True, False, False]


def test_the_noise_floor_is_no_arm_and_two_arms_are_no_section(tmp_path):
    sides = {arm: {"treatment": arm, "control": "none"} for arm in ("first", "all", "late")}
    assert not section(sweep(tmp_path / "floor", contrasts=sides, noise_floor="late")).text
    assert not section(sweep(tmp_path / "two", arms=("none", "first", "all"))).text
    custom = made_up_sweep(tmp_path / "custom", {arm: [MadeUpRun({"clean": 1}, protocol=None)] for arm in FOUND})
    assert not section(custom).text


def test_an_arm_without_converged_runs_has_no_row_and_no_point(tmp_path):
    arms = {arm: [run(w, 100) for w in wrong] for arm, wrong in FOUND.items()}
    arms["all"] = [MadeUpRun(each.wrong, "diverged", OF_SET, each.cost) for each in arms["all"]]
    found = section(made_up_sweep(tmp_path, arms))
    assert "| all |" not in found.text
    assert [text.get_text() for text in found.figures[0][1].axes[0].texts] == ["none", "first", "late"]


def gridded(folder, seeds=4):
    """Widths 1 and 2 by strengths; the control and ``even`` at width 1 are the same runs."""
    cells, rng = [], np.random.default_rng(0)
    for width in ("2.0", "1.0"):
        for arm in ("conv", "weak", "even", "strong"):
            name = "conv" if arm == "conv" or (width, arm) == ("1.0", "even") else f"{width}{arm}"
            for seed in range(seeds):
                directory = RunDirectory(folder / "runs" / "classification" / f"{name}-s{seed}")
                place = directory.path.relative_to(folder).as_posix()
                cells.append(Cell({"inhibition.scale": width}, arm, seed, seed, name, place))
                if directory.path.exists():
                    continue
                directory.path.mkdir(parents=True)
                labels = np.zeros(20, int)
                arrays = {key: (np.arange(20) < rng.integers(2, 12)).astype(int) for key in ("clean", "fog/1")}
                np.savez_compressed(directory.arrays, labels=labels, **arrays)
                told = {"outcome": "finished", "metrics": {}, "timing": {"fit_s": 1.0}, "parameters": 7}
                write_json(directory.metrics, {**told, "protocol": OF_SET})
    return sweep_results(SweepPlan("made_up", {}, [], cells).write(folder))


def test_a_grid_is_one_family_without_the_cells_that_are_the_control_itself(tmp_path):
    found = section(gridded(tmp_path))
    rows = list(csv.DictReader(found.files["effects.csv"].splitlines()))
    for condition in ("clean", "corrupted"):
        of = [row for row in rows if row["condition"] == condition]
        assert len(of) == 6
        same = [row for row in of if (row["setting"], row["arm"]) == ("1.0", "even")]
        assert [(row["difference"], row["p_holm"]) for row in same] == [("0.0", "nan")]
        others = [row for row in of if row not in same]
        assert [float(r["p_holm"]) for r in others] == pytest.approx(holm([float(r["t_p_value"]) for r in others]))
    ((name, figure),) = found.figures
    assert name == "effect_map"
    assert [axes.get_title() for axes in figure.axes] == ["clean", "mean of 1 corruptions"]
    shown = np.asarray(figure.axes[0].images[0].get_array())
    assert shown.shape == (3, 2)
    assert [tick.get_text() for tick in figure.axes[0].get_xticklabels()] == ["1", "2"]
    of_clean = {(row["arm"], row["setting"]): float(row["difference"]) for row in rows if row["condition"] == "clean"}
    assert shown[2, 1] == pytest.approx(of_clean["strong", "2.0"])
    assert shown[1, 0] == 0


def test_an_arm_of_some_settings_alone_is_in_no_row_of_the_others(tmp_path):
    arms = {arm: [run(w, 100) for w in wrong] for arm, wrong in FOUND.items()}
    for arm in ("none", "first"):
        arms[arm] += [run(w, 100, "other") for w in FOUND[arm]]
    sides = {arm: {"treatment": arm, "control": "none"} for arm in ("first", "all", "late")}
    results = made_up_sweep(tmp_path, arms, contrasts=sides, noise_floor="late")
    there = {("net", arm) for arm in FOUND} | {("other", "none"), ("other", "first")}
    assert {(row.setting, row.arm) for row in summarise(results)} == there
    assert {(row.setting, row.contrast) for row in contrasts(results)} == {
        *(("net", arm) for arm in sides),
        ("other", "first"),
    }
    assert {(arm.setting, arm.arm) for arm in arm_errors(results)} == there
    assert {tuple(row[:2]) for row in cost_table(results).rows} == there
    assert {row.setting for row in pooled_rows(results)} == {"net"}
