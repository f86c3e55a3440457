"""The board of claims follows from the stored results, and agrees with the chapters' pages."""

import csv
import math
import re
import shutil
from dataclasses import replace
from operator import itemgetter
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.spatial import cKDTree

from sextant import cli
from sextant.composing.config_files import read_config_file
from sextant.config.schema.claims import Claim
from sextant.data.worlds.office_walk import OfficeWalkPlan
from sextant.errors import UserError
from sextant.evaluation.verdict import Estimate
from sextant.lifecycle import claim_files
from sextant.lifecycle import claims as life
from sextant.lifecycle.claim_files import read_claims
from sextant.lifecycle.claims import (
    DIGESTS,
    Tables,
    check_digests,
    decide_claims,
    renew_digests,
    run_claims,
    sweep_arguments,
)
from sextant.lifecycle.sweep_plan import read_design
from sextant.reports.claims_board import NOT_YET, Comparison, advice, replicates_told
from sextant.runs.outputs_folder import conf_dir

RESULTS = Path(__file__).parents[2] / "results"
CLAIMS = read_claims()
PICTURES = shutil.ignore_patterns("*.png", "*.jpg", "*.svg")
RECORDED = list(csv.DictReader((RESULTS / "claims" / "recorded.csv").open(encoding="utf-8")))
SEEDS = ("results/calibration/main_job.csv", "results/places/town_seeds.csv", "results/places/railway_seeds.csv")
OF_SEEDS = [row for row in RECORDED if row["source"].startswith(SEEDS)]
OF_PAGES = [row for row in RECORDED if row not in OF_SEEDS]
QUICK = sorted(
    path.stem
    for path in (conf_dir() / "sweep").glob("*.yaml")
    if "quick" in read_config_file(path)["sweep"]
    and any(part.sweep == path.stem and not part.beside for each in CLAIMS.values() for part in each.parts)
)
DEMO = {
    "date": "2026-11-28T12:00:00+00:00",
    "not_covered": "anything but digits",
    "chapter": 7,
    "sentence": "Push-pull helps on digit scans.",
    "published": "nothing",
    "page": "push_pull.md",
    "unit": "points of accuracy",
    "matters": 1.0,
    "reason": "one image in a hundred",
    "runs": "none",
    "parts": [
        {"sweep": "demo", "stored": "demo", "names": ["effect"], "settings": ["lenet_a"], "conditions": ["clean"]}
    ],
}


def decided(results=RESULTS, **claims):
    return decide_claims(claims or CLAIMS, Tables(results))


DECIDED = decided()


def demo(**changes):
    return Claim.model_validate(DEMO | changes)


def stored_pairs(folder, *differences, seeds=8):
    """A stored table of the demo's contrast in one setting for each of its names."""
    (folder / "demo").mkdir(exist_ok=True)
    rows = [f"effect,{setting},clean,{seeds},{mean},{spread},-0.1" for setting, mean, spread in differences]
    text = "contrast,setting,condition,seeds,mean,spread,floor_mean\n" + "\n".join(rows) + "\n"
    (folder / "demo" / "contrasts.csv").write_text(text)
    return folder


@pytest.mark.slow
def test_the_board_is_written_again_byte_for_byte(tmp_path, capsys):
    cli.run("claims", [f"output={tmp_path}"])
    written = {path.relative_to(tmp_path) for path in tmp_path.rglob("*.*")}
    assert written == {
        Path("claims.md"),
        Path("claims/comparisons.csv"),
        *(Path("claims") / f"{name}.svg" for name in CLAIMS),
    }
    for name in written:
        assert (tmp_path / name).read_bytes() == (RESULTS / name).read_bytes(), f"{name}: run sextant claims"
    assert "push_pull_clean" in capsys.readouterr().out


@pytest.mark.parametrize("claim", DECIDED, ids=lambda claim: claim.name)
def test_a_chapters_page_says_the_verdict_of_the_board(claim):
    page = (RESULTS / claim.stated.page).read_text(encoding="utf-8")
    said = re.findall(rf"\[([^\]]*)\]\(claims\.md#{claim.name}\)", page)
    assert set(said) == {claim.verdict}
    assert f'<a name="{claim.name}"></a>' in (RESULTS / "claims.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", sorted(RESULTS.rglob("*.md")), ids=lambda page: page.relative_to(RESULTS).as_posix())
