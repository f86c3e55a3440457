"""The panorama: known directions, there and back, at the seam and at the poles."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.errors import UserError
from sextant.geometry import EquirectangularCamera

CAMERA = EquirectangularCamera(360, 180)  # one pixel a degree


@pytest.mark.parametrize(
    ("direction", "pixel"),
    [
        ((0, 0, 1), (180, 90)),  # forward
        ((1, 0, 0), (270, 90)),  # right
        ((-1, 0, 0), (90, 90)),  # left
        ((0, 0, -1), (0, 90)),  # backward, from the right of the seam
        ((-0.0, 0, -1), (0, 90)),  # and from its left
        ((0, -1, 1), (180, 45)),  # half up
        ((1, 2**0.5, 1), (225, 135)),  # half down, half right
        ((0, -5, 0), (180, 0)),  # the pole above
        ((0, 2, 0), (180, 180)),  # the pole below
    ],
)
def test_known_directions(direction, pixel):
    direction = torch.tensor(direction, dtype=torch.float64)
    pixels, visible = CAMERA.project(direction)
    assert visible
    assert pixels.tolist() == pytest.approx(pixel, abs=1e-12)
    torch.testing.assert_close(CAMERA.bearings(pixels), direction / direction.norm(), rtol=0, atol=1e-14)


@given(st.integers(1, 20), st.integers(1, 3), st.sampled_from([torch.float32, torch.float64]))
def test_the_pixel_of_a_pixels_ray_is_the_pixel(height, samples, dtype):
    camera = EquirectangularCamera(2 * height, height)
    grid = camera.ray_grid(samples, dtype=dtype)
    bearings = camera.bearings(grid)
    torch.testing.assert_close(bearings.norm(dim=-1), torch.ones_like(grid[..., 0]))
    pixels, visible = camera.project(2 * bearings)
    assert visible.all()
    torch.testing.assert_close(pixels, grid, rtol=0, atol=1e4 * torch.finfo(dtype).eps)


@given(st.floats(-1e-3, 1e-3), st.floats(1.0, 179.0))
def test_the_left_and_right_edges_are_one_meridian(offset, row):
    here, there = CAMERA.bearings(torch.tensor([[offset, row], [360 + offset, row]], dtype=torch.float64))
    torch.testing.assert_close(here, there)
    pixels, _ = CAMERA.project(here)
    assert 0 <= pixels[0] <= 360  # 360 by rounding alone
    assert min(abs(pixels[0] - offset % 360), 360 - abs(pixels[0] - offset % 360)) < 1e-9


def test_the_mean_direction_of_an_evenly_weighted_sphere_is_none():
    bearings = CAMERA.bearings(CAMERA.pixel_centres(dtype=torch.float64))
    area = (1 - bearings[..., 1] ** 2).sqrt()  # of a pixel: the cosine of its latitude
    mean = (area[..., None] * bearings).sum(dim=(0, 1)) / area.sum()
    torch.testing.assert_close(mean, torch.zeros_like(mean), rtol=0, atol=1e-12)
    second = torch.einsum("hw,hwi,hwj->ij", area, bearings, bearings) / area.sum()
    torch.testing.assert_close(second, torch.eye(3, dtype=second.dtype) / 3, rtol=0, atol=1e-4)


def test_the_direction_of_length_0_is_nowhere():
    _, visible = CAMERA.project(torch.zeros(2, 3))
    assert not visible.any()


def test_gradients_are_those_of_finite_differences_and_finite_at_the_poles():
    points = torch.tensor([[10.0, 20.0], [200.0, 91.0], [350.0, 170.0]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(CAMERA.bearings, [points])
    directions = CAMERA.bearings(points).detach().requires_grad_()
    assert torch.autograd.gradcheck(lambda rays: CAMERA.project(rays)[0], [directions])
    poles = torch.tensor([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 0.0]], requires_grad=True)
    assert torch.autograd.grad(CAMERA.project(poles)[0].sum(), poles)[0].isfinite().all()


@pytest.mark.parametrize(("width", "height"), [(360, 181), (180, 360), (0, 0), (-2, -1)])
def test_other_shapes_are_refused(width, height):
    with pytest.raises(UserError, match=r"twice as wide|at least 1 pixel"):
        EquirectangularCamera(width, height)
