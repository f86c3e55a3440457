"""The checks pass here, and each fails on the defect that it is for."""

import math

import numpy as np
import pytest
import torch

from sextant.chapters.calibration.metrics.doctor import Finding, lens, loss
from sextant.chapters.calibration.metrics.doctor import finding as crops
from sextant.chapters.calibration.metrics.doctor.checks import CHECKS
from sextant.geometry import EquirectangularCamera


def failing(findings):
    return [finding.figure for finding in findings if not finding.passed]


def exact_crop(panorama, cameras, yaw, width, height):
    """Crops by the nearest pixel of the panorama, or by its four neighbours, written apart from the package's."""
    camera = EquirectangularCamera(panorama.shape[1], panorama.shape[0])
    pixels, _ = camera.project(crops.crop_rays(cameras, yaw, width, height))
    x, y = (pixels - 0.5).unbind(-1)
    x0, y0 = x.floor(), y.floor()
    source = torch.from_numpy(panorama).double()
    total = 0
    for dx in (0, 1):
        for dy in (0, 1):
            weight = (1 - (x - x0 - dx).abs()) * (1 - (y - y0 - dy).abs())
            column, row = (x0 + dx).long() % camera.width, (y0 + dy).long().clamp(0, camera.height - 1)
            total = total + weight[..., None] * source[row, column]
    return total.round().to(torch.uint8).movedim(-1, 1).numpy()


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_checks_pass(check):
    findings = check()
    assert findings
    assert failing(findings) == []
    assert all(math.isfinite(finding.value) for finding in findings)


@pytest.mark.slow
def test_the_cross_talk_table_is_the_designs():
    table = loss.cross_talk()
    figures = [(row.wrong, round(row.before_deg, 2), round(row.after_deg, 2)) for row in table]
    assert figures == [
        ("vfov +5 deg", 2.55, 1.36),
        ("vfov -5 deg", 2.60, 1.21),
        ("k1_hat +0.1", 1.89, 1.05),
        ("rho +0.05", 3.12, 2.51),
    ]
    assert table[0].joint[3] == pytest.approx(0.108, abs=1e-3)
    assert table[1].joint[3] == pytest.approx(-0.140, abs=1e-3)
    assert math.degrees(table[2].joint[2]) == pytest.approx(3.2, abs=0.05)
    assert math.degrees(table[3].joint[2]) == pytest.approx(-5.9, abs=0.1)
    assert table[3].joint[3] == pytest.approx(-0.170, abs=1e-3)
    assert failing(loss.cross_talk_findings(table)) == []


def test_crops_that_are_right_pass():
    assert failing(crops.crop_against_render(exact_crop)) == []
    assert failing(crops.edge_in_crop(exact_crop)) == []


@pytest.mark.parametrize("defect", ["yaw the other way", "no distortion", "half a pixel", "roll the other way", "seam"])
def test_crops_that_are_wrong_fail(defect):
    def crop(panorama, cameras, yaw, width, height):
        if defect == "yaw the other way":
            yaw = -yaw
        elif defect == "no distortion":
            cameras = cameras._replace(k1=0 * cameras.k1)
        elif defect == "half a pixel":
            return exact_crop(np.roll(panorama, 1, 1), cameras, yaw + math.pi / panorama.shape[1] * 4, width, height)
        elif defect == "roll the other way":
            cameras = cameras._replace(roll=-cameras.roll)
        else:
            panorama = panorama.copy()
            panorama[:, 0] = 0
        return exact_crop(panorama, cameras, yaw, width, height)

    assert failing(crops.crop_against_render(crop))


def test_an_edge_that_is_cropped_without_distortion_is_not_straight_when_undistorted():
    def crop(panorama, cameras, yaw, width, height):
        return exact_crop(panorama, cameras._replace(k1=0 * cameras.k1), yaw, width, height)

    assert len(failing(crops.edge_in_crop(crop))) == 2


def test_a_crop_that_shows_nothing_fails():
    def crop(panorama, cameras, yaw, width, height):
        return np.zeros((len(yaw), 3, height, width), np.uint8)

    assert len(failing(crops.edge_in_crop(crop))) == 2
    assert len(failing(crops.crop_against_render(crop))) == 2


def test_undistortion_by_a_few_steps_of_a_fixed_point_fails(monkeypatch):
    def fixed_point(distorted, k1, k2):
        radius = distorted
        for _ in range(10):
            radius = distorted / (1 + k1 * radius**2 + k2 * radius**4)
        return radius

    monkeypatch.setattr(lens, "undistort_radius", fixed_point)
    assert failing(lens.newton_against_bisection())


def test_gradients_a_thousandth_off_fail(monkeypatch):
    right = lens.undistort_radius

    def short(*inputs):
        radius = right(*inputs)
        return radius.detach() + 0.999 * (radius - radius.detach())

    monkeypatch.setattr(lens, "undistort_radius", short)
    assert failing(lens.implicit_gradients())


def test_a_foot_on_the_centre_line_fails(monkeypatch):
    def crossing(rho, roll):
        return torch.stack([torch.zeros_like(rho), rho / torch.cos(roll)], -1)

    monkeypatch.setattr(lens, "horizon_foot", crossing)
    assert failing(lens.horizon_feet())


def test_pixels_half_a_pixel_off_fail_against_opencv(monkeypatch):
    right = lens.opencv_from_perspective

    def centred(camera):
        matrix, distortion = right(camera)
        matrix[..., :2, 2] += 0.5
        return matrix, distortion

    monkeypatch.setattr(lens, "opencv_from_perspective", centred)
    assert failing(lens.against_opencv()) == [
        "projectPoints, r <= 1: pixels",
        "undistortPoints, 200 iterations, r <= 1",
    ]


def test_a_loss_that_is_not_squared_fails(monkeypatch):
    right = loss.bearing_difference
    monkeypatch.setattr(loss, "bearing_difference", lambda *inputs: right(*inputs).sqrt())
    assert len(failing(loss.closed_forms())) == 4


@pytest.mark.parametrize(("value", "passed"), [(0.5, True), (1.5, False), (-0.1, False), (math.nan, False)])
def test_a_finding_passes_between_its_limits(value, passed):
    assert Finding("check", "figure", value, 1.0).passed is passed