def test_no_page_says_another_verdict_than_the_board(page):
    verdicts = {claim.name: claim.verdict for claim in DECIDED}
    for said, name in re.findall(r"\[([^\]]*)\]\([./]*claims\.md#(\w+)\)", page.read_text(encoding="utf-8")):
        assert said == verdicts[name], f"{page.name} says of {name}: {said}"


@pytest.mark.parametrize("row", OF_PAGES, ids=itemgetter("name"))
def test_what_is_recorded_stands_where_it_says(row):
    page, _, _ = row["source"].partition(": ")
    text = " ".join((RESULTS.parent / page).read_text(encoding="utf-8").replace("**", "").split())
    wanted = [row[key] for key in ("mean", "low", "high") if row[key] not in ("", "0")]
    if row["name"] == "compact/bytes":
        wanted = ["512 bytes per descriptor"]
    assert all(value in text for value in wanted)


@pytest.mark.parametrize("row", OF_SEEDS, ids=itemgetter("name"))
def test_what_is_recorded_of_seeds_is_their_t_interval(row):
    path, _, columns = row["source"].partition(": ")
    seeds = list(csv.DictReader((RESULTS.parent / path).open(encoding="utf-8")))
    ours, how, other = columns.split()
    first, second = (np.array([float(seed[name]) for seed in seeds]) for name in (ours, other))
    values = {"less": first - second, "of": 100 * first / second, "against": first}[how]
    assert how != "against" or set(second) == {float(row["against"])}
    half = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values))
    assert int(row["seeds"]) == len(seeds) >= 8
    expected = (values.mean(), values.mean() - half, values.mean() + half)
    assert [float(row[key]) for key in ("mean", "low", "high")] == pytest.approx(expected, abs=0.006)


