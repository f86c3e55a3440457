"""How much an image counts along a drive: scores are SciPy's, and the filter gets as sure as it is right."""

import math
from contextlib import contextmanager

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal
from tiny_office import SHARP, office_cache, office_config

from sextant.chapters.localization.along_drives import BACKGROUND, LEAST, best_share, reported_pose_nll
from sextant.chapters.localization.validation import same_place
from sextant.errors import UserError
from sextant.evaluation.protocols import NORDLAND_LOCALIZATION, TOWN_LOCALIZATION
from sextant.lifecycle.execute import execute
from sextant.lifecycle.run_reporter import RunReporter
from sextant.localization.localize import Track
from sextant.runs.directory import RunDirectory


def told(pose, covariance, mass):
    """A track of one step and one run."""
    one = np.ones((1, 1))
    return Track(
        np.array(pose, float)[None, None], 9 * np.eye(3)[None, None], np.array(covariance, float)[None, None],
        mass * one, one.astype(int), one, one.astype(int), one.astype(int), one > 2, np.ones(1),
    )  # fmt: skip


@pytest.mark.parametrize("axes", [(0,), (0, 1), (0, 1, 2)])
@pytest.mark.parametrize("mass", [1.0, 0.3])
def test_what_was_told_is_scored_as_a_gaussian_or_anywhere(axes, mass):
    rng = np.random.default_rng(0)
    root, truth, mean = rng.normal(size=(3, 3)), rng.normal(size=3) / 3, rng.normal(size=3) / 3
    floor, volume = (0.1, 0.2, 0.05), 50.0
    found = reported_pose_nll(truth[None, None], told(mean, root @ root.T, mass), axes, floor, volume)
    covariance = (root @ root.T + np.diag(np.square(floor)))[np.ix_(axes, axes)]
    density = multivariate_normal(mean[list(axes)], covariance).pdf(truth[list(axes)])
    mass *= 1 - BACKGROUND
    assert found.item() == pytest.approx(-math.log(mass * density + (1 - mass) / volume))


def test_headings_go_round():
    at = told((0.0, 0.0, math.pi - 0.01), np.eye(3), 1.0)
    near, far = (
        reported_pose_nll(np.array([[[0.0, 0.0, h]]]), at, (0, 1, 2), (0.1,) * 3, 50.0).item()
        for h in (0.01 - math.pi, 0.0)
    )
    assert near < far


def test_a_pose_that_is_sure_and_wrong_costs_more_than_one_that_says_nothing_but_not_without_end():
    wrong = told((9.0, 0.0, 0.0), np.zeros((3, 3)), 1.0)
    nothing = told((9.0, 0.0, 0.0), np.zeros((3, 3)), 0.0)
    scores = [
        reported_pose_nll(np.zeros((1, 1, 3)), each, (0, 1), (0.1,) * 3, 50.0).item() for each in (wrong, nothing)
    ]
    assert scores == pytest.approx([math.log(50.0 / BACKGROUND), math.log(50.0)])


def test_the_search_goes_on_past_one_share_that_is_no_better_and_ends():
    asked = []

    def scores(share):
        asked.append(share)
        return np.array([-0.1, 0.1]) + {1.0: 3.0, 0.5: 3.1, 0.25: 2.0}.get(share, 4.0)

    assert best_share(scores) == 0.25
    assert asked == [1.0, 0.5, 0.25, 0.125, 0.0625]
    assert best_share(lambda share: np.full(3, share)) == LEAST


@pytest.mark.parametrize("stretches", [0, 1])
def test_one_stretch_of_a_drive_decides_nothing(stretches):
    assert best_share(lambda share: np.full(stretches, share)) == 1.0


def test_a_share_has_to_be_better_by_more_than_chance():
    better_in_one = np.array([0.0, 0.0, 0.0, 0.0, -1.0])
    assert best_share(lambda share: better_in_one * (1 - share)) == 1.0
    assert best_share(lambda share: (better_in_one - 1) * (share == 0.5)) == 0.5


class Hears(RunReporter):
    """Writes down what is shown, and how far it came."""

    def __init__(self):
        self.shown = []

    @contextmanager
    def progress(self, what, unit):
        steps = []
        self.shown.append((what, unit, steps))
        yield lambda done, total: steps.append((done, total))


@pytest.mark.slow
def test_what_a_run_finds_is_a_share_of_what_single_images_ask_for(tmp_path):
    cache, found, hears = office_cache(), {}, Hears()
    for tempering in ("fitted", "along_drives"):
        config = office_config(
            cache, tmp_path, *SHARP, "task.horizon=60", "task.save_map=false", f"likelihood.tempering={tempering}",
            "filter.regions=null",
        )  # fmt: skip
        found[tempering] = RunDirectory(execute(config, reporter=hears).directory).results()["metrics"]
    halvings = math.log2(found["fitted"]["val/tempering"] / found["along_drives"]["val/tempering"])
    assert halvings > 0
    assert halvings == pytest.approx(round(halvings), abs=1e-6)
    regions = [np.mean([value for key, value in each.items() if "coverage_95" in key]) for each in found.values()]
    assert regions[1] >= regions[0]
    tried = [steps for what, unit, steps in hears.shown if what.startswith("trying ")]
    assert len(tried) > halvings
    assert {steps[-1] for steps in tried} == {(1, 1)}


@pytest.mark.parametrize(
    ("protocol", "limits"),
    [(NORDLAND_LOCALIZATION, "within 2 frames of a map"), (TOWN_LOCALIZATION, "within 5 m and 20 degrees of a map")],
)
def test_the_limits_within_which_no_image_is_are_told(protocol, limits):
    far = torch.zeros(2, 3, dtype=torch.float64)
    with pytest.raises(UserError, match=limits):
        same_place(far + 1000, far, protocol)
