import pytest
import torch
from localization.observation.battery import GaussianBattery, elbo, log_density
from localization.observation.smooth_map import KERNEL, poses_in_room, smooth_map

from sextant.localization.observation.sgpr import SGPR
from sextant.localization.observation.svgp import SVGP


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
    assert elbo(svgp) == pytest.approx(elbo(sgpr), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("forgetting", "batch"), [(1.0, 64), (0.7, 64)])
def test_it_converges_to_sgpr_with_the_same_inducing_poses(forgetting, batch):
    """A batch that does not divide the map, so that no whole pass is exact by construction."""
    known, poses = smooth_map(), poses_in_room(100, seed=1)
    sgpr = SGPR(inducing=40).fit(known, KERNEL)
    wanted = sgpr.predict(poses)

    def error(steps: int) -> float:
        model = SVGP(inducing=40, steps=steps, batch=batch, forgetting=forgetting).fit(known, KERNEL)
        assert elbo(model) <= elbo(sgpr) + 1e-6 * abs(elbo(sgpr))
        return float((model.predict(poses).mean - wanted.mean).square().mean().sqrt())

    few, many = error(4), error(2000)
    assert many < 0.02
    assert many < few / 5


def test_the_bound_is_below_the_log_marginal_likelihood_however_few_the_steps():
    known = smooth_map(80)
    exact = log_density(known, KERNEL)
    bounds = [elbo(SVGP(inducing=30, steps=steps, batch=10).fit(known, KERNEL)) for steps in (1, 4, 8, 400)]
    assert max(bounds) <= exact
    assert bounds[-1] > bounds[0]