def test_the_nearest_pose_of_a_thinned_map_is_as_far_as_recorded():
    config = read_config_file(conf_dir() / "dataset" / "office_walk.yaml")
    del config["_target_"]
    mapped, _, test = OfficeWalkPlan("office_walk", config, config["conditions"], config["samples"])._drives
    rng = np.random.default_rng(0)
    kept = [np.sort(rng.choice(len(mapped), len(mapped) // 10, replace=False)) for _ in range(100)]
    nearest = [np.median(cKDTree(mapped[rows, :2]).query(test[:, :2])[0]) for rows in kept]
    against = {float(row["against"]) for row in RECORDED if row["name"].startswith("any_pose")}
    assert against == {0.20}
    assert np.mean(nearest) >= 0.20  # so that the claim is not made easier


def test_changed_results_are_refused(tmp_path):
    results = shutil.copytree(RESULTS, tmp_path / "results", ignore=PICTURES)
    check_digests(CLAIMS, results)
    path = results / "places" / "loss" / "contrasts.csv"
    path.write_text(path.read_text().replace("-3.421875", "+3.421875"))
    with pytest.raises(UserError, match=r"places/loss/contrasts\.csv does not match its digest"):
        check_digests(CLAIMS, results)
    path.unlink()
    with pytest.raises(UserError, match=r"places/loss/contrasts\.csv is not there"):
        check_digests(CLAIMS, results)


def test_a_stored_table_of_short_runs_that_is_missing_is_refused(tmp_path):
    shutil.copytree(RESULTS, tmp_path / "results", ignore=PICTURES)
    (tmp_path / "results" / "claims" / "quick" / "recovery" / "seeds.csv").unlink()
    with pytest.raises(UserError, match=r"quick/recovery/seeds.csv is not there"):
        check_digests(CLAIMS, tmp_path / "results")


def test_one_claim_is_told_in_the_singular(tmp_path):
    claims = {"demo": demo()}
    (page,) = life.write_board(claims, Tables(stored_pairs(tmp_path, ("lenet_a", 3.0, 1.0))), "x", tmp_path)
    assert "1 claim: 1 held up." in page.read_text()


def test_only_what_makes_the_interval_is_advised():
    """An unknown spread, a mean at the border, few seeds, images that make the interval, both, and worlds."""
    known = Comparison("", Estimate(1.0, math.nan, 7, 8, known=(0.0, 2.0)), "better", 0.5, "points")

    def told(matters, *pairs, **more):
        return advice(replace(known, matters=matters, estimate=Estimate.of_pairs(*pairs, **more)), 1)

    assert advice(known, 1) == "how many more seeds is not known"
    assert told(1.0, 1.0, 2.0, 8) == "more than 1,000 more seeds, as the effect lies at the border"
    assert told(0.5, 1.0, 1.0, 8) == "about 26 more seeds"
    assert told(0.5, 1.0, 0.1, 8, image_half=0.6) == "not more seeds, but about 3 times as many test images"
    assert told(0.5, 1.0, 1.0, 8, image_half=1.2) == "more seeds and more test images together"
    worlds = replace(Estimate.of_pairs(1.0, 1.0, 8), replicate="worlds")
    assert advice(replace(known, matters=0.5, estimate=worlds), 1) == "about 26 more worlds"


HEAD = "contrast,setting,condition,seeds,mean,spread,floor_mean"
ROW = "effect,lenet_a,clean,8,3.0,1.0,-0.1"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "is not a table of comma-separated values"),
        (b"\xff\x00\xfe", "is not a table of comma-separated values"),
        (f"{HEAD}\n{ROW},5\n", "line 2: 8 values in 7 columns"),
        (f"{HEAD}\n{ROW[:-5]}\n", "line 2: 6 values in 7 columns"),
        (f"{HEAD}\n{ROW.replace('3.0', 'xyz')}\n", "line 2: mean=xyz must be a number"),
        (f"{HEAD}\n{ROW.replace('1.0', 'nan')}\n", "line 2: spread=nan must be a number from 0 up"),
        (f"{HEAD}\n{ROW.replace('8', 'abc')}\n", "line 2: seeds=abc must be a whole number from 0 up"),
        (f"{HEAD}\n{ROW.replace('8', '-8')}\n", "line 2: seeds=-8 must be a whole number from 0 up"),
        (f"{HEAD.replace('spread', 'sp')}\n{ROW}\n", "line 2: there is no column spread"),
        (f"{HEAD.replace('setting', 'sp')}\n{ROW}\n", "line 2: there is no column setting"),
    ],
)
def test_a_damaged_table_is_told_with_its_line_and_column(tmp_path, content, said):
    stored_pairs(tmp_path, ("lenet_a", 3.0, 1.0))
    (tmp_path / "demo" / "contrasts.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UserError, match=said) as caught:
        decided(tmp_path, demo=demo())
    assert str(tmp_path / "demo" / "contrasts.csv") in caught.value.problem


def test_digests_are_renewed_once_all_is_there_and_decides(tmp_path):
    claims = {"demo": demo()}
    table, digests = stored_pairs(tmp_path, ("lenet_a", 3.0, 1.0)) / "demo" / "contrasts.csv", tmp_path / DIGESTS
    quick = tmp_path / "claims" / "quick" / "demo" / "contrasts.csv"
    quick.parent.mkdir(parents=True)
    quick.write_bytes(table.read_bytes())
    digests.touch()
    renew_digests(claims, tmp_path)
    check_digests(claims, tmp_path)
    whole, lost = digests.read_bytes(), quick.with_name("seeds.csv")
    table.write_text("damaged")
    with pytest.raises(UserError, match="has no row"):
        renew_digests(claims, tmp_path)
    assert digests.read_bytes() == whole
    digests.write_bytes(whole + f"{'0' * 64}  {lost.relative_to(tmp_path)}\n".encode())
    with pytest.raises(UserError, match=r"quick/demo/seeds\.csv is not there"):
        renew_digests(claims, tmp_path)
    digests.write_bytes(b"\xff\xfe")
    with pytest.raises(UserError, match=r"results\.sha256 is not text"):
        check_digests(claims, tmp_path)


@pytest.mark.parametrize("key", ["html", "output"])
@pytest.mark.parametrize("folder", ["README.md", "README.md/x", "/proc/foo"])
def test_a_folder_that_cannot_be_made_is_told_first(key, folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(RESULTS.parent)
    monkeypatch.setattr(life, "stored_results", lambda: pytest.fail("it was begun"))
    with pytest.raises(SystemExit, match="2"):
        cli.run("claims", [f"{key}={folder}"])
    assert f"{key}={folder} is not a folder that can be written to" in capsys.readouterr().err


def test_a_claim_needs_arms_and_rows_that_are_there(tmp_path):
    part = DEMO["parts"][0]
    stored_pairs(tmp_path, ("lenet_a", 3.0, 1.0))
    with pytest.raises(UserError, match="claim demo needs contrast gone, which sweep=demo lacks"):
        decided(tmp_path, demo=demo(parts=[part | {"names": ["gone"]}]))
    cost = {"table": "cost", "names": ["push_pull"], "against": "gone", "quantity": "ratio"}
    with pytest.raises(UserError, match="claim demo needs arm gone, which sweep=demo lacks"):
        decided(tmp_path, demo=demo(parts=[part | cost]))
    with pytest.raises(UserError, match="has no row contrast=effect setting=lenet_b"):
        decided(tmp_path, demo=demo(parts=[part | {"settings": ["lenet_b"]}]))
    with pytest.raises(UserError, match="there is no sweep gone"):
        decided(tmp_path, demo=demo(parts=[part | {"sweep": "gone"}]))


def test_seeds_too_few_are_undecided_and_say_how_many_more(tmp_path):
    stored_pairs(tmp_path, ("lenet_a", 3.0, 0.1), seeds=3)
    (claim,) = decided(tmp_path, demo=demo())
    assert claim.verdict == "undecided"
    assert (replicates_told(claim.deciding), advice(claim.deciding, 1)) == ("3 seeds", "about 5 more seeds")


def test_a_table_without_a_pair_that_converged_is_undecided(tmp_path):
    stored_pairs(tmp_path, ("lenet_a", "", ""), seeds="")
    (claim,) = decided(tmp_path, demo=demo())
    assert (claim.verdict, claim.deciding.effect()) == ("undecided", "–")


@pytest.mark.parametrize(
    ("direction", "expects", "verdict"),
    [("up", "better", "holds"), ("down", "better", "fails"), ("down", "as_good", "fails"), ("up", "same", "fails")],
)
def test_the_direction_of_a_claim_counts(tmp_path, direction, expects, verdict):
    stored_pairs(tmp_path, ("lenet_a", 3.0, 0.5))
    part = DEMO["parts"][0] | {"direction": direction, "expects": expects}
    assert [claim.verdict for claim in decided(tmp_path, demo=demo(parts=[part]))] == [verdict]


def test_what_stands_beside_a_claim_does_not_decide_it(tmp_path):
    stored_pairs(tmp_path, ("lenet_a", 3.0, 0.5), ("lenet_b", -3.0, 0.5))
    part = DEMO["parts"][0]
    (claim,) = decided(tmp_path, demo=demo(parts=[part, part | {"settings": ["lenet_b"], "beside": True}]))
    assert (claim.verdict, len(claim.comparisons), len(claim.counting)) == ("holds", 2, 1)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"matters": -1}, "matters"),
        ({"sentense": "x"}, "sentense"),
        ({"parts": []}, "parts"),
        ({"parts": [DEMO["parts"][0] | {"beside": True}]}, "nothing decides the claim"),
        ({"parts": [DEMO["parts"][0] | {"table": "cells"}]}, "needs against"),
        ({"parts": [DEMO["parts"][0] | {"expects": "much better"}]}, "expects"),
    ],
)
def test_a_wrong_claim_is_reported_with_its_file(changes, said, tmp_path, monkeypatch):
    (tmp_path / "claim").mkdir()
    (tmp_path / "claim" / "mine.yaml").write_text(str(DEMO | changes).replace("True", "true"))
    monkeypatch.setattr(claim_files, "conf_dir", lambda: tmp_path)
    with pytest.raises(UserError, match=rf"mine\.yaml.*{said}"):
        read_claims()


