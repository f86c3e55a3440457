"""A report of made-up runs whose statistics are known."""

import csv
from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy import stats

from sextant.atomic_files import write_json
from sextant.chapters.calibration.measure import CALIBRATION_ERRORS
from sextant.errors import UserError
from sextant.lifecycle.results import sweep_results
from sextant.reports.contrasts import contrasts
from sextant.reports.section import summarise
from sextant.reports.sweep_report import write_report
from sextant.runs.directory import RunDirectory, RunKey
from sextant.runs.sweep_directory import Cell, SweepPlan
from sextant.tables import (
    NOTHING,
    WIDEST,
    Entry,
    TextTable,
    arms_table,
    interval,
    is_number,
    number,
    p_text,
)

IMAGES, SEEDS = 400, 9
DEFINITION = {
    "question": "Is b better?",
    "contrasts": {
        "effect": {"treatment": "b", "control": "a"},
        "floor": {"treatment": "twin", "control": "a"},
    },
    "noise_floor": "floor",
    "published": {"net": {"a": {"clean": 90.0}, "b": {"clean": 99.0}}},
}


@pytest.fixture
def sweep(tmp_path):
    rng = np.random.default_rng(0)
    labels = rng.integers(10, size=IMAGES)
    cells, accuracy = [], {}
    for arm, gain in (("a", 0.0), ("b", 0.1), ("twin", 0.0)):
        for pair in range(SEEDS):
            seed = pair + 1000 * (arm == "twin")
            run = RunDirectory(tmp_path / "runs" / "classification" / f"{arm}-s{seed}")
            cells.append(Cell({"backbone": "net"}, arm, pair, seed, arm, run.path.relative_to(tmp_path).as_posix()))
            lost = (arm, pair) in (("b", 3), ("twin", 5))
            arrays = {"labels": labels}
            for key, level in (("clean", 0.8), ("gaussian/0.1", 0.6)):
                right = rng.random(IMAGES) < (0.1 if lost else level + gain + 0.02 * rng.standard_normal())
                arrays[key] = np.where(right, labels, (labels + 1) % 10)
                accuracy[arm, pair, key] = 100 * right.mean()
            run.path.mkdir(parents=True)
            if (arm, pair) == ("a", 8):
                run.update_state({**asdict(RunKey("classification", arm, seed, "c", "d")), "failure": "UserError: no"})
                continue
            np.savez_compressed(run.arrays, **arrays)
            write_json(
                run.metrics,
                {
                    "outcome": "diverged" if lost else "finished",
                    "metrics": {},
                    "timing": {"fit_s": 1.0},
                    "parameters": 7,
                },
            )
    directory = SweepPlan("made_up", DEFINITION, ["sweep=made_up"], cells).write(tmp_path)
    return sweep_results(directory), accuracy


def test_every_planned_run_is_counted(sweep):
    results, _ = sweep
    counts = {name: results.count(name) for name in ("finished", "diverged", "failed", "missing")}
    assert counts == {"finished": 24, "diverged": 2, "failed": 1, "missing": 0}


def test_a_cell_is_the_distribution_over_converged_seeds(sweep):
    results, accuracy = sweep
    (row,) = (s for s in summarise(results) if (s.arm, s.condition) == ("b", "clean"))
    values = [accuracy["b", pair, "clean"] for pair in range(SEEDS) if pair != 3]
    assert (row.seeds, row.diverged, row.failed, row.missing) == (8, 1, 0, 0)
    assert row.mean == pytest.approx(np.mean(values))
    assert row.median == pytest.approx(np.median(values))
    assert row.spread == pytest.approx(np.std(values, ddof=1))
    p = np.mean(values) / 100
    n = p * (1 - p) / (stats.sem(values) / 100) ** 2 * (stats.norm.ppf(0.975) / stats.t.ppf(0.975, 7)) ** 2
    ends = stats.beta.ppf([0.025, 0.975], [n * p, n * p + 1], [n * (1 - p) + 1, n * (1 - p)])
    assert (row.low, row.high) == pytest.approx(tuple(100 * ends))
    assert row.all_mean == pytest.approx(np.mean([*values, accuracy["b", 3, "clean"]]))


def test_a_contrast_pairs_seeds_drops_diverged_pairs_and_says_so(sweep):
    results, accuracy = sweep
    (row,) = (r for r in contrasts(results) if (r.contrast, r.condition) == ("effect", "clean"))
    kept = [pair for pair in range(SEEDS) if pair not in (3, 8)]
    differences = [accuracy["b", p, "clean"] - accuracy["a", p, "clean"] for p in kept]
    assert (row.paired.seeds, row.dropped) == (7, 2)
    assert row.paired.mean == pytest.approx(np.mean(differences))
    test = stats.ttest_rel(*([accuracy[arm, p, "clean"] for p in kept] for arm in "ba")).confidence_interval()
    assert (row.paired.low, row.paired.high) == pytest.approx((test.low, test.high))
    everything = [accuracy["b", p, "clean"] - accuracy["a", p, "clean"] for p in range(8)]
    assert row.everything == pytest.approx(np.mean(everything))
    floor = [accuracy["twin", p, "clean"] - accuracy["a", p, "clean"] for p in range(8) if p != 5]
    assert row.floor.spread == pytest.approx(np.std(floor, ddof=1))
    assert row.published == pytest.approx(9.0)
    reach = stats.t.ppf(0.975, 6) * np.std(floor, ddof=1) * np.sqrt(1 + 1 / 7)
    assert row.single_pair_reach == pytest.approx(reach)


