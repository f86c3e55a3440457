"""Figures by corruption, pooled by hand; and whether the filter is right to call itself lost."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from sextant.chapters.localization.report import name_of, shares_by_particles
from sextant.chapters.localization.testing import Trial
from sextant.chapters.localization.under_corruption import by_corruption, metrics, pooled, success_by_condition, table
from sextant.evaluation.success import NEVER


def judged(found, mass, inside, corruption="", there=None):
    """One trial of r runs of t steps: who was found, the mass of the heaviest mode, and where the estimate is right."""
    mass, inside = np.array(mass, float), np.array(inside, bool)
    there = np.ones_like(inside) if there is None else np.array(there, bool)
    converged = np.where(found, 0, NEVER)
    after = np.asarray(there & np.array(found)[:, None])
    outcome = SimpleNamespace(
        trial=Trial("run", "night", "none", 100, corruption),
        runs=SimpleNamespace(inside=there.T),
        track=SimpleNamespace(mass=mass.T),
        nll=np.ones_like(mass).T,
    )
    tracking = float(inside[after].mean()) if after.any() else math.nan
    return SimpleNamespace(
        outcome=outcome, found=np.array(found), converged=converged, after=after, inside=inside,
        position=np.where(inside, 0.1, 3.0), heading_deg=np.ones_like(mass), summary=SimpleNamespace(tracking=tracking),
    )  # fmt: skip


CLEAN = judged([True, True], [[0.9, 0.9], [0.9, 0.4]], [[1, 1], [1, 0]])
FOG = judged([True, False], [[0.9, 0.9], [0.3, 0.9]], [[1, 1], [0, 0]], "fog/1")
DENSE = judged([False, False], [[0.4, 0.4], [0.4, 0.4]], [[0, 0], [1, 0]], "fog/3")
TRIALS = {"night": CLEAN, "night, fog/1": FOG, "night, fog/3": DENSE}


def test_severities_of_a_corruption_are_pooled_and_clean_images_come_first():
    groups = by_corruption(TRIALS)
    assert {name: len(trials) for name, trials in groups.items()} == {"clean": 1, "fog": 2}
    assert success_by_condition(TRIALS) == {"clean": 1.0, "fog/1": 0.5, "fog/3": 0.0}
    assert by_corruption({"night": CLEAN}) == {}
    assert metrics({"night": CLEAN}) == {}


def test_lost_is_called_rightly_where_the_estimate_is_astray():
    found = pooled([FOG, DENSE])
    assert found["success"] == pytest.approx(0.25)
    assert found["lost"] == pytest.approx(5 / 8)
    assert found["lost_astray"] == pytest.approx(4 / 5)  # one is right and called lost
    assert found["astray_lost"] == pytest.approx(4 / 5)  # one is astray and not called lost
    assert found["position_error_median"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("trial", "missing"),
    [
        (judged([True], [[0.9, 0.9]], [[1, 1]], "fog/1"), {"lost_astray", "astray_lost"}),
        (judged([False], [[0.9, 0.9]], [[0, 0]], "fog/1"), {"lost_astray", "tracking", "position_error_median",
                                                             "heading_error_deg_median", "pose_nll",
                                                             "frames_to_converge_median"}),
    ],
    ids=["never lost", "never found"],
)  # fmt: skip
def test_what_cannot_be_told_is_left_out(trial, missing):
    told = {name.rpartition("/")[2] for name in metrics({"night": CLEAN, "night, fog/1": trial}) if "/fog/" in name}
    assert set(pooled([trial])) - told == missing
    assert table({"night": CLEAN, "night, fog/1": trial})[1]["of these astray %"] == "–"


def test_steps_beyond_the_end_of_a_run_do_not_count():
    trial = judged([True], [[0.9, 0.1]], [[1, 0]], "fog/1", there=[[1, 0]])
    assert (pooled([trial])["lost"], pooled([trial])["tracking"]) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("drives", "name"),
    [(["run"], "night, fog/3"), (["run", "other"], "run, fog/3"), (["a/b", "c"], "a/b, fog/3")],
    ids=["conditions", "drives", "drives with strokes"],
)
def test_names_of_trials(drives, name):
    trials = [Trial(drive, "night", "none", 100) for drive in drives]
    corrupted = Trial(f"{drives[0]}, fog/3", "night", "none", 100, "fog/3")
    assert name_of(corrupted, [*trials, corrupted]) == name


@pytest.mark.parametrize(
    ("conditions", "names"),
    [(("night", "night"), ["run", "other", "run, fog/1"]), (("night", "day"), ["night", "day", "night, fog/1"])],
)
def test_each_drive_has_a_curve_of_its_own(conditions, names):
    found = {}
    for count in (400, 100):
        for drive, condition, corruption in zip(
            ("run", "other", "run, fog/1"), (*conditions, conditions[0]), ("", "", "fog/1"), strict=True
        ):
            trial = Trial(drive, condition, "none", count, corruption)
            summary = SimpleNamespace(share=(drive, count))
            found[f"{drive} {count}"] = SimpleNamespace(outcome=SimpleNamespace(trial=trial), summary=summary)
    drives = ("run", "other", "run, fog/1")
    expected = {name: {100: (drive, 100), 400: (drive, 400)} for name, drive in zip(names, drives, strict=True)}
    assert shares_by_particles(found) == expected
    assert all(list(shares) == [100, 400] for shares in shares_by_particles(found).values())