def test_a_misspelt_claim_is_answered_with_the_nearest():
    with pytest.raises(UserError, match="Did you mean places_mining"):
        read_claims("place_mining")


@pytest.mark.parametrize("sweep", QUICK)
def test_a_quick_sweep_has_eight_seeds_and_what_its_claims_need(sweep):
    parts = [part for claim in CLAIMS.values() for part in claim.parts if part.sweep == sweep and not part.beside]
    design = read_design(sweep_arguments(sweep, parts, "quick"))
    assert len(design.seeds) == 8
    there = {*design.arms, *design.definition["contrasts"]}
    assert {name for part in parts for name in part.names} <= there
    assert set(design.arms) <= {
        arm for contrast in design.definition["contrasts"].values() for arm in contrast.values()
    }


def test_a_quick_sweep_runs_in_the_settings_that_claims_need_alone():
    sweep = "calibration_ablation_long"
    parts = [part for claim in CLAIMS.values() for part in claim.parts if part.sweep == sweep]
    counting = [part for part in parts if not part.beside]
    design = read_design(sweep_arguments(sweep, counting, "quick"))
    assert design.only == {
        arm: ["calibration_small"] if "l2" in arm else [] for arm in design.arms
    }  # least squares are compared in distribution, the two parameterizations in both settings
    assert design.runs == 8 * (2 * 2 + 2)
    assert read_design(sweep_arguments(sweep, parts, "quick")).runs > design.runs


