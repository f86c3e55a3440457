"""Sample points of pixels, and which pixels are on the image."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.errors import UserError
from sextant.geometry import EquirectangularCamera, PerspectiveCamera, level_camera_pose


@given(st.integers(1, 6), st.integers(1, 6), st.integers(1, 4))
def test_samples_are_regular_inside_their_pixel_with_its_centre_as_mean(width, height, samples):
    camera = PerspectiveCamera.from_focal(5.0, width, height)
    grid, centres = camera.ray_grid(samples), camera.pixel_centres()
    assert grid.shape == (height, width, samples**2, 2)
    torch.testing.assert_close(grid.mean(dim=2), centres)
    for row in range(height):
        for column in range(width):
            assert centres[row, column].tolist() == [column + 0.5, row + 0.5]
            expected = [
                [column + (i + 0.5) / samples, row + (j + 0.5) / samples]
                for j in range(samples)
                for i in range(samples)
            ]
            torch.testing.assert_close(grid[row, column], torch.tensor(expected))


def test_type_is_as_asked():
    assert EquirectangularCamera(4, 2).ray_grid(2, dtype=torch.float64).dtype == torch.float64
    assert EquirectangularCamera(4, 2).pixel_centres(device="meta").device.type == "meta"


def test_less_than_one_sample_is_refused():
    with pytest.raises(ValueError, match="at least 1"):
        EquirectangularCamera(4, 2).ray_grid(0)


def test_the_image_holds_its_top_left_border_but_not_its_bottom_right():
    points = torch.tensor([[0.0, 0.0], [3.99, 1.99], [4.0, 1.0], [1.0, 2.0], [-0.01, 1.0], [1.0, -0.01]])
    assert EquirectangularCamera(4, 2).contains(points).tolist() == [True, True, False, False, False, False]


@pytest.mark.parametrize("camera", [PerspectiveCamera.from_focal(1.0, 7, 5), EquirectangularCamera(10, 5)])
def test_whole_numbers_are_the_same_pixels_and_directions(camera):
    points, directions = torch.tensor([[0, 0], [3, 2], [6, 4]]), torch.tensor([[1, 0, 2], [0, -1, 1]])
    torch.testing.assert_close(camera.bearings(points), camera.bearings(points.float()))
    torch.testing.assert_close(camera.project(directions), camera.project(directions.float()))


def test_whole_numbers_truncate_no_others():
    assert PerspectiveCamera.from_focal(torch.tensor(1), 7, 5, k1=-0.2).k1.item() == pytest.approx(-0.2)
    assert level_camera_pose(torch.tensor(1), 2.5, 1.5, 0.0)[:3, 3].tolist() == [1.0, 2.5, 1.5]


@pytest.mark.parametrize("camera", [PerspectiveCamera.from_focal(1.0, 6, 5), EquirectangularCamera(10, 5)])
def test_points_and_directions_of_another_shape_are_refused(camera):
    for shape in ((4, 1), (2, 3), ()):
        with pytest.raises(UserError, match=r"points has the shape .* but must have \(\.\.\., 2\)"):
            camera.bearings(torch.ones(shape))
    for shape in ((4, 1), (3, 2), ()):
        with pytest.raises(UserError, match=r"directions has the shape .* but must have \(\.\.\., 3\)"):
            camera.project(torch.ones(shape))


@pytest.mark.parametrize("size", [(6.4, 5), (6, 5.0), (True, 5), ("6", 5)])
def test_sides_are_whole_numbers_of_pixels(size):
    with pytest.raises(UserError, match="whole numbers of at least 1 pixel"):
        PerspectiveCamera.from_focal(1.0, *size)
