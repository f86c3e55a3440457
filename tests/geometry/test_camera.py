"""Sample points of pixels, and which pixels are on the image."""

import math
import re

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.errors import ArgumentError, UserError
from sextant.geometry import EquirectangularCamera, PerspectiveCamera, heights_from_pixels, pixels_from_heights
from sextant.geometry.camera import check_image_size


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


@pytest.mark.parametrize(
    ("width", "height"), [(math.nan, 2), (4, math.inf), (4.5, 2), (4, np.float64(2.5)), (torch.tensor(4.5), 2)]
)
def test_an_image_has_whole_pixels(width, height):
    with pytest.raises(UserError, match="whole numbers, at least 1 pixel"):
        check_image_size(width, height)


@pytest.mark.parametrize(("width", "height"), [(4.0, 2), (np.int64(4), np.float32(2)), (torch.tensor(4), 2)])
def test_whole_numbers_are_sizes_whatever_their_type(width, height):
    check_image_size(width, height)


@pytest.mark.parametrize("camera", [PerspectiveCamera.from_focal(2.0, 11, 5), EquirectangularCamera(10, 5)])
def test_integer_pixels_are_those_of_floats(camera):
    points = torch.tensor([[3, 2], [5, 0]])
    assert torch.equal(camera.bearings(points), camera.bearings(points.float()))
    for convert in (heights_from_pixels, pixels_from_heights):
        assert torch.equal(convert(points, 11, 5), convert(points.float(), 11, 5))


@pytest.mark.parametrize("camera", [PerspectiveCamera.from_focal(1.0, 4, 2), EquirectangularCamera(4, 2)])
@pytest.mark.parametrize("shape", [(5, 1), (4,)])
def test_points_and_directions_with_other_numbers_of_components_are_refused(camera, shape):
    for name, convert, count in (("points", camera.bearings, 2), ("directions", camera.project, 3)):
        told = f"{name} has the shape {shape}, but must have (..., {count})"
        with pytest.raises(ArgumentError, match=re.escape(told)):
            convert(torch.ones(shape))


def test_projection_is_one_graph():
    directions, project = torch.rand(5, 3), PerspectiveCamera.from_focal(1.0, 4, 2, k1=-0.1).project
    pixels, _ = torch.compile(project, fullgraph=True, backend="eager")(directions)
    assert torch.equal(pixels, project(directions)[0])
