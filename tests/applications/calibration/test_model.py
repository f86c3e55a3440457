import math

import pytest
import torch
from cli.photo_calibration.fakes import SPREAD, calibrate, photo

from sextant.applications.calibration.model import CalibrationModel, TrainedModel
from sextant.corruptions import CorruptionSuite
from sextant.geometry import CameraParameters, Parameterization, ParameterSpace, undistort_radius
from sextant.losses import ParameterLoss
from sextant.models import CalibrationNet
from sextant.tasks.calibration.module import Calibration, CalibrationSpec, reported


def test_a_calibration_module_is_such_a_model(tmp_path):
    torch.manual_seed(0)
    parameterization = Parameterization()
    draws = CameraParameters(*(torch.linspace(a, b, 9) for a, b in ((-0.3, 0.3), (-0.2, 0.2), (0.5, 1.4), (-0.4, 0.0))))
    space = ParameterSpace.covering(parameterization, draws)
    low, high = tuple(space.low.tolist()), tuple(space.high.tolist())
    spec = CalibrationSpec(
        height=18, width=24, aspects=(1.0, 4 / 3), low=low, high=high, validation_crops=100, per_panorama=1,
        median=(0.0, 0.0, 0.8, -0.2), spread=SPREAD,
    )  # fmt: skip
    backbone = torch.nn.Sequential(torch.nn.AdaptiveAvgPool2d(2), torch.nn.Flatten(), torch.nn.Linear(24, 8))
    module = Calibration(
        CalibrationNet(backbone, 8), spec, parameterization, ParameterLoss(space), CorruptionSuite({}, 0)
    )
    module.scores.copy_(torch.linspace(0.02, 2, 100)[:, None])
    model = TrainedModel(module)
    assert isinstance(model, CalibrationModel)
    paths = [photo(tmp_path / "a.png"), photo(tmp_path / "b.png", (60, 80), 20)]
    first, second = calibrate(paths, tmp_path / "out", model)
    assert 0.4 < first["focal_px"] / first["seen"]["height"] < 1.6
    assert first["tilt_deg"] != second["tilt_deg"]
    position = model.position(draws)
    assert position.min() > 0
    assert position.max() < 1


def test_sextants_own_reports_are_in_the_order_that_is_assumed_here():
    camera = CameraParameters(*torch.tensor([0.1, 0.2, 0.7, -0.2]).double())
    tilt, roll, vfov, k1_hat = reported(camera).tolist()
    assert (tilt, roll) == pytest.approx((0.1, 0.2))
    assert vfov == pytest.approx(2 * math.atan(0.5 / 0.7))
    assert k1_hat == pytest.approx(-0.2 / 0.49)
    assert Parameterization().names[1:] == ("roll", "vfov", "k1_hat")
    assert undistort_radius(torch.tensor(0.0), torch.tensor(-0.2), torch.tensor(0.03)) == 0