@pytest.mark.slow
def test_a_preset_runs_what_is_missing_and_decides_from_it(tmp_path, monkeypatch):
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path))
    small = ["trainer=fast", "corruption=none", "tracking=none"]
    definition = {**life._definition("demo"), "quick": [*small, "backbone=lenet_a", "sweep.seeds=1"]}
    monkeypatch.setattr(life, "_definition", lambda sweep: definition)
    claims = {"demo": demo()}
    tables = run_claims(claims, "quick", RESULTS, ["launcher=local"])
    (claim,) = decide_claims(claims, tables)
    assert (claim.verdict, tables.left_out) == ("undecided", {})
    (page,) = life.write_board(claims, tables, "sextant claims preset=quick", tmp_path / "board")
    more = 8 - claim.deciding.estimate.seeds  # 1, or 0 if so short a training left a network at chance
    assert (f"{more} more seeds" if more < 8 else "how many more seeds is not known") in page.read_text()


@pytest.mark.slow
def test_a_preset_says_what_it_cannot_run(tmp_path):
    claims = {"cosfire_mnist_9949": CLAIMS["cosfire_mnist_9949"]}
    tables = run_claims(claims, "quick", RESULTS)
    assert decide_claims(claims, tables) == []
    page, _ = life.write_board(claims, tables, "sextant claims preset=quick", tmp_path, tmp_path / "html")
    assert "`cosfire_mnist_9949`: sweep=cosfire_mnist_full has no quick form" in page.read_text()


def test_launcher_and_tracking_are_handed_on_and_a_board_without_verdicts_is_an_error(tmp_path, monkeypatch, capsys):
    handed = []

    def run_none(claims, preset, stored, overrides, *reporters):
        handed.append(overrides)
        return Tables(stored, left_out=dict.fromkeys((part.sweep for c in claims.values() for part in c.parts), "down"))

    monkeypatch.setattr(life, "run_claims", run_none)
    slurm = ["launcher=slurm", "launcher.partition=long", "tracking=none"]
    words = ["claim=push_pull_clean", "preset=quick", f"output={tmp_path}"]
    board = tmp_path / "claims.md"
    board.write_text("as it was")
    for more in (slurm, ["workers=2"], ["launcher=joblib", "workers=2"]):
        with pytest.raises(SystemExit, match="2"):
            cli.run("claims", [*words, *more])
    assert handed == [slurm, ["launcher.workers=2"], ["launcher=joblib", "launcher.workers=2"]]
    assert "none of 1 claim could be decided" in capsys.readouterr().err
    assert board.read_text() == "as it was"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["launcher=slurm"], "it applies to its sweeps"),
        (["claim=places_mining", "workers=2"], "workers=2 needs a preset: it applies to its sweeps"),
        (["preset=quick", "launcher=local", "workers=2"], "workers=2 requires launcher=joblib"),
        (["preset=quick", "launchr=local"], "launchr=local: unknown key"),
    ],
)
def test_what_does_not_go_together_is_refused_before_anything_runs(words, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        cli.run("claims", words)
    assert said in capsys.readouterr().err


def test_claims_whose_comparisons_have_no_run_yet_are_planned():
    """Seen through the decision: what is not run stays so, whatever else is noted of an estimate."""
    decided = {claim.name: claim for claim in DECIDED}
    waiting = {name for name, claim in decided.items() if any(not each.estimate.run for each in claim.counting)}
    planned = {name for name, claim in decided.items() if all(not each.estimate.run for each in claim.counting)}
    assert {name for name, claim in decided.items() if claim.status == "planned"} == planned
    assert all(decided[name].verdict in ("undecided", "fails") for name in waiting)
    assert all(each.effect() == NOT_YET for name in planned for each in decided[name].counting)
    assert waiting  # as long as a plan is to be run: then this test has served its time


def test_arms_that_await_the_winners_of_a_search_have_no_stored_results():
    for path in (conf_dir() / "sweep").glob("*.yaml"):
        if "searches have not been run" in path.read_text():
            stored = {part.stored for claim in CLAIMS.values() for part in claim.parts if part.sweep == path.stem}
            assert not [each for each in stored if (RESULTS / each).exists()]
