"""What a camera sees of up, against its own projection, and cameras fitted to it."""

import math

import pytest
import torch
import torch.nn.functional as F

from sextant.geometry import (
    CameraParameters,
    k2_of_k1,
    max_distorted_radius,
    perspective_bearings,
    perspective_project,
    up_in_camera,
)
from sextant.geometry.field_fit import BelievedField, fit_field
from sextant.geometry.perspective_field import PerspectiveField, field_errors, perspective_field

NUMBER = 48


def cameras(seed=0, steepest=1.2):
    numbers = torch.rand(4, NUMBER, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) - 0.5
    tilt, roll, log_focal, k1 = numbers * torch.tensor([[2 * steepest], [1.0], [1.4], [0.3]], dtype=torch.float64)
    return CameraParameters(tilt, roll, log_focal.exp(), k1)


def points(count=40, side=0.9):
    places = torch.rand(NUMBER, count, 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return side * (places - 0.5)


def believed(field, error=0.01, trust=0.0):
    number, count = field.latitude.shape
    return BelievedField(field, torch.full((number, 2, count), math.log(error)), torch.full((number, 4), trust))


def seen(field):
    return torch.ones_like(field.latitude, dtype=torch.bool)


@pytest.mark.parametrize("family", ["lopez", "zero"])
def test_up_is_where_a_point_moves_when_it_is_lifted(family):
    camera, at = cameras(), points()
    found = perspective_field(camera, at, family)
    focal, k1 = camera.focal[:, None], camera.k1[:, None]
    k2, up = k2_of_k1(k1, family), up_in_camera(camera.tilt, camera.roll)[:, None]
    rays = perspective_bearings(at, focal, k1, k2)
    lifted, visible = perspective_project(rays + 1e-6 * up, focal, k1, k2)
    steep = (rays * up).sum(-1).abs() > 0.99
    away = (F.normalize(lifted - at, dim=-1) - found.up).abs().amax(-1)
    assert away[visible & ~steep].max() < 1e-4
    torch.testing.assert_close(torch.sin(found.latitude)[~steep], (rays * up).sum(-1)[~steep])


def test_errors_are_signed_angles():
    camera, at = cameras(), points()
    field = perspective_field(camera, at)
    turned = torch.stack([math.cos(0.3) * field.up[..., 0] - math.sin(0.3) * field.up[..., 1],
                          math.sin(0.3) * field.up[..., 0] + math.cos(0.3) * field.up[..., 1]], -1)  # fmt: skip
    errors = field_errors(PerspectiveField(field.latitude + 0.2, field.up), PerspectiveField(field.latitude, turned))
    torch.testing.assert_close(errors[:, 0], torch.full_like(field.latitude, 0.2))
    torch.testing.assert_close(errors[:, 1], torch.full_like(field.latitude, -0.3), atol=1e-5, rtol=0)


def test_the_camera_that_has_a_field_is_found_from_another():
    """From 0.15 away in tilt and half of that in roll, log focal length and k1."""
    camera, at = cameras(steepest=0.8), points(60)
    field = perspective_field(camera, at)
    start = CameraParameters(
        camera.tilt + 0.15, camera.roll - 0.07, camera.focal * math.exp(0.07), (camera.k1 + 0.07).clamp(-0.3, 0.3)
    )
    found = fit_field(start, believed(field), at, seen(field))
    off = torch.stack([a - b for a, b in zip(found, camera, strict=True)]).abs()
    assert off[:2].quantile(0.9) < 1e-3
    assert off[2:].quantile(0.75) < 0.02


def test_points_outside_the_picture_do_not_count_and_the_start_is_kept_without_any():
    camera, at = cameras(steepest=0.8), points()
    field, other = perspective_field(camera, at), perspective_field(cameras(5), at)
    half = torch.arange(40) < 20
    mixed = PerspectiveField(
        torch.where(half, field.latitude, other.latitude), torch.where(half[:, None], field.up, other.up)
    )
    some = fit_field(camera, believed(mixed, trust=1.0), at, half.expand(NUMBER, -1))
    for a, b in zip(some, camera, strict=True):
        torch.testing.assert_close(a, b, atol=1e-6, rtol=0)
    none = fit_field(camera, believed(other, trust=1.0), at, torch.zeros(NUMBER, 40, dtype=torch.bool))
    for a, b in zip(none, camera, strict=True):
        torch.testing.assert_close(a, b)


def test_a_start_that_is_trusted_is_kept_and_one_that_is_not_is_left():
    camera, at = cameras(steepest=0.8), points()
    field = perspective_field(camera, at)
    start = camera._replace(tilt=camera.tilt + 0.1)
    kept = fit_field(start, believed(field, error=1.0, trust=100.0), at, seen(field))
    left = fit_field(start, believed(field, error=0.01, trust=0.1), at, seen(field))
    assert (kept.tilt - start.tilt).abs().max() < 0.01
    assert (left.tilt - camera.tilt).abs().median() < 0.001


@pytest.mark.parametrize(("log_focal", "k1"), [(-2.5, -1.3), (3.0, 1.6)])
def test_cameras_beyond_what_people_hold_are_within_the_limits(log_focal, k1):
    far = CameraParameters(*torch.tensor([[0.1, 0.05, math.exp(log_focal), k1]] * NUMBER, dtype=torch.float64).T)
    at = points()
    field = perspective_field(far, at)
    for a, b in zip(fit_field(far, believed(field), at, seen(field)), far, strict=True):
        torch.testing.assert_close(a, b, atol=1e-3, rtol=1e-3)


def test_points_beyond_the_fold_of_a_lens_do_not_count():
    """Barrel lenses with k2 = 0, whose fold lies in the picture: gradients there would be thousands of times larger."""
    camera = cameras()._replace(focal=torch.full((NUMBER,), 0.5), k1=torch.full((NUMBER,), -0.35))
    at = points(side=1.0)
    beyond = torch.linalg.vector_norm(at, dim=-1) > 0.5 * max_distorted_radius(torch.tensor(-0.35), torch.tensor(0.0))
    field = perspective_field(camera, at, "zero")
    other = PerspectiveField(torch.where(beyond, 1.0, field.latitude), field.up)
    assert beyond.any()
    for a, b in zip(fit_field(camera, believed(other, trust=1.0), at, seen(field), "zero"), camera, strict=True):
        torch.testing.assert_close(a, b, atol=1e-6, rtol=0, check_dtype=False)


def test_gradients_reach_what_is_believed_and_are_finite_even_straight_up():
    camera = cameras()._replace(tilt=torch.linspace(-math.pi / 2, math.pi / 2, NUMBER, dtype=torch.float64))
    at = points()
    field = perspective_field(camera, at)
    parts = [field.latitude, field.up, torch.zeros(NUMBER, 2, 40), torch.ones(NUMBER, 4)]
    latitude, up, log_error, trust = (each.clone().requires_grad_() for each in parts)
    steep = cameras(3)._replace(tilt=torch.linspace(-1.55, 1.55, NUMBER, dtype=torch.float64))
    start = CameraParameters(*(each.clone().requires_grad_() for each in steep))
    found = fit_field(start, BelievedField(PerspectiveField(latitude, up), log_error, trust), at, seen(field))
    sum(each.sum() for each in found).backward()
    for each in (latitude, up, log_error, trust, *start):
        assert each.grad.isfinite().all()
        assert each.grad.abs().sum() > 0