def test_holm_is_over_the_family_of_a_contrast(sweep):
    results, _ = sweep
    rows = [row for row in contrasts(results) if row.contrast == "effect"]
    raw = sorted(row.paired.p_value for row in rows)
    assert sorted(row.p_holm for row in rows) == pytest.approx([min(1, 2 * raw[0]), max(min(1, 2 * raw[0]), raw[1])])


def test_the_written_report(sweep):
    results, _ = sweep
    paths = {path.name: path for path in write_report(results)}
    text = paths["report.md"].read_text()
    assert "27 runs planned: 24 finished, 2 diverged, 1 failed, 0 missing. 9 seeds a cell.\n" in text
    seeds = list(csv.DictReader(paths["seeds.csv"].open()))
    assert len(seeds) == 27 * 2
    assert {(row["arm"], row["pair"], row["value"]) for row in seeds if row["outcome"] == "failed"} == {
        ("a", "8", "nan")
    }
    assert "Exploratory" not in text
    assert "Of 1 published differences" in text
    rows = list(csv.DictReader(paths["contrasts.csv"].open()))
    assert {row["contrast"] for row in rows} == {"effect", "floor"}
    assert float(rows[0]["mean"]) > 5
    assert paths["cells.tex"].read_text().startswith("\\begin{tabular}")
    assert {"contrast_effect.svg", "severity_net.png"} <= set(paths)


def test_arms_tested_on_other_images_and_conditions_are_compared_by_what_they_share(sweep):
    results, _ = sweep
    cells = [
        replace(cell, values={"clean": cell.values["clean"][:50]}) if cell.cell.arm == "b" and cell.values else cell
        for cell in results.cells
    ]
    results = replace(results, cells=cells)
    assert results.conditions == ["clean"]
    (row,) = (r for r in contrasts(results) if r.contrast == "effect")
    assert row.paired.seeds == 7
    write_report(results)


def test_a_run_that_a_nan_stopped_is_a_dropped_pair(sweep):
    results, _ = sweep
    lost = [
        replace(c, outcome="diverged", values={}) if (c.cell.arm, c.cell.pair) == ("b", 0) else c for c in results.cells
    ]
    (row,) = (r for r in contrasts(replace(results, cells=lost)) if (r.contrast, r.condition) == ("effect", "clean"))
    assert (row.paired.seeds, row.dropped) == (6, 3)
    assert row.exploratory


def test_a_sweep_without_a_finished_run_cannot_be_reported(tmp_path):
    plan = SweepPlan("none", {}, [], [Cell({}, "a", 0, 0, "d", "runs/classification/x")])
    with pytest.raises(UserError, match="none of its 1 run is finished yet"):
        sweep_results(plan.write(tmp_path))


def test_tables_and_numbers():
    table = TextTable(["a|b", "c"], [["1 %", "x_y"]])
    assert table.markdown() == "| a\\|b | c |\n| --- | --- |\n| 1 % | x_y |\n"
    assert table.csv() == "a|b,c\n1 %,x_y\n"
    assert "1 \\% & x\\_y \\\\" in table.latex()
    assert [number(1.005, sign=True), number(float("nan")), interval(-1, 2, 1)] == ["+1.00", "–", "[-1.0, 2.0]"]
    assert [is_number(text) for text in ("1", "-2e3", "nan", "inf", "[1]", "")] == [True, True, *[False] * 4]


def test_a_p_value_is_never_told_as_zero():
    assert [p_text(p) for p in (1.0, 0.05, 0.00005, 0.00004, 0.0, float("nan"))] == [
        *("1.0000", "0.0500", "0.0001", "<0.0001", "<0.0001", NOTHING)
    ]


def entries(quantities, arms):
    return [Entry(["net"], arm, {q: f"{q}{arm}" for q in quantities}) for arm in arms]


