"""Reports of made-up runs of localizers, with numbers worked out by hand."""

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.atomic_files import write_json
from sextant.chapters.localization.measure import SUCCESS, localized
from sextant.evaluation.particle_counts import needed_ratio, particles_needed
from sextant.evaluation.success import share_of
from sextant.lifecycle.results import sweep_results
from sextant.reports.cell_tables import cells_table
from sextant.reports.contrasts import contrasts
from sextant.reports.particles_report import (
    POOLED,
    arm_curves,
    particle_ratios,
    particles_section,
    ratio_table,
)
from sextant.reports.section import summarise
from sextant.reports.sweep_report import write_report
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan

RUNS = 20
CONTRAST = {"contrasts": {"vision_laser": {"treatment": "vision", "control": "laser"}}}


def run_arrays(successes):
    """Arrays of a run: of each trial the first runs succeed."""
    arrays = {}
    for trial, count in successes.items():
        arrays[f"success/{trial}"] = (np.arange(RUNS) < count).astype(np.float64)
        arrays[f"converged/{trial}"] = np.where(np.arange(RUNS) < count, 3, -1)
        arrays[f"position_error/{trial}"] = np.full((RUNS, 5), 0.25, np.float32)
    return arrays


def sweep_of(folder, arms, **definition):
    """The results of a sweep; ``arms`` gives of each arm the successes of its seeds, or (successes, outcome)."""
    cells = []
    for arm, runs in arms.items():
        for pair, run in enumerate(runs):
            successes, outcome = run if isinstance(run, tuple) else (run, "finished")
            directory = RunDirectory(folder / "runs" / "localization" / f"{arm}-{pair}")
            cells.append(Cell({}, arm, pair, pair, arm, directory.path.relative_to(folder).as_posix()))
            directory.path.mkdir(parents=True)
            np.savez_compressed(directory.arrays, **run_arrays(successes))
            facts = {"success_protocol": {"position": 0.5, "unit": "m", "heading_deg": 10.0, "frames": 10}}
            timing = {"fit_s": 1.0}
            write_json(
                directory.metrics, {"outcome": outcome, "metrics": {}, "parameters": 5, "timing": timing} | facts
            )
    return sweep_results(SweepPlan("made_up", definition, [], cells).write(folder))


def by_count(condition, *successes, counts=(25, 100, 400)):
    return {f"{condition}, {count} particles": found for count, found in zip(counts, successes, strict=True)}


@pytest.fixture
def sweep(tmp_path):
    """By day vision needs 100 particles and laser 400; by night vision needs 400, and laser more than were tried.

    Seed 2 of the laser diverged, and would have succeeded always.
    """
    day, night = "summer_noon", "night_clear, kidnap"
    vision = {**by_count(day, 10, 20, 20), **by_count(night, 2, 10, 20)}
    laser = {**by_count(day, 2, 10, 20), **by_count(night, 0, 2, 18)}
    perfect = {**by_count(day, 20, 20, 20), **by_count(night, 20, 20, 20)}
    return sweep_of(tmp_path, {"vision": [vision] * 3, "laser": [laser, laser, (perfect, "diverged")]}, **CONTRAST)


def test_the_measure_is_success_of_runs_in_per_cent():
    found = localized(run_arrays({"run2/summer_noon": 15, "night_clear, kidnap": 0}))
    assert found.measure is SUCCESS
    assert list(found.by_condition) == ["run2/summer_noon", "night_clear, kidnap"]
    assert found.measure.of(found.by_condition["run2/summer_noon"]) == 75
    assert found.measure.of(found.by_condition["night_clear, kidnap"]) == 0


def test_cells_and_contrasts_are_of_success(sweep):
    cells = cells_table(summarise(sweep), sweep)
    night = cells.columns.index("night_clear, kidnap, 100 particles")
    assert [row[night].split(" ")[0] for row in cells.rows] == ["50.0", "10.0"]
    rows = {row.condition: row for row in contrasts(sweep)}
    paired = rows["summer_noon, 100 particles"].paired
    assert (paired.mean, paired.seeds, paired.wins) == (pytest.approx(50), 2, 2)
    assert rows["summer_noon, 100 particles"].dropped == 1


def test_names_of_drives_with_a_stroke_are_no_severities(tmp_path):
    results = sweep_of(tmp_path, {"a": [{"run2/night": 4}] * 2, "b": [{"run2/night": 9}] * 2})
    report = next(path for path in write_report(results) if path.name == "report.md").read_text()
    assert "run2/night" in report
    assert "Success by number of particles" not in report  # only one number was tried
    assert particles_section(results).files == {}


