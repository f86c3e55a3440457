"""Arms that read one of the methods of their runs, and arms that share a run."""

import re

import numpy as np
import pytest

from sextant.atomic_files import write_json
from sextant.errors import UserError
from sextant.kit.measure import require_answers
from sextant.lifecycle.results import sweep_results
from sextant.reports.contrasts import contrasts
from sextant.reports.sweep_report import write_report
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan

IMAGES, SEEDS = 300, 8
LABELS = np.arange(IMAGES) % 5
LEVELS = {"cosfire_svm": 0.9, "full_svm": 0.8, "nearest": 0.7}
#: the first two arms read the answers of the same runs, the third those of others
ARMS = {
    "filters": {"overrides": ["bank=vectors"], "reads": "cosfire_svm"},
    "paper": {"overrides": ["bank=vectors"], "reads": "full_svm"},
    "gabor": {"overrides": ["bank=gabor"], "reads": "cosfire_svm"},
}
CONTRASTS = {
    "filters against the paper's": {"treatment": "filters", "control": "paper"},
    "gabor against vectors": {"treatment": "gabor", "control": "filters"},
}


def arrays(seed, conditions):
    rng = np.random.default_rng(seed)
    found = {"labels": LABELS}
    for method, level in LEVELS.items():
        right = rng.random(IMAGES) < level
        found[f"answer/{method}"] = np.where(right, LABELS, (LABELS + 1) % 5)
    if conditions:
        night = np.arange(IMAGES) % 3 == 0
        found |= {"condition/night": night, "condition/rain": ~night}
    return found


def sweep(folder, arms=ARMS, conditions=False):
    cells, known = [], {}
    for arm, chosen in arms.items():
        (bank,) = chosen["overrides"]
        for pair in range(SEEDS):
            run = RunDirectory(folder / "runs" / "cosfire" / f"{bank[5:]}-s{pair}")
            cells.append(Cell({}, arm, pair, pair, bank[5:], run.path.relative_to(folder).as_posix()))
            if run.path.exists():
                continue
            run.path.mkdir(parents=True)
            known[bank[5:], pair] = arrays(len(known), conditions)
            np.savez_compressed(run.arrays, **known[bank[5:], pair])
            write_json(run.metrics, {"outcome": "finished", "metrics": {}, "timing": {"fit_s": 1.0}, "parameters": 7})
    definition = {"question": "Which?", "arms": arms, "contrasts": CONTRASTS}
    return sweep_results(SweepPlan("made_up", definition, [], cells).write(folder)), known


def share(found, method, rows=slice(None)):
    return 100 * (found[f"answer/{method}"] == LABELS)[rows].mean()


def test_an_arm_counts_the_answers_that_it_reads(tmp_path):
    results, known = sweep(tmp_path)
    assert results.conditions == ["test"]
    for arm, bank, method in (("filters", "vectors", "cosfire_svm"), ("paper", "vectors", "full_svm")):
        for cell in results.of("-", arm):
            assert cell.value("test") == pytest.approx(share(known[bank, cell.cell.pair], method))


def test_contrasts_are_paired_by_run_and_image(tmp_path):
    results, known = sweep(tmp_path)
    rows = {row.contrast: row for row in contrasts(results)}
    within = [share(known["vectors", p], "cosfire_svm") - share(known["vectors", p], "full_svm") for p in range(SEEDS)]
    row = rows["filters against the paper's"]
    assert row.paired.mean == pytest.approx(np.mean(within))
    assert row.paired.spread == pytest.approx(np.std(within, ddof=1))
    assert (row.paired.seeds, row.dropped) == (SEEDS, 0)
    between = [
        share(known["gabor", p], "cosfire_svm") - share(known["vectors", p], "cosfire_svm") for p in range(SEEDS)
    ]
    assert rows["gabor against vectors"].paired.mean == pytest.approx(np.mean(between))


def test_places_are_compared_under_each_light(tmp_path):
    results, known = sweep(tmp_path, conditions=True)
    assert results.conditions == ["night", "rain"]
    night = np.arange(IMAGES) % 3 == 0
    rows = {(row.contrast, row.condition): row for row in contrasts(results)}
    expected = np.mean([
        share(known["vectors", p], "cosfire_svm", night) - share(known["vectors", p], "full_svm", night)
        for p in range(SEEDS)
    ])  # fmt: skip
    assert rows["filters against the paper's", "night"].paired.mean == pytest.approx(expected)


def test_without_reading_the_conditions_are_the_methods(tmp_path):
    arms = {name: {"overrides": arm["overrides"]} for name, arm in ARMS.items()}
    results, known = sweep(tmp_path, arms)
    assert results.conditions == list(LEVELS)
    first = next(cell for cell in results.cells if cell.cell.arm == "gabor")
    assert first.value("nearest") == pytest.approx(share(known["gabor", 0], "nearest"))


def test_a_report_is_written(tmp_path):
    results, _ = sweep(tmp_path)
    write_report(results)
    text = (results.directory / "report" / "report.md").read_text()
    assert "Accuracy on the test split, per cent" in text
    assert "filters against the paper's" in text


@pytest.mark.parametrize(
    ("found", "says"),
    [
        (arrays(0, conditions=False), "reads the answers of tuned; its runs have those of cosfire_svm, full_svm"),
        ({"labels": LABELS, "clean": LABELS}, "reads the answers of tuned; its runs have those of one method alone"),
    ],
)
def test_answers_that_there_are_not(found, says):
    with pytest.raises(UserError, match=re.escape(says)):
        require_answers(found, "tuned")
