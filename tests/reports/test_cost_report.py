"""The cost table of made-up runs."""

import pytest
from made_up_sweep import MadeUpRun, made_up_sweep

from sextant.reports.cost_report import cost_section, cost_table, reference_arm

WRONG = {"clean": 1}
PLAIN = {"multiplications": 40_000_000, "pull_multiplications": 0, "inhibition": {}}
PUSH_PULL = {"multiplications": 42_000_000, "pull_multiplications": 2_000_000, "inhibition": {"conv1": "direct"}}


def runs(seconds, cost=None, **other):
    return [MadeUpRun(WRONG, cost=cost, seconds=value, **other) for value in seconds]


def test_costs_are_relative_to_the_control(tmp_path):
    arms = {"pp": runs([12, 30, 15], PUSH_PULL), "conv": runs([10, 9, 11], PLAIN)}
    contrasts = {"effect": {"treatment": "pp", "control": "conv"}}
    results = made_up_sweep(tmp_path, arms, contrasts=contrasts)
    assert reference_arm(results) == "conv"
    first, second = (dict(zip(range(20), row, strict=False)) for row in cost_table(results).rows)
    assert list(first.values()) == [
        *("net", "pp", "1,234", "42.00", "1.050", "2.00", "conv1: direct"),
        *("3", "15.0", "12.0 to 30.0", "1.50"),
    ]
    assert list(second.values())[3:] == ["40.00", "1.000", "0.00", "–", "3", "10.0", "9.0 to 11.0", "1.00"]


def test_runs_that_did_not_train_have_no_time_and_runs_that_do_not_say_no_multiplications(tmp_path):
    arms = {"a": runs([0.0, float("nan")]), "b": runs([4.0, 6.0])}
    results = made_up_sweep(tmp_path, arms)
    table = cost_table(results)
    assert "multiplications (M)" not in table.columns
    assert table.rows == [
        ["net", "a", "1,234", "0", "–", "–", "–"],
        ["net", "b", "1,234", "2", "5.0", "4.0 to 6.0", "–"],
    ]
    assert reference_arm(results) == "a"


@pytest.mark.parametrize("outcome", ["finished", "diverged"])
def test_a_diverged_run_took_its_time_too(tmp_path, outcome):
    results = made_up_sweep(tmp_path, {"a": runs([4.0], PLAIN), "b": runs([8.0], PLAIN, outcome=outcome)})
    assert cost_table(results).rows[1][-1] == "2.00"


def test_the_section_names_the_reference_and_is_kept_as_a_file(tmp_path):
    section = cost_section(made_up_sweep(tmp_path, {"a": runs([4.0], PLAIN)}))
    assert section.text.startswith("## Cost\n\nRatios are to *a*.")
    assert section.files["cost.csv"].startswith("setting,arm,parameters,multiplications (M),")