def test_curves_are_those_of_converged_runs_pooled_over_seeds(sweep):
    curves = {(curve.arm, curve.condition): curve for curve in arm_curves(sweep)}
    night = curves["laser", "night_clear, kidnap"]
    assert night.pooled.shape == (3, 2 * RUNS)
    assert [share.count for share in night.shares] == [0, 4, 36]
    assert night.shares[1] == share_of(np.arange(40) < 4)
    assert night.needed == np.inf
    assert night.told == "> 400"
    assert [curves["vision", c].needed for c in ("summer_noon", "night_clear, kidnap", POOLED)] == [100, 400, 400]
    # all conditions: 40 runs a seed, of which 20 + 18 = 95 % succeed at 400
    assert curves["laser", POOLED].pooled.mean(axis=1) == pytest.approx([2 / 40, 12 / 40, 38 / 40])
    assert curves["laser", POOLED].needed == 400


def test_ratios_and_what_is_known_of_censored_ones(sweep):
    rows = {row.condition: row for row in particle_ratios(sweep)}
    day, night = rows["summer_noon"], rows["night_clear, kidnap"]
    assert (day.ratio.least, day.ratio.most, day.ratio.censored) == (0.25, 0.25, 0)
    assert (night.ratio.least, night.ratio.most, night.ratio.censored) == (0, 1, 1)
    assert (day.pairs, day.dropped) == (2, 1)
    table = ratio_table(list(rows.values()), "seeds")
    told = {row[2]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert told["summer_noon"]["ratio"] == "0.25"
    assert told["night_clear, kidnap"]["ratio"] == "at most 1.00"
    assert told["night_clear, kidnap"]["95 % over seeds"] == "[0.00, 1.00], 100 % censored"
    assert told["night_clear, kidnap"]["N95 of the control"] == "> 400"


def test_without_a_converged_pair_nothing_is_said_of_the_ratio(tmp_path):
    runs = by_count("day", 1, 2, 3)
    results = sweep_of(tmp_path, {"vision": [(runs, "diverged")], "laser": [runs]}, **CONTRAST)
    (row,) = particle_ratios(results)
    assert (row.ratio, row.pairs, row.dropped) == (None, 0, 1)
    assert ratio_table([row], "worlds").rows[0][3:] == ["–", "–", "–", "–", "0", "1"]


def test_the_report_has_the_section_its_files_and_figures(sweep):
    paths = {path.name: path for path in write_report(sweep)}
    report = paths["report.md"].read_text()
    assert "## Success, per cent of the runs along the test drives" in report
    assert "on the same test runs along drives; higher is better" in report
    assert "![success by number of particles](success_curves.png)" in report
    assert report.index("## Success by number of particles") < report.index("## Cost")
    names = {"success_curves.png", "success_curves_summer_noon.svg", "success_curves_night_clear_kidnap.png"}
    assert names <= set(paths)
    rows = list(csv.DictReader(paths["particles.csv"].open()))
    assert len(rows) == 2 * 3 * 3  # arms, curves, counts
    assert {row["needed"] for row in rows if row["arm"] == "laser"} == {"400.0", "inf"}
    ratios = list(csv.DictReader(paths["particles_needed.csv"].open()))
    assert [float(row["most"]) for row in ratios] == [1.0, 0.25, 1.0]


def test_arms_may_try_other_numbers(tmp_path):
    laser = by_count("day", 1, 2, 20, counts=(400, 800, 1600))
    results = sweep_of(tmp_path, {"vision": [by_count("day", 1, 19, 20)] * 2, "laser": [laser] * 2}, **CONTRAST)
    ratios = {row.condition: row.ratio for row in particle_ratios(results)}
    assert ratios["day"].least == ratios["day"].most == 100 / 1600
    assert "–" in particles_section(results).text


def test_runs_of_a_seed_are_drawn_together():
    """Of two seeds one fails wholly at 10: half of the resamples of single runs would never say so."""
    mixed = np.array([[[True] * 50, [False] * 50], [[True] * 50, [True] * 50]])
    counts, always = np.array([10, 100]), np.ones((2, 2, 50), bool)
    ratio = needed_ratio((counts, mixed), (counts, always))
    assert (ratio.least, ratio.low, ratio.high) == (10, 1, 10)  # (seed 0, seed 0) is a quarter of the resamples


@given(st.integers(0, 2**20), st.integers(1, 4))
def test_a_ratio_is_within_its_interval_and_one_to_itself(bits, seeds):
    rng = np.random.default_rng(bits)
    counts = np.array([10, 30, 90])
    methods = [(counts, rng.random((3, seeds, 5)) < rng.random()) for _ in range(2)]
    ratio = needed_ratio(*methods, resamples=50)
    assert ratio.least <= ratio.most
    assert ratio.low <= ratio.high
    same = needed_ratio(methods[0], methods[0], resamples=20)
    assert same.least == same.most == 1 or np.isinf(particles_needed(counts, methods[0][1].reshape(3, -1)))
