"""Estimates of claims where a report was stored before a contrast was named, or before any run was made."""

import math

import numpy as np
import pytest

from sextant.config.schema.claims import ClaimPart
from sextant.errors import UserError
from sextant.reports.claim_evidence import NOT_RUN, evidence

HEAD = "setting,arm,pair,seed,outcome,condition,value"
ARMS = {"new": ["a", "b"]}


def stored(folder, rows, name="seeds.csv", head=HEAD):
    (folder / name).write_text("\n".join([head, *rows, ""]))
    return folder / "contrasts.csv"


def seeds(arm, values, *, condition="clean", outcome="finished", setting="-"):
    return [f"{setting},{arm},{pair},{pair},{outcome},{condition},{value}" for pair, value in enumerate(values)]


@pytest.fixture
def table(tmp_path):
    """A stored report of another contrast of the same arms."""
    head = "contrast,setting,condition,seeds,mean,spread,image_low,image_high"
    return stored(tmp_path, ["old,-,clean,3,1.0,0.5,nan,nan"], "contrasts.csv", head)


def told(path, names, arms=None, **more):
    return list(evidence(path, ClaimPart(sweep="demo", stored="-", table=path.stem, names=names, **more), arms))


def found(path, names=("new",), conditions=("clean",), arms=ARMS, **more):
    return [each.estimate for each in told(path, list(names), arms, conditions=list(conditions), **more)]


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("count", [2, 3, 8, 30])
def test_a_contrast_that_was_not_stored_follows_from_the_seeds(table, count, down):
    """From two pairs up, in both directions, in any order of rows."""
    rng = np.random.default_rng(count)
    a, b = rng.normal(5, 1, count), rng.normal(4, 1, count)
    stored(table.parent, [*reversed(seeds("a", a)), *seeds("b", b), *seeds("a", a + 9, condition="fog")])
    (estimate,) = found(table, direction="down" if down else "up")
    pairs = (b - a) if down else (a - b)
    assert estimate.mean == pytest.approx(pairs.mean())
    assert estimate.error == pytest.approx(pairs.std(ddof=1) / math.sqrt(count))
    assert (estimate.seeds, estimate.learnt) == (count, True)


def test_of_worlds_with_several_seeds_the_world_is_the_replicate(table):
    """Four worlds of four seeds each, with effects of 6, 7, 8 and -3: not shown to be better, as one world differs."""
    rng, rows = np.random.default_rng(0), []
    for world, effect in enumerate((6.0, 7.0, 8.0, -3.0)):
        for seed in range(4):
            values = rng.normal((effect, 0.0), 0.1)
            pair = 4 * world + seed
            rows += [
                f"-,{arm},{pair},{seed},finished,clean,{value},{world}" for arm, value in zip("ab", values, strict=True)
            ]
    stored(table.parent, rows, head=f"{HEAD},world")
    (estimate,) = found(table)
    assert (estimate.seeds, estimate.replicate) == (4, "worlds")
    assert estimate.mean == pytest.approx(4.5, abs=0.2)
    assert estimate.interval()[0] < 0


def test_pairs_lacking_a_run_or_diverged_do_not_count_and_one_pair_has_no_error(table):
    stored(table.parent, [*seeds("a", [3, 5]), *seeds("b", [1]), *seeds("b", [9, 9], outcome="diverged")])
    (estimate,) = found(table)
    assert (estimate.mean, estimate.seeds) == (2.0, 1)
    assert math.isnan(estimate.error)


@pytest.mark.parametrize("there", [[], seeds("a", [1, 2]), seeds("b", [1, 2]), seeds("c", [1, 2])])
def test_without_runs_of_both_arms_a_comparison_is_not_run(table, there):
    stored(table.parent, there)
    assert found(table) == [NOT_RUN]
    assert found(table)[0] is NOT_RUN


def test_figures_of_a_command_say_what_their_replicates_are_and_wait_for_their_run(tmp_path):
    table = tmp_path / "recorded.csv"
    head = "name,seeds,replicate,mean,low,high,against"
    table.write_text(f"{head}\nx,4,worlds,80,70,90,0\ny,counted,,0,,,0\nz,4,days,1,0,2,0\n")
    worlds, exact = (each.estimate for each in told(table, ["x", "y"]))
    assert (worlds.replicate, worlds.seeds, worlds.interval()) == ("worlds", 4, (70, 90))
    assert exact.counted
    with pytest.raises(UserError, match="replicate=days must be seeds, worlds"):
        told(table, ["z"])
    (waiting,) = told(tmp_path / "not_run" / "recorded.csv", ["x"])
    assert waiting.estimate is NOT_RUN


