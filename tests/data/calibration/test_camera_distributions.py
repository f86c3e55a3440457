"""Cameras of the distributions that are shipped: their published moments, and that each is a function of its number."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from scipy import stats

from sextant.chapters.calibration.data import CameraDistribution
from sextant.errors import UserError
from sextant.geometry import k2_of_k1, max_distorted_radius, rho_from_tilt

CONFIGS = sorted((Path(__file__).parents[3] / "conf" / "sampling").glob("*.yaml"))
N = 40_000
PLAIN = {
    "tilt": {"kind": "uniform", "low": -0.3, "high": 0.3},
    "roll": {"kind": "constant", "value": 0},
    "focal": {"kind": "uniform", "low": 0.5, "high": 1.4},
    "k1": {"kind": "uniform", "low": -0.4, "high": 0},
    "aspect": {"4:3": 1},
    "focal_as": "heights",
}


def shipped(name):
    keys = yaml.safe_load((CONFIGS[0].parent / f"{name}.yaml").read_text())
    assert keys.pop("_target_") == "sextant.chapters.calibration.data.CameraDistribution"
    return CameraDistribution(**keys)


def ks(values, distribution):
    """Whether values may be of a distribution: Kolmogorov-Smirnov at p = 0.001."""
    return stats.kstest(np.asarray(values), distribution.cdf).pvalue > 0.001


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_shipped_distribution_draws_cameras_that_can_be(path):
    distribution = shipped(path.stem)
    assert distribution.name == path.stem
    draw = distribution.draw(N, 3)
    tilt, _, focal, k1 = draw.cameras
    assert all(value.dtype == torch.float64 and value.isfinite().all() for value in (*draw.cameras, draw.yaw))
    k2 = k2_of_k1(k1, distribution.k2_of_k1)
    corner = torch.hypot(draw.aspect, torch.ones(())) / 2 / focal
    assert (corner < max_distorted_radius(k1, k2)).all()
    assert tilt.abs().max() <= math.radians(85)
    assert ks(draw.yaw, stats.uniform(-math.pi, 2 * math.pi))
    assert sorted({round(a, 9) for a in draw.aspect.tolist()}) == pytest.approx(distribution.aspects, abs=1e-9)


def test_lopez_has_the_published_moments():
    draw = shipped("lopez").draw(N, 0)
    tilt, roll, focal, k1 = draw.cameras
    rho = rho_from_tilt(tilt, focal, k1, k2_of_k1(k1))
    assert ks(rho, stats.truncnorm(-0.623 / 0.3, 0.577 / 0.3, 0.023, 0.3))
    assert ks(focal * 27, stats.uniform(13, 25))
    assert ks(k1, stats.uniform(-0.4, 0.4))
    assert roll.abs().max() <= 0.75
    shares = [1 / 3, 2 / 3]
    for limit in (0.001, 0.01, 0.1, 0.5):
        inside = [stats.cauchy(0, s) for s in (0.001, 0.1)]
        expected = sum(w * c.cdf(limit) / c.cdf(0.75) if False else w * (2 * c.cdf(limit) - 1) / (2 * c.cdf(0.75) - 1)
                       for w, c in zip(shares, inside, strict=True))  # fmt: skip
        assert (roll.abs() <= limit).double().mean().item() == pytest.approx(expected, abs=0.01)
    for ratio, weight in ((1, 0.09), (1.25, 0.01), (4 / 3, 0.66), (1.5, 0.2), (16 / 9, 0.04)):
        share = ((draw.aspect - ratio).abs() < 1e-9).double().mean().item()
        assert share == pytest.approx(weight, abs=0.01)


def test_quantities_are_independent():
    draw = shipped("uniform").draw(N, 5)
    values = torch.stack([*draw.cameras, draw.yaw])
    assert (torch.corrcoef(values) - torch.eye(5)).abs().max() < 0.02


def test_portrait_share_and_long_sides():
    hold = shipped("hold_geoffroy").draw(N, 0)
    upright = ((hold.aspect < 1).double().mean() / (hold.aspect != 1).double().mean()).item()
    assert upright == pytest.approx(0.2, abs=0.01)
    savio = shipped("savio").draw(N, 0)
    longer = savio.cameras.focal / savio.aspect.clamp(min=1)
    assert 0.4 <= longer.min() < 0.41
    assert 1.4 < longer.max() <= 1.451


def test_sphere_model_is_taken_by_its_first_coefficient():
    # the sphere model sees a ray at radius r (1 + xi) / (1 + xi sqrt(1 + r^2))
    xi, r = 0.7, 1e-2
    seen = r * (1 + xi) / (1 + xi * math.sqrt(1 + r * r))
    keys = PLAIN | {"k1": {"kind": "constant", "value": xi}, "k1_as": "sphere"}
    k1 = CameraDistribution(**keys).draw(1, 0).cameras.k1.item()
    assert (seen / r - 1) / (r * r) == pytest.approx(k1, rel=1e-3)


def test_a_draw_depends_on_its_number_alone():
    distribution = shipped("lopez")
    rng = np.random.default_rng(0)
    which, numbers = rng.integers(0, 500, 64), rng.integers(0, 100_000, 64)
    together = distribution.draw_for(which, numbers, 11)
    for i in (0, 7, 63):
        alone = distribution.draw_for(which[i : i + 1], numbers[i : i + 1], 11)
        for a, b in zip((*alone.cameras, alone.yaw, alone.aspect),
                        (*together.cameras, together.yaw, together.aspect), strict=True):  # fmt: skip
            assert a[0] == b[i]
    other = distribution.draw_for(which, numbers, 12)
    assert (other.cameras.focal != together.cameras.focal).all()


def test_cameras_beyond_the_fold_are_drawn_again_and_the_rest_is_kept():
    keys = PLAIN | {"k2_of_k1": "zero", "tilt_as": "tilt_deg"}
    folding, safe = CameraDistribution(**keys).draw(5000, 0), CameraDistribution(**PLAIN).draw(5000, 0)
    same = (folding.cameras.focal == safe.cameras.focal) & (folding.cameras.k1 == safe.cameras.k1)
    focal, k1 = safe.cameras.focal, safe.cameras.k1
    legal = torch.hypot(safe.aspect, torch.ones(())) / 2 / focal < max_distorted_radius(k1, torch.zeros_like(k1))
    assert 0.2 < legal.double().mean() < 0.95
    assert torch.equal(same, legal)


def test_a_distribution_of_impossible_cameras_is_refused():
    impossible = PLAIN | {"k1": {"kind": "constant", "value": -3}, "k2_of_k1": "zero"}
    with pytest.raises(UserError, match="fold"):
        CameraDistribution(**impossible).draw(3, 0)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"tilt_as": "pitch"}, "tilt_as"),
        ({"focal_as": "pixels"}, "focal_as"),
        ({"k2_of_k1": "free"}, "k2_of_k1"),
        ({"portrait": 1.5}, "portrait"),
        ({"frame_height_mm": 0}, "frame_height_mm"),
        ({"aspect": {}}, "aspect"),
        ({"aspect": {"4x3": 1}}, "4x3"),
        ({"aspect": {"4:0": 1}}, "4:0"),
        ({"focal": {"kind": "uniform", "low": 2, "high": 1}}, "^focal=.*: low=2"),
        ({"roll": 0.3}, "^roll=0.3"),
        ({"k1": []}, "^k1"),
    ],
)
def test_keys_without_meaning_are_named(changes, told):
    with pytest.raises(UserError, match=told):
        CameraDistribution(**(PLAIN | changes))
