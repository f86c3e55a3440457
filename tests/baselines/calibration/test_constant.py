import numpy as np
import pytest
import torch

from sextant.baselines.calibration import CameraPrior, ConstantCamera, PriorCamera, prior_of_cameras
from sextant.errors import UserError
from sextant.geometry import CameraParameters

IMAGES = np.zeros((2, 8, 9, 3), np.uint8)


def training(count=501):
    g = torch.Generator().manual_seed(0)
    draw = [torch.rand(count, generator=g, dtype=torch.float64) for _ in range(4)]
    return CameraParameters(draw[0] - 0.3, 0.2 * draw[1], 0.6 + draw[2], -0.4 * draw[3])


def test_the_constant_camera_is_the_best_constant_in_mean_absolute_error():
    cameras = training()
    constant = ConstantCamera().fit(cameras).calibrate_many(IMAGES)
    for truth, value in zip(cameras, constant, strict=True):
        best = (truth - value[0]).abs().mean()
        assert value.shape == (2,)
        assert all(best <= (truth - value[0] - shift).abs().mean() for shift in (-0.02, 0.02))


def test_the_prior_camera_is_level_and_straight_with_the_median_field_of_view():
    cameras = training()
    tilt, roll, focal, k1 = PriorCamera().fit(cameras).calibrate_many(IMAGES)
    assert tilt.abs().max() == roll.abs().max() == k1.abs().max() == 0
    torch.testing.assert_close(focal[0], cameras.focal.median(), rtol=1e-6, atol=0)


def test_constants_determine_nothing_and_say_how_unsure_they_are():
    estimate = PriorCamera(CameraPrior(sigma=(0.1, 0.2, 0.3, 0.4))).calibrate(IMAGES[0])
    assert not any(estimate.determined)
    assert estimate.sigma.tilt == pytest.approx(0.1)
    assert estimate.sigma.focal == pytest.approx(0.3 * 0.87)
    assert estimate.sigma.k1 == pytest.approx(0.4 * 0.87**2)


def test_spread_is_that_of_a_gaussian():
    g = torch.Generator().manual_seed(1)
    x = torch.randn(4, 20_000, generator=g, dtype=torch.float64)
    cameras = CameraParameters(0.3 * x[0], 0.1 * x[1], torch.exp(0.2 * x[2]), 0.05 * x[3])
    np.testing.assert_allclose(prior_of_cameras(cameras).sigma[:3], [0.3, 0.1, 0.2], rtol=0.04)


def test_equal_labels_give_a_usable_prior():
    one = CameraParameters(*(torch.full((5,), value) for value in (0.1, 0.0, 0.9, -0.1)))
    assert min(prior_of_cameras(one).sigma) > 0


@pytest.mark.parametrize("wrong", [{"focal": 0.0}, {"tilt": float("nan")}, {"sigma": (0.1, 0.1, 0.0, 0.1)}])
def test_impossible_beliefs_are_refused(wrong):
    with pytest.raises(UserError, match="focal > 0 and sigma > 0"):
        CameraPrior(**wrong)


def test_no_cameras_are_refused():
    with pytest.raises(ValueError, match="at least one camera"):
        ConstantCamera().fit(CameraParameters(*(torch.zeros(0) for _ in range(4))))