def test_no_table_has_more_columns_than_can_be_read():
    few, many = list("xy"), [f"c{number}" for number in range(27)]
    beside = arms_table(["setting"], "condition", entries(few, "ab"))
    assert (beside.columns, beside.rows[0]) == (["setting", "arm", "x", "y"], ["net", "a", "xa", "ya"])
    crossed = arms_table(["setting"], "condition", entries(many, "ab"))
    assert crossed.columns == ["setting", "condition", "a", "b"]
    assert [len(crossed.rows), crossed.rows[26]] == [27, ["net", "c26", "c26a", "c26b"]]
    long = arms_table(["setting"], "condition", entries(many, [f"arm{number}" for number in range(WIDEST + 1)]))
    assert long.columns == ["setting", "condition", "arm", "value"]
    assert len(long.rows) == 27 * (WIDEST + 1)
    gap = arms_table(["setting"], "condition", [*entries(many, "a"), *entries(many[:1], "b")])
    nothing = [Entry(["net"], arm, dict.fromkeys(many, NOTHING) | {"c3": "1"}) for arm in "ab"]
    assert arms_table(["setting"], "condition", nothing).rows == [["net", "c3", "1", "1"]]
    assert gap.rows[:2] == [["net", "c0", "c0a", "c0b"], ["net", "c1", "c1a", NOTHING]]


def test_a_report_is_the_same_to_the_byte_when_it_is_written_again(sweep):
    results, _ = sweep
    first = {path.name: path.read_bytes() for path in write_report(results)}
    assert {path.name: path.read_bytes() for path in write_report(results)} == first
    assert any(name.endswith(".svg") for name in first)


def test_the_test_behind_each_p_is_named(sweep):
    results, _ = sweep
    text = next(path for path in write_report(results) if path.name == "report.md").read_text()
    assert "p (Wilcoxon, Holm)" in text
    assert "p is of Wilcoxon's signed-rank test over pairs, two-sided, corrected by Holm" in text
    assert "Korn and Graubard's, for shares, which stays within 0 and 100" in text


def test_runs_of_calibration_are_compared_by_median_errors(tmp_path):
    rng = np.random.default_rng(1)
    cells, errors = [], {}
    for arm, scale in (("l2", 2.0), ("bearing", 1.0)):
        for pair in range(SEEDS):
            run = RunDirectory(tmp_path / "runs" / "calibration" / f"{arm}-s{pair}")
            cells.append(Cell({"task": "calibration"}, arm, pair, pair, arm, run.path.relative_to(tmp_path).as_posix()))
            run.path.mkdir(parents=True)
            found = scale * np.abs(rng.standard_cauchy(101))  # no mean, but a median
            found[:3] = np.nan
            errors[arm, pair] = np.median(np.where(np.isnan(found), np.inf, found))
            np.savez_compressed(run.arrays, **{f"{key}/network": found for key in CALIBRATION_ERRORS})
            write_json(run.metrics, {"outcome": "finished", "metrics": {}, "timing": {"fit_s": 1.0}, "parameters": 7})
    directory = SweepPlan("made_up", {}, ["sweep=made_up"], cells).write(tmp_path)
    results = sweep_results(directory)
    assert results.measure.better == "lower"
    row = next(row for row in contrasts(results) if row.condition == "tilt (deg)")
    expected = [errors["bearing", pair] - errors["l2", pair] for pair in range(SEEDS)]
    assert row.paired.mean == pytest.approx(np.mean(expected))
    low, high = stats.t.interval(0.95, SEEDS - 1, np.mean(expected), stats.sem(expected))
    assert (row.paired.low, row.paired.high) == pytest.approx((low, high))
    write_report(results)
    text = (directory / "report" / "report.md").read_text()
    assert "Median errors on the test split" in text
    assert "lower is better" in text


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (lambda arrays: arrays.unlink(), "cannot be read"),
        (lambda arrays: arrays.write_bytes(b""), "cannot be read"),
        (lambda arrays: arrays.write_bytes(arrays.read_bytes()[:300]), "cannot be read"),
        (lambda arrays: arrays.write_bytes(arrays.read_bytes()[:60] + bytes(20) + arrays.read_bytes()[80:]), "cannot"),
        (
            lambda arrays: np.savez_compressed(arrays, labels=np.zeros(4), clean=np.array([0, 0, 1, 1])),
            r"gives test/accuracy/clean=0\.5, metrics\.json says 0\.75",
        ),
    ],
)
def test_arrays_that_are_not_those_of_their_run_are_refused(tmp_path, damage, told):
    cells = []
    for pair in range(2):
        run = RunDirectory(tmp_path / "runs" / "classification" / f"a-{pair}")
        run.path.mkdir(parents=True)
        np.savez_compressed(run.arrays, labels=np.zeros(4), clean=np.array([0, 0, 0, 1]))
        metrics = {"test/accuracy/clean": 0.75}
        write_json(run.metrics, {"outcome": "finished", "metrics": metrics, "parameters": 1, "timing": {"fit_s": 1.0}})
        cells.append(Cell({}, "a", pair, pair, "a", f"runs/classification/a-{pair}"))
    directory = SweepPlan("s", {}, [], cells).write(tmp_path)
    assert [row.mean for row in summarise(sweep_results(directory))] == [75.0]
    damage(run.arrays)
    with pytest.raises(UserError, match=told) as caught:
        sweep_results(directory)
    assert str(run.arrays) in caught.value.problem
    assert caught.value.fix == f"Delete {run.path} and run the sweep again."
