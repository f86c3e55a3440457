import math

import pytest
import torch
from jaxtyping import TypeCheckError
from small_worlds import Told, generator, peaks

from sextant.errors import UserError
from sextant.geometry import wrap_angle
from sextant.localization.initialisation import AppearanceStart, GaussianStart, UniformStart
from sextant.localization.map_prior import MapPrior

MAP = torch.zeros(40, 3, dtype=torch.float64)
MAP[:, 0] = torch.arange(40)
PRIOR = MapPrior(MAP, (0.2, 0.0), 0.0)
HERE = peaks([(12.0, 1.0)], 0.8, 0, floor=1e-9)


def test_a_uniform_start_is_the_prior():
    belief = UniformStart().start(PRIOR, 2, 500, None, None, generator(1))
    assert torch.equal(belief.poses, PRIOR.sample(2, 500, generator(1)))
    torch.testing.assert_close(belief.weights, torch.full((2, 500), 1 / 500).double())


def test_a_gaussian_start_has_a_mean_for_each_run():
    mean = torch.tensor([[1.0, 2.0, 3.1], [-5.0, 0.0, 0.0]], dtype=torch.float64)
    belief = GaussianStart(mean, (0.5, 0.2, 0.1)).start(PRIOR, 2, 20_000, None, None, generator())
    apart = belief.poses - mean[:, None]
    apart[..., 2] = wrap_angle(apart[..., 2])
    assert float(apart.mean(1).abs().max()) < 0.02
    torch.testing.assert_close(apart.std(1), torch.tensor([[0.5, 0.2, 0.1]] * 2).double(), rtol=0.03, atol=0)
    assert bool((belief.poses[..., 2].abs() <= math.pi).all())


def test_one_pose_may_serve_all_runs():
    mean = torch.tensor([[1.0, 2.0, 0.3]], dtype=torch.float64)
    belief = GaussianStart(mean, (0.0, 0.0, 0.0)).start(PRIOR, 3, 4, None, None, generator())
    torch.testing.assert_close(belief.poses, mean[:, None].expand(3, 4, 3))


def test_appearance_puts_particles_where_the_image_looks_like():
    belief = AppearanceStart().start(PRIOR, 2, 300, Told([HERE, HERE], MAP), None, generator())
    mean = (belief.weights * belief.poses[..., 0]).sum(1)
    torch.testing.assert_close(mean, torch.full((2,), 12.0).double(), rtol=0, atol=0.15)
    assert AppearanceStart.uses_evidence
    assert not UniformStart.uses_evidence


def test_runs_without_a_first_image_start_anywhere():
    nothing = lambda poses: torch.full(poses.shape[:-1], -math.inf).double()  # noqa: E731
    broken = lambda poses: torch.full(poses.shape[:-1], math.nan).double()  # noqa: E731
    told = Told([HERE, HERE, nothing, broken], MAP)
    seen = torch.tensor([True, False, True, True])
    belief = AppearanceStart().start(PRIOR, 4, 2000, told, seen, generator())
    spread = belief.poses[..., 0].std(1)
    assert float(spread[0]) < 1.5
    assert float(spread[1:].min()) > 10
    torch.testing.assert_close(belief.weights, torch.full((4, 2000), 1 / 2000).double())
    assert float(AppearanceStart().start(PRIOR, 1, 500, None, None, generator()).poses[..., 0].std()) > 10


def test_arguments_out_of_range_are_refused():
    with pytest.raises(UserError, match=r"sigma"):
        GaussianStart(torch.zeros(1, 3).double(), (0.1, -0.1, 0.0))
    with pytest.raises(ValueError, match="not finite"):
        GaussianStart(torch.full((1, 3), math.nan).double(), (0.1, 0.1, 0.0))
    with pytest.raises((UserError, TypeCheckError), match=r"must have \(r, 3\)|Type-check error"):
        GaussianStart(torch.zeros(1, 2).double(), (0.1, 0.1, 0.0))
    with pytest.raises(UserError, match=r"must have \(3, 3\)"):
        GaussianStart(torch.zeros(2, 3).double(), (0.1, 0.1, 0.0)).start(PRIOR, 3, 4, None, None, generator())
