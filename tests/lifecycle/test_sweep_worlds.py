"""Worlds as the replicates of a sweep: how they are planned, and how a report averages within them."""

import csv

import numpy as np
import pytest
from scipy import stats

from sextant.atomic_files import write_json
from sextant.cli.report import _show
from sextant.config.schema.claims import ClaimPart
from sextant.config.schema.sweeps import Sweep
from sextant.errors import UserError
from sextant.lifecycle.results import load_results, sweep_results
from sextant.lifecycle.sweep_plan import make_plan, read_design
from sextant.reports.claim_evidence import evidence
from sextant.reports.contrasts import contrasts
from sextant.reports.page.report_page import write_report_page
from sextant.reports.sweep_page import Progress, sweep_page
from sextant.reports.sweep_report import write_report
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan

RECOVERY = ["sweep=recovery", "dataset.fit_world=0"]


@pytest.mark.slow
def test_several_worlds_are_replicates_and_no_factor(tmp_path):
    design = read_design([*RECOVERY, "dataset.world=1,2,3", "seed=0,1"])
    assert (design.worlds, design.seeds) == ([f"dataset.world={n}" for n in (1, 2, 3)], [0, 1])
    assert design.factors == {}
    assert design.runs == 3 * 2 * len(design.arms)
    plan, planned, _ = make_plan([*RECOVERY, "dataset.world=1,2", "seed=0,1", f"paths.outputs={tmp_path}"])
    first = [entry for entry in planned if entry.cell.arm == "none"]
    assert [(e.cell.world, e.cell.seed, e.cell.pair) for e in first] == [
        ("1", 0, 0),
        ("1", 1, 1),
        ("2", 0, 2),
        ("2", 1, 3),
    ]
    assert len({cell.run for cell in plan.cells}) == 4 * len(design.arms)
    assert all(f"dataset.world={e.cell.world}" in e.overrides for e in planned)


def test_a_sweep_without_worlds_is_planned_as_before():
    design = read_design(["sweep=recovery"])
    assert (design.worlds, design.runs) == ([""], 10 * 6)
    assert read_design(["sweep=recovery", "dataset.world=3"]).worlds == [""]  # one world is a setting of all runs


def test_sources_of_real_data_are_worlds(monkeypatch):
    sweep = Sweep.model_validate({"name": "own", "worlds": {"dataset": ["gardens_point", "sped"]}})
    assert sweep.worlds == {"dataset": ["gardens_point", "sped"]}


@pytest.mark.parametrize(
    ("worlds", "said"),
    [
        ({"dataset.world": [1]}, "at least 2"),
        ({"dataset.world": [1, 1]}, "worlds must differ"),
        ({"dataset.world": [1, "1"]}, "worlds must differ"),
        ({"dataset.world": [1, 2], "dataset": ["a", "b"]}, "at most 1"),
    ],
)
def test_worlds_that_are_none_are_refused(worlds, said):
    with pytest.raises(ValueError, match=said):
        Sweep.model_validate({"name": "own", "worlds": worlds})


def test_a_world_twice_on_the_command_line_is_refused():
    with pytest.raises(UserError, match=r"dataset.world=1,1: worlds must differ"):
        read_design([*RECOVERY, "dataset.world=1,1"])


def finished(folder, values, worlds, seeds, images=20, started=1.8e9):
    """A sweep of two arms; ``values`` gives how many images are right of each arm, world and seed."""
    cells = []
    for arm, right in zip("ab", values, strict=True):
        for pair, (world, seed) in enumerate((w, s) for w in range(worlds) for s in range(seeds)):
            run = RunDirectory(folder / "runs" / "classification" / f"{arm}-{pair}")
            count = right[world][seed]
            cells.append(Cell({}, arm, pair, seed, arm, run.path.relative_to(folder).as_posix(), world=str(world + 1)))
            run.path.mkdir(parents=True)
            if count is None:
                continue
            labels = np.arange(images) % 10
            found = np.where(np.arange(images) < count, labels, (labels + 1) % 10)
            np.savez_compressed(run.arrays, labels=labels.astype(np.uint8), clean=found.astype(np.uint8))
            write_json(run.path / "run.json", {"started": started + pair})
            timing = {"fit_s": 1.0}
            write_json(run.metrics, {"outcome": "finished", "metrics": {}, "parameters": 5, "timing": timing})
    definition = {"contrasts": {"effect": {"treatment": "a", "control": "b"}}, "worlds": {"dataset.world": [1, 2, 3]}}
    return sweep_results(SweepPlan("worlds", definition, [], cells).write(folder))


RIGHT = ([[18, 16], [12, 14], [19, 17]], [[14, 14], [11, 13], [13, 13]])


def test_seeds_are_averaged_within_a_world_and_intervals_are_over_worlds(tmp_path, capsys):
    results = finished(tmp_path, RIGHT, worlds=3, seeds=2)
    (row,) = contrasts(results)
    differences = 100 * (np.mean(RIGHT[0], axis=1) - np.mean(RIGHT[1], axis=1)) / 20
    low, high = stats.t.interval(0.95, 2, differences.mean(), stats.sem(differences))
    assert (row.paired.seeds, row.paired.mean) == (3, pytest.approx(differences.mean()))
    assert (row.paired.low, row.paired.high) == pytest.approx((low, high))
    assert np.isnan(row.paired.image_low)  # each world has its own images
    assert not row.exploratory  # three worlds are enough
    assert len(load_results(results.directory, tmp_path)) == 12  # a row for each run
    report = {path.name: path for path in write_report(results)}
    text = report["report.md"].read_text()
    assert all(each in text for each in ("6 in 3 worlds a cell", "paired by world", "95 % over worlds"))
    assert "over seeds" not in text
    assert "over seeds" not in write_report_page(results, tmp_path).read_text()
    (stored,) = csv.DictReader(report["contrasts.csv"].open())
    assert (stored["seeds"], stored["replicate"]) == ("3", "worlds")
    assert {line["world"] for line in csv.DictReader(report["seeds.csv"].open())} == {"1", "2", "3"}
    assert report["dates.csv"].read_text() == (
        "first_run,last_run\n2027-01-15T08:00:00+00:00,2027-01-15T08:00:05+00:00\n"
    )
    part = ClaimPart(sweep="demo", stored="demo", names=["effect"], conditions=["clean"])
    (found,) = evidence(report["contrasts.csv"], part)
    assert (found.estimate.replicate, found.estimate.seeds) == ("worlds", 3)
    assert "95 % over worlds" in sweep_page(results.plan, Progress(12, 12), results, tmp_path)[0]
    _show(results)
    assert "worlds" in capsys.readouterr().out


def test_as_many_seeds_as_there_are_make_no_world_count_more(tmp_path):
    """Twice the same seeds: the interval stays, where runs as replicates would narrow it."""
    once = finished(tmp_path / "once", [[[r[0]] for r in arm] for arm in RIGHT], worlds=3, seeds=1)
    twice = finished(tmp_path / "twice", [[[r[0]] * 2 for r in arm] for arm in RIGHT], worlds=3, seeds=2)
    (first,), (second,) = contrasts(once), contrasts(twice)
    assert (first.paired.low, first.paired.high) == pytest.approx((second.paired.low, second.paired.high))


def test_a_world_with_a_missing_run_is_left_out_and_counted(tmp_path):
    values = ([[18, 16], [12, None], [19, 17]], RIGHT[1])
    (row,) = contrasts(finished(tmp_path, values, worlds=3, seeds=2))
    assert (row.paired.seeds, row.dropped, row.exploratory) == (2, 1, True)