@pytest.mark.parametrize("name", ["contrasts.csv", "differences.csv", "cells.csv", "cost.csv", "pooled.csv"])
def test_without_a_stored_report_every_comparison_is_not_run(tmp_path, name):
    against = 1.0 if name == "cells.csv" else "z"
    path, conditions = tmp_path / "gone" / name, ["clean", "fog"]
    waiting = told(path, ["x", "y"], ARMS, conditions=conditions, quantity="q", against=against)
    assert all(each.estimate is NOT_RUN for each in waiting)
    assert [each.label for each in waiting] == (
        ["x", "y"] if name == "cost.csv" else ["x, clean", "x, fog", "y, clean", "y, fog"]
    )


def test_what_is_recorded_is_never_missing_in_silence(tmp_path):
    with pytest.raises(UserError, match=r"recorded\.csv is not there"):
        told(tmp_path / "recorded.csv", ["x"])


def test_a_condition_that_was_not_tested_is_an_error_and_so_are_seeds_that_are_lost(table):
    stored(table.parent, [*seeds("a", [1, 2]), *seeds("b", [1, 2])])
    with pytest.raises(UserError, match=r"has no pair of a and b, setting=- condition=fog"):
        found(table, conditions=["fog"])
    with pytest.raises(UserError, match=r"has no row contrast=old setting=- condition=fog"):
        found(table, names=["old"], conditions=["fog"])
    (table.parent / "seeds.csv").unlink()
    with pytest.raises(UserError, match=r"seeds\.csv is not there"):
        found(table)


def test_a_stored_table_without_a_row_is_damaged_and_not_one_of_runs_to_come(table):
    stored(table.parent, seeds("a", [1, 2]))
    table.write_text(table.read_text().splitlines()[0])
    with pytest.raises(UserError, match=r"has no row contrast=new"):
        found(table)


def test_a_difference_is_of_the_metric_that_is_named(tmp_path):
    head = "contrast,setting,condition,metric,seeds,mean,spread,low,high,replicate"
    rows = [f"new,-,clean,{metric},8,{mean},0.1,0,0,worlds" for metric, mean in (("error", -0.2), ("nll", 3.0))]
    path = stored(tmp_path, rows, "differences.csv", head).with_name("differences.csv")
    (estimate,) = found(path, arms=None, quantity="error", direction="down")
    assert (estimate.mean, estimate.seeds, estimate.replicate) == (0.2, 8, "worlds")
    with pytest.raises(UserError, match="has no row contrast=new setting=- condition=clean metric=gone"):
        found(path, arms=None, quantity="gone")


POOLED = "contrast,setting,condition,treatment,control,mean,low,high,freedom,p_value,p_holm"


@pytest.mark.parametrize(("setting", "seeds"), [("net", 20), ("other", 9), ("together", 9)])
def test_seeds_of_a_pooled_comparison_are_those_of_its_smallest_group(tmp_path, setting, seeds):
    rows = [
        "new,net,clean,20,30,2,1,3,40,0,0", "new,other,clean,40,9,2,1,3,12,0,0",
        "new,together,clean,60,39,2,1,3,30,0,0",
        "new,net,fog,3,3,2,1,3,4,0,0", "old,net,clean,2,30,2,1,3,4,0,0",
    ]  # fmt: skip
    path = stored(tmp_path, rows, "pooled.csv", POOLED).with_name("pooled.csv")
    (estimate,) = found(path, settings=[setting])
    assert estimate.seeds == seeds


def test_pooled_runs_that_are_all_alike_are_bounded_by_how_many_there_are(tmp_path):
    rows = ["new,-,clean,8,16,10,10,10,inf,0,0"]
    (estimate,) = found(stored(tmp_path, rows, "pooled.csv", POOLED).with_name("pooled.csv"))
    assert (estimate.mean, estimate.seeds, estimate.alike) == (10, 8, True)


def test_replicates_that_are_alike_but_for_rounding_are_alike(tmp_path):
    """NumPy's standard deviation of equal values need not be 0."""
    spread = np.full(11, 100 - 36.3).std(ddof=1)
    assert spread > 0
    head = "contrast,setting,condition,seeds,mean,spread,image_low,image_high"
    (estimate,) = found(stored(tmp_path, [f"new,-,clean,11,63.7,{spread},nan,nan"], "contrasts.csv", head))
    assert estimate.alike
