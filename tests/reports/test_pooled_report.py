"""The pooled control of made-up runs, with numbers worked out by hand."""

import csv

import numpy as np
import pytest
from made_up_sweep import MadeUpRun, made_up_sweep
from scipy import stats

from sextant.evaluation import holm
from sextant.reports.pooled_report import TOGETHER, pooled_rows, pooled_section
from sextant.reports.sweep_report import write_report

DEFINITION = {
    "contrasts": {"effect": {"treatment": "b", "control": "a"}, "seeds": {"treatment": "twin", "control": "a"}},
    "noise_floor": "seeds",
}
#: wrong of 20 clean images, by setting and arm; one image is five points
CLEAN = {
    "small": {"a": [5, 6, 4], "twin": [7, 5, 6], "b": [3, 2, 1]},
    "large": {"a": [2, 2, 3], "twin": [1, 3, 2], "b": [2, 1, 3]},
}


@pytest.fixture
def sweep(tmp_path):
    arms = {
        arm: [
            *(MadeUpRun({"clean": n, "noise": n + 4}, protocol=None, setting=s) for s in CLEAN for n in CLEAN[s][arm]),
            *([MadeUpRun({"clean": 18, "noise": 18}, "diverged", protocol=None, setting="small")] * (arm == "a")),
        ]
        for arm in ("a", "b", "twin")
    }
    return made_up_sweep(tmp_path, arms, **DEFINITION)


def test_both_arms_of_the_noise_floor_are_the_control(sweep):
    rows = {(row.setting, row.condition): row for row in pooled_rows(sweep)}
    assert {row.contrast for row in rows.values()} == {"effect"}
    row = rows["small", "clean"]
    wrong = CLEAN["small"]
    expected = stats.ttest_ind(*(100 - 5 * np.array(w) for w in (wrong["b"], wrong["a"] + wrong["twin"])), equal_var=0)
    assert (row.treatment, row.control) == (3, 6)  # without the one that diverged
    assert row.difference.mean == pytest.approx(5 * (5.5 - 2))
    assert row.difference.p_value == pytest.approx(expected.pvalue)


def test_together_settings_count_the_same(sweep):
    rows = {(row.setting, row.condition): row for row in pooled_rows(sweep)}
    small, large, together = (rows[name, "clean"] for name in ("small", "large", TOGETHER))
    assert (together.treatment, together.control) == (6, 12)
    assert together.difference.mean == pytest.approx((small.difference.mean + large.difference.mean) / 2)
    raw = [rows[TOGETHER, condition].difference.p_value for condition in ("clean", "noise")]
    assert [rows[TOGETHER, condition].p_holm for condition in ("clean", "noise")] == pytest.approx(holm(raw))


@pytest.mark.slow
def test_the_report_has_its_table_and_the_value_of_every_run(sweep):
    paths = {path.name: path for path in write_report(sweep)}
    text = paths["report.md"].read_text()
    assert "## effect, pooled control: b minus a and twin" in text
    assert "Welch's t test over runs, two-sided; Holm's family is the conditions of one setting" in text
    assert "| together | clean | 6 | 12 | +9.17 |" in text
    rows = list(csv.DictReader(paths["seeds.csv"].open()))
    assert len(rows) == 2 * 19
    assert {row["outcome"] for row in rows} == {"finished", "diverged"}
    means = [float(row["mean"]) for row in csv.DictReader(paths["cells.csv"].open())]
    found = [float(r["value"]) for r in rows if (r["setting"], r["arm"], r["condition"]) == ("small", "b", "clean")]
    assert sorted(found) == pytest.approx([85, 90, 95])
    assert np.mean(found) in means
    assert len(list(csv.DictReader(paths["pooled.csv"].open()))) == 6


def test_without_a_noise_floor_there_is_none(tmp_path):
    runs = [MadeUpRun({"clean": n}) for n in (1, 2)]
    section = pooled_section(made_up_sweep(tmp_path, {"a": runs, "b": runs}))
    assert (section.text, section.files) == ("", {})
