"""Designs of claims: what they can show follows from theory, they can be composed, and dates tell what runs are."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from sextant import cli
from sextant.composing.overrides import parse
from sextant.config.schema.claims import Claim
from sextant.evaluation.verdict import POWER, Estimate, power
from sextant.lifecycle import claims as life
from sextant.lifecycle.claim_files import read_claims
from sextant.lifecycle.claim_plan import plan_claims
from sextant.lifecycle.claims import BEGUN, DIGESTS, Tables, decide_claims, design_arguments, renew_digests

RESULTS = Path(__file__).parents[2] / "results"
CLAIMS = read_claims()
DATE, BEFORE, AFTER = (f"2026-11-28T{hour}:00:00+00:00" for hour in ("12", "11", "13"))
CLAIM = {
    "date": DATE, "chapter": 7, "sentence": "Push-pull helps on digit scans.", "published": "nothing", "page": "x.md",
    "unit": "points of accuracy", "matters": 1.0, "reason": "one image in a hundred", "not_covered": "all but digits",
    "runs": "none",
    "design": {
        "replicate": "seeds", "core_hours": 0.5, "effect": 3.0,
        "overrides": ["backbone=lenet_a", "seed=0,1,2,3,4,5,6,7"],
    },
    "parts": [
        {"sweep": "demo", "stored": "demo", "names": ["effect"], "settings": ["lenet_a"], "conditions": ["clean"]}
    ],
}  # fmt: skip


def stored(folder, mean=3.0, spread=1.0, seeds=8, date="", baseline=None, high=90.0):
    """A stored table of one contrast, with the cells of its arms, and what is known of its runs."""
    (folder / "demo").mkdir(exist_ok=True)
    (folder / "claims").mkdir(exist_ok=True)
    head = "contrast,setting,condition,seeds,mean,spread,image_low,image_high,floor_mean"
    (folder / "demo" / "contrasts.csv").write_text(f"{head}\neffect,lenet_a,clean,{seeds},{mean},{spread},nan,nan,\n")
    cells = [f"lenet_a,{arm},clean,80,{high}" for arm in ("conv", "push_pull")]
    (folder / "demo" / "cells.csv").write_text("\n".join(["setting,arm,condition,low,high", *cells, ""]))
    if baseline is not None:
        (folder / "demo" / "baselines.csv").write_text(f"setting,condition,value,better\nlenet_a,clean,{baseline}\n")
    (folder / DIGESTS).touch()
    if date:
        (folder / "demo" / "dates.csv").write_text(f"first_run,last_run\n{date},{date}\n")
    return folder


def claim(**changes):
    return {"demo": Claim.model_validate(CLAIM | changes)}


def test_a_plan_is_what_theory_says(tmp_path):
    (plan,) = plan_claims(claim(), Tables(stored(tmp_path)))
    runs = 3 * 8  # conv, the same for the noise floor, and push_pull, at eight seeds
    assert (plan.number, plan.seeds, plan.runs, plan.core_hours) == (8, 1, runs, 0.5 * runs)
    assert plan.spread == pytest.approx(1.0)
    assert plan.power == pytest.approx(stats.nct.sf(stats.t.ppf(0.975, 7), 7, 2.0 * math.sqrt(8)))
    assert power(plan.detectable - 1.0, 1.0, 8) == pytest.approx(POWER)
    assert power(2.0, 1.0, plan.needed) >= POWER > power(2.0, 1.0, plan.needed - 1)


@pytest.mark.parametrize("effect", [0.0, 0.6])
def test_a_plan_to_show_that_nothing_differs_clears_both_borders(tmp_path, effect):
    part = CLAIM["parts"][0] | {"expects": "same"}
    asked = claim(parts=[part], matters=1.0, design=CLAIM["design"] | {"effect": effect})
    (plan,) = plan_claims(asked, Tables(stored(tmp_path)))
    rng = np.random.default_rng(0)

    def shown(count, within=1.0, effect=effect):
        drawn = rng.normal(effect, 1.0, (20_000, count))
        half = stats.t.ppf(0.975, count - 1) * drawn.std(axis=1, ddof=1) / math.sqrt(count)
        return (np.abs(drawn.mean(axis=1)) + half < within).mean()

    assert plan.power == pytest.approx(shown(8), abs=0.02)
    assert shown(plan.needed) == pytest.approx(POWER, abs=0.04)
    assert shown(8, plan.detectable, 0.0) == pytest.approx(POWER, abs=0.03)


def test_the_spread_between_worlds_is_taken_to_be_that_between_seeds(tmp_path):
    design = CLAIM["design"] | {"replicate": "worlds", "overrides": ["dataset.world=1,2,3,4", "seed=0,1"]}
    plain = {"sweep": "recovery", "names": ["bayes_restart"], "stored": "demo", "settings": ["-"]}
    (tmp_path / "demo").mkdir()
    table = "contrast,setting,condition,seeds,mean,spread\nbayes_restart,-,test,8,30,10\n"
    (tmp_path / "demo" / "contrasts.csv").write_text(table)
    (plan,) = plan_claims(claim(design=design, parts=[plain]), Tables(tmp_path))
    assert plan.spread == pytest.approx(10 * math.sqrt(1 + 1 / 2))
    assert (plan.number, plan.seeds, plan.runs) == (4, 2, 2 * 4 * 2)
    given = claim(design=design | {"spread": 3.0}, parts=[plain])
    assert next(plan_claims(given, Tables(tmp_path))).spread == 3.0


def test_the_detectable_effect_of_a_simulated_design_is_detected_four_times_in_five(tmp_path):
    (plan,) = plan_claims(claim(), Tables(stored(tmp_path)))
    pairs = plan.detectable + np.random.default_rng(0).standard_normal((2000, 8))
    low = pairs.mean(1) - stats.t.ppf(0.975, 7) * pairs.std(1, ddof=1) / math.sqrt(8)
    assert np.mean(low > 1.0) == pytest.approx(0.8, abs=0.04)


@pytest.mark.parametrize("name", [name for name, claim in CLAIMS.items() if claim.design is not None])
def test_a_committed_design_can_be_composed_and_is_of_enough_replicates(name):
    (plan,) = plan_claims({name: CLAIMS[name]}, Tables(RESULTS))
    parse(design_arguments(CLAIMS[name]))
    assert plan.number >= (3 if CLAIMS[name].design.replicate == "worlds" else 8)
    assert 0 < plan.core_hours < 16
    assert plan.runs >= plan.number


def test_every_claim_that_is_estimated_has_a_design():
    estimated = {decided.name for decided in decide_claims(CLAIMS, Tables(RESULTS)) if not decided.counted}
    assert {name for name, claim in CLAIMS.items() if claim.design is not None} == estimated


def test_the_plan_is_printed_with_its_command_and_its_date(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    cli.run("claims", ["plan", "claim=localization_start"])
    said = capsys.readouterr().out
    assert all(each in said for each in ("8 worlds", "core-hours", "0.94 at 40"))
    assert "sextant train -m sweep=laser_vs_vision" in said
    assert CLAIMS["localization_start"].date in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["plan", "claim=places_compact_quick"], "places_compact_quick rests on counts: it has no design"),
        (["plan", "claim=places_minig"], "Did you mean places_mining"),
        (["plan", "preset=quick"], "preset applies only to verdicts"),
        (["plan", "output=x"], "output applies only to verdicts"),
    ],
)
def test_a_plan_that_cannot_be_is_refused_in_a_line(words, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.run("claims", words)
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("date", "mean", "status"),
    [
        ("", 3.0, "explored"),
        (BEFORE, 3.0, "explored"),
        (DATE, 3.0, "confirmed"),
        (AFTER, 3.0, "confirmed"),
        (AFTER, -3.0, "refuted"),
        (AFTER, 1.1, "open"),
        ("2026-11-28T14:00:00+02:00", 3.0, "confirmed"),  # noon in UTC
        ("2026-11-28T13:30:00+02:00", 3.0, "explored"),
    ],
)
def test_runs_older_than_a_claim_explore_it_and_later_ones_test_it(tmp_path, date, mean, status):
    """Without a record, before, at and after the moment, with every verdict, in another zone."""
    folder = stored(tmp_path, mean=mean, date=date)
    renew_digests(claim(), folder)
    (decided,) = decide_claims(claim(), Tables(folder))
    assert decided.status == status
    (page,) = life.write_board(claim(), Tables(folder), "x", tmp_path / "board")
    row = next(line for line in page.read_text().splitlines() if line.startswith("| [demo]"))
    assert f" | {status} | " in row
    assert "ver 8 seeds." in page.read_text()


OF_COMMAND = {
    "parts": [{"stored": "poses", "table": "recorded", "names": ["x"]}],
    "design": {"replicate": "worlds", "command": "python -m it", "replicates": 4, "core_hours": 0.5, "effect": 3.0},
}


def test_a_design_of_a_command_has_the_power_that_theory_says():
    given = OF_COMMAND["design"] | {"spread": 1.0}
    (plan,) = plan_claims(claim(**OF_COMMAND | {"design": given}), Tables(RESULTS))
    assert (plan.number, plan.runs, plan.core_hours, plan.arguments) == (4, 4, 2.0, [])
    assert plan.power == pytest.approx(power(2.0, 1.0, 4))


@pytest.mark.parametrize("changed", [{"replicates": 0}, {"overrides": ["seed=0"]}, {"command": ""}])
def test_a_design_is_either_of_a_command_or_of_a_sweep(changed):
    with pytest.raises(ValueError, match="a design needs overrides of a sweep, or a command"):
        claim(**OF_COMMAND | {"design": OF_COMMAND["design"] | changed})


@pytest.mark.parametrize(("date", "status"), [(BEFORE, "explored"), (AFTER, "confirmed")])
def test_figures_of_a_command_test_a_claim_if_they_are_later(tmp_path, date, status):
    for name in ("poses", "claims"):
        (tmp_path / name).mkdir()
    (tmp_path / DIGESTS).touch()
    (tmp_path / "poses" / "recorded.csv").write_text("name,seeds,replicate,mean,low,high,against\nx,4,worlds,3,2,4,0\n")
    (tmp_path / "poses" / "replicates.csv").write_text("world,value\n1,3\n")
    (tmp_path / "poses" / "dates.csv").write_text(f"first_run,last_run\n{date},{date}\n")
    renew_digests(claim(**OF_COMMAND), tmp_path)
    assert "poses/replicates.csv" in (tmp_path / DIGESTS).read_text()
    (decided,) = decide_claims(claim(**OF_COMMAND), Tables(tmp_path))
    assert (decided.verdict, decided.status) == ("holds", status)


def test_a_table_that_has_not_changed_keeps_its_date_and_a_new_one_gets_that_of_its_report(tmp_path):
    folder = stored(tmp_path, date=AFTER)
    renew_digests(claim(), folder)
    (folder / "demo" / "dates.csv").write_text(f"first_run,last_run\n{BEFORE},{BEFORE}\n")
    renew_digests(claim(), folder)
    assert AFTER in (folder / BEGUN).read_text()
    stored(folder, mean=4.0)
    renew_digests(claim(), folder)
    assert BEFORE in (folder / BEGUN).read_text()
    assert AFTER not in (folder / BEGUN).read_text()


@pytest.mark.parametrize("date", ["yesterday", "2026-11-28", "2026-11-28T12:00:00", ""])
def test_a_date_without_time_or_zone_is_refused(date):
    with pytest.raises(ValueError, match="must be a time with its zone"):
        claim(date=date)


@pytest.mark.parametrize(
    ("better", "value", "verdict"),
    [
        ("higher", 79.0, "holds"),
        ("higher", 80.0, "not learnt"),  # at the end of the interval
        ("higher", 85.0, "not learnt"),
        ("lower", 90.0, "not learnt"),
        ("lower", 91.0, "holds"),
    ],
)
def test_arms_no_better_than_a_constant_are_not_compared(tmp_path, better, value, verdict):
    folder = stored(tmp_path, baseline=f"{value},{better}")
    (decided,) = decide_claims(claim(), Tables(folder))
    assert decided.verdict == verdict


def test_a_constant_may_be_of_another_quantity_than_the_one_compared(tmp_path):
    folder = stored(tmp_path)
    (folder / "demo" / "baselines.csv").write_text("setting,condition,value,better\nlenet_a,roll,5.0,lower\n")
    cells = (folder / "demo" / "cells.csv").read_text()
    (folder / "demo" / "cells.csv").write_text(cells + "lenet_a,conv,roll,4.0,5.1\nlenet_a,push_pull,roll,4.0,4.9\n")
    part = CLAIM["parts"][0]
    assert decide_claims(claim(), Tables(folder))[0].verdict == "holds"
    assert decide_claims(claim(parts=[part | {"learnt": ["roll"]}]), Tables(folder))[0].verdict == "not learnt"


def test_images_that_count_widen_an_estimate_and_never_narrow_it():
    alone = Estimate.of_pairs(3.0, 1.0, 8)
    wide, narrow = (Estimate.of_pairs(3.0, 1.0, 8, image_half=half) for half in (2.5, 0.1))
    assert wide.interval() == pytest.approx((0.5, 5.5))
    assert narrow.interval() == pytest.approx(alone.interval())
    assert (narrow.images, alone.images) == (0.0, 0.0)
