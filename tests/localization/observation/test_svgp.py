import math

import pytest
import torch
from localization.observation.battery import GaussianBattery
from localization.observation.smooth_map import KERNEL, poses_in_room, smooth_map

from sextant.errors import UserError
from sextant.localization.observation.exact_gp import ExactGP
from sextant.localization.observation.sgpr import SGPR
from sextant.localization.observation.svgp import SVGP


def elbo(model):
    """The lower bound on the log marginal likelihood of all outputs in nats."""
    known, noise = model.map, model.kernel.noise_variance
    predicted = model.predict(known.poses)
    squared = float((known.descriptors.double() - predicted.mean).square().sum())
    left = float((predicted.variance - noise).sum())
    numbers = known.descriptors.numel()
    expected = -0.5 * (numbers * math.log(2 * math.pi * noise) + (squared + known.dimension * left) / noise)
    spread = float(model.root.square().sum()) - model.size - float(2 * model.root.diagonal().log().sum())
    return expected - 0.5 * (float(model.weights.square().sum()) + known.dimension * spread)


class TestSVGPPassesTheBattery(GaussianBattery):
    mean_tolerance, nll_tolerance = 0.08, 0.06

    def model(self):
        return SVGP(inducing=160, steps=120, batch=60)


def test_one_step_with_the_whole_map_is_sgpr():
    known, poses = smooth_map(), poses_in_room(50, seed=1)
    sgpr = SGPR(inducing=40).fit(known, KERNEL)
    svgp = SVGP(inducing=40, steps=1, batch=1000).fit(known, KERNEL)
    torch.testing.assert_close(svgp.predict(poses).mean, sgpr.predict(poses).mean, rtol=0, atol=1e-8)
    torch.testing.assert_close(svgp.predict(poses).variance, sgpr.predict(poses).variance)
    assert elbo(svgp) == pytest.approx(sgpr.elbo(), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("forgetting", "batch"), [(1.0, 64), (0.7, 64)])
def test_it_converges_to_sgpr_with_the_same_inducing_poses(forgetting, batch):
    """A batch that does not divide the map, so that no whole pass is exact by construction."""
    known, poses = smooth_map(), poses_in_room(100, seed=1)
    sgpr = SGPR(inducing=40).fit(known, KERNEL)
    wanted = sgpr.predict(poses)

    def error(steps: int) -> float:
        model = SVGP(inducing=40, steps=steps, batch=batch, forgetting=forgetting).fit(known, KERNEL)
        assert elbo(model) <= sgpr.elbo() + 1e-6 * abs(sgpr.elbo())
        return float((model.predict(poses).mean - wanted.mean).square().mean().sqrt())

    few, many = error(4), error(2000)
    assert many < 0.02
    assert many < few / 5


def test_the_bound_is_below_the_log_marginal_likelihood_however_few_the_steps():
    known = smooth_map(80)
    exact = ExactGP().fit(known, KERNEL).log_marginal_likelihood()
    bounds = [elbo(SVGP(inducing=30, steps=steps, batch=10).fit(known, KERNEL)) for steps in (1, 4, 8, 400)]
    assert max(bounds) <= exact
    assert bounds[-1] > bounds[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"steps": 0}, r"steps=0 must be at least 1"),
        ({"batch": 0}, r"batch=0 must be at least 1"),
        ({"forgetting": 0.5}, r"forgetting=0.5 must be above 0.5"),
        ({"inducing": 0}, r"inducing=0"),
    ],
)
def test_sizes_that_make_no_sense_are_refused(arguments, message):
    with pytest.raises(UserError, match=message):
        SVGP(**{"inducing": 5} | arguments)
