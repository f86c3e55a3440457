"""Where a map tells anything, and what an image is worth off it."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError

from sextant.errors import ArgumentError, UserError
from sextant.localization.belief import Belief
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.map_support import EvidenceOnMap, MapSupport, heading_reach, map_spacing
from sextant.localization.observation.cached_local_gp import CachedLocalGP
from sextant.localization.pose_kernel import PoseKernel


def poses_at(*rows):
    return torch.tensor(rows, dtype=torch.float64)


def line(count=20, step=1.0):
    return poses_at(*[(step * i, 0.0, 0.0) for i in range(count)])


@pytest.mark.parametrize("step", [0.01, 0.3, 200.0])
@pytest.mark.parametrize("turned", [0.0, 0.7, 2.0])
def test_the_spacing_of_a_line_is_its_step_however_it_lies(step, turned):
    along = torch.arange(30, dtype=torch.float64) * step
    poses = torch.stack([along * math.cos(turned), along * math.sin(turned), along * 0 + turned], dim=1)
    assert map_spacing(poses) == pytest.approx(step)


def test_the_spacing_of_an_area_is_that_of_its_rows():
    grid = poses_at(*[(0.5 * i, 2.0 * j, 0.0) for i in range(12) for j in range(12)])
    assert map_spacing(grid) == pytest.approx(2.0)
    rng = np.random.default_rng(0)  # at random, one image to a square metre: half of a metre to the very nearest
    scattered = np.column_stack([rng.uniform(0, 30, (900, 2)), np.zeros(900)])
    assert 0.8 < map_spacing(torch.from_numpy(scattered)) < 1.6


def test_headings_at_one_place_are_told_apart_by_half_their_turn():
    around = poses_at(*[(3.0 * i, 0.0, math.radians(45 * k)) for i in range(5) for k in range(8)])
    assert map_spacing(around) == pytest.approx(3.0)
    assert heading_reach(around) == pytest.approx(math.radians(22.5))
    assert heading_reach(line()) == pytest.approx(math.radians(10))
    assert map_spacing(poses_at((1.0, 2.0, 3.0))) == 1.0


@pytest.mark.parametrize(
    ("headings", "reach"),
    [
        ((-170, 170), 10),
        ((-175, 165), 10),
        ((0, 360), 10),
        ((350, 25, 60), 17.5),
        ((0, 90, 180, 270), 45),
        ((-90, 90), 90),
    ],
)
def test_headings_go_round(headings, reach):
    poses = poses_at(*[(3.0 * i, 0.0, math.radians(turn)) for i in range(3) for turn in headings])
    assert math.degrees(heading_reach(poses)) == pytest.approx(reach)


def test_the_share_of_the_map_is_one_between_its_images_and_falls_to_the_sides():
    support = MapSupport.of(line(step=2.0))
    assert support.reach == pytest.approx(1.0)
    wanted = {
        (5.0, 0.0, 0.0): 1.0,  # halfway
        (4.0, 1.5, 0.0): math.exp(-2 * 0.5**2),
        (4.0, -2.0, 0.0): math.exp(-2.0),
        (45.0, 0.0, 0.0): 0.0,  # beyond the end
        (4.0, 0.0, math.pi): 0.0,
        (4.0, 0.0, math.radians(9)): 1.0,
    }
    found = support.share(poses_at(*wanted)[None])[0]
    assert found.tolist() == pytest.approx(list(wanted.values()), abs=1e-6)


def fitted(seed=0, dimension=64):
    rng = torch.Generator().manual_seed(seed)
    descriptors = torch.randn(20, dimension, generator=rng) * 0.1
    kernel = PoseKernel("rbf", (1.0, 1.0), 1.0, 0.01, 0.001)
    return CachedLocalGP(8, map_evidence="mean").fit(DescriptorMap.of(line(), descriptors), kernel)


def test_a_changed_image_is_explained_by_nowhere_but_not_on_the_map():
    model = fitted()
    changed = model.map.descriptors[7] + 0.15 * torch.randn(64, generator=torch.Generator().manual_seed(1))
    evidence = model.observe(changed[None], Likelihood(tempering=0.125))
    there, nowhere = poses_at((7.0, 0.0, 0.0))[None], poses_at((7.0, 40.0, 0.0))[None]
    assert evidence.log_likelihood(nowhere) > evidence.log_likelihood(there) + 1
    on_map = EvidenceOnMap(evidence, MapSupport.of(model.map.poses))
    assert on_map.log_likelihood(there) > on_map.log_likelihood(nowhere)


def test_off_the_map_an_image_is_worth_what_it_is_at_any_place_of_it():
    model, support = fitted(), MapSupport.of(line())
    evidence = model.observe(model.map.descriptors[3:4], Likelihood(tempering=0.125))
    poses = poses_at((3.1, 0.2, 0.1), (3.0, 0.9, 0.0), (500.0, 0.0, 0.0))[None]
    own, over, share = evidence.log_likelihood(poses).exp(), evidence.over_map().exp().mean(), support.share(poses)
    wanted = 0.99 * share * own + (1 - 0.99 * share) * over
    on_map = EvidenceOnMap(evidence, support)
    assert torch.allclose(on_map.log_likelihood(poses).exp(), wanted, rtol=1e-10)
    assert float(on_map.log_likelihood(poses)[0, 2]) == pytest.approx(float(over.log()))
    assert torch.equal(on_map.over_map(), evidence.over_map())


def test_an_image_of_nan_tells_nothing_anywhere():
    model = fitted()
    evidence = model.observe(torch.full((1, 64), torch.nan), Likelihood())
    told = EvidenceOnMap(evidence, MapSupport.of(line())).log_likelihood(line()[None])
    assert not bool(torch.isfinite(told).any())


def test_the_belief_holds_the_chance_of_leaving_once_however_long_the_way():
    support = MapSupport.of(line())
    rng = torch.Generator().manual_seed(0)
    way = torch.randn(1, 30, 3, generator=rng, dtype=torch.float64).cumsum(1) * torch.tensor([1.0, 0.3, 0.05])
    steps = support.log_change(way[:, :-1], way[:, 1:])
    assert float(steps.sum()) == pytest.approx(float(support.log_change(way[:, :1], way[:, -1:])))
    gone = poses_at((3.0, 0.0, 0.0), (3.0, 50.0, 0.0))
    assert float(support.log_change(gone[None, :1], gone[None, 1:])) == pytest.approx(math.log(0.01))


def test_what_is_off_the_map_is_summed_by_weight():
    support = MapSupport.of(line())
    belief = Belief.of(poses_at((3.0, 0.0, 0.0), (3.0, 50.0, 0.0))[None], torch.tensor([[0.3, 0.7]]).double().log())
    assert float(support.off_map(belief)) == pytest.approx(0.7)


@pytest.mark.parametrize("reach", [0.0, -1.0, math.nan])
def test_a_reach_out_of_range_is_named(reach):
    with pytest.raises(ArgumentError, match=f"reach={reach} must"):
        MapSupport(line(), reach)


def test_everywhere_an_image_that_tells_nothing_costs_no_more_than_how_seldom_that_is():
    support, model = MapSupport.everywhere(line(), outliers=0.2), fitted()
    evidence = model.observe(torch.full((1, 64), 50.0), Likelihood())
    poses = poses_at((3.0, 0.0, 0.0), (3.0, 50.0, 1.0), (1e6, 0.0, 0.0))[None]
    told, plain = EvidenceOnMap(evidence, support).log_likelihood(poses), evidence.log_likelihood(poses)
    mean = evidence.over_map().logsumexp(1) - math.log(20)
    expected = torch.logaddexp(plain + math.log(0.8), mean + math.log(0.2))
    torch.testing.assert_close(told, expected)
    assert float((told - mean).min()) >= math.log(0.2) - 1e-9
    assert support.log_change(poses, poses + 100).abs().max() == 0
    assert support.off_map(Belief.uniform(poses)).tolist() == [0.0]


def loop(step: float = 0.1) -> torch.Tensor:
    """Poses along a square of 10 m."""
    along = torch.arange(0, 10, step, dtype=torch.float64)
    still = torch.zeros_like(along)
    sides = [(along, still), (still + 10, along), (10 - along, still + 10), (still, 10 - along)]
    turns = (0.0, math.pi / 2, math.pi, -math.pi / 2)
    return torch.cat([torch.stack([x, y, still + turn], 1) for (x, y), turn in zip(sides, turns, strict=True)])


def test_a_dense_map_reaches_as_far_as_its_kernel_was_learnt_to():
    kernel = PoseKernel("rbf", (0.4, 0.6), 0.5, 1.0, 0.1)
    assert MapSupport.of(loop(), kernel).reach == pytest.approx(0.6)
    beside = loop() + torch.tensor([0.0, 0.2, 0.0], dtype=torch.float64)
    assert float(MapSupport.of(loop(), kernel).share(beside).min()) > 0.99
    assert float(MapSupport.of(loop()).share(beside).median()) < 0.01  # by its spacing of 0.1 m alone


def test_the_images_of_a_city_do_not_reach_into_its_houses():
    """A kernel of 23 m in a map with an image every 7 m, which explains less than half of what images show."""
    kernel = PoseKernel("rbf", (0.33, 0.38), 0.5, 0.85, 1.0)
    assert MapSupport.of(loop(), replace(kernel, noise_variance=0.8)).reach == pytest.approx(0.495)
    assert MapSupport.of(loop(), kernel).reach == MapSupport.of(loop()).reach


def test_a_kernel_learnt_along_one_line_tells_nothing_of_poses_aside():
    kernel = PoseKernel("rbf", (3.0, 4.0), 0.5, 1.0, 0.1)
    assert MapSupport.of(line(), kernel).reach == MapSupport.of(line()).reach


def test_a_kernel_shorter_than_the_spacing_leaves_no_gaps():
    kernel = PoseKernel("rbf", (0.01, 0.01), 0.5, 1.0, 0.1)
    assert MapSupport.of(loop(), kernel).reach == MapSupport.of(loop()).reach


def test_a_sparse_map_reaches_half_its_spacing_whatever_its_kernel():
    """A kernel of 1.5 spacings, as of a town with an image every 3 m."""
    kernel = PoseKernel("rbf", (0.64, 0.46), 0.5, 1.0, 0.1)
    assert MapSupport.of(loop(step=0.3), kernel).reach == pytest.approx(0.15, rel=0.1)
    assert MapSupport.of(loop(step=0.08), kernel).reach == pytest.approx(0.69)


@pytest.mark.parametrize("poses", [line() * math.nan, line()[:, :2]])
def test_poses_are_three_finite_numbers(poses):
    with pytest.raises((UserError, TypeCheckError), match=r"not finite|must have|Type-check error"):
        MapSupport(poses, 1.0)
