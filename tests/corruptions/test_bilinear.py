import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from sextant.corruptions.filtering import _gathered, bilinear

SCIPY = {"reflect": "reflect", "mirror": "mirror", "nearest": "nearest"}


def a_case(height, width, seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2, 3, (2, 2, 5, 7)) * np.array([height, width])[:, None, None, None]
    return torch.from_numpy(rng.random((2, 3, height, width))), *torch.from_numpy(points)


@given(st.integers(1, 9), st.integers(1, 9), st.sampled_from(sorted(SCIPY)), st.integers(0, 99))
def test_it_is_scipys_interpolation_of_order_one(height, width, border, seed):
    images, rows, columns = a_case(height, width, seed)
    found = bilinear(images, rows, columns, border)
    for b in range(2):
        for c in range(3):
            points = [rows[b].numpy(), columns[b].numpy()]
            expected = ndimage.map_coordinates(images[b, c].numpy(), points, order=1, mode=SCIPY[border])
            np.testing.assert_allclose(found[b, c], expected, atol=1e-12)


@given(st.integers(1, 9), st.integers(1, 9), st.sampled_from(["reflect", "mirror", "nearest", "zero"]))
def test_the_paths_of_all_devices_agree(height, width, border):
    images, rows, columns = a_case(height, width, 0)
    torch.testing.assert_close(
        bilinear(images, rows, columns, border), _gathered(images, rows, columns, border), rtol=0, atol=1e-14
    )


def test_outside_of_zero_is_black_and_fades_within_a_pixel():
    images = torch.ones(1, 1, 4, 4)
    places = torch.tensor([-2.0, -1.0, -0.25, 0.0, 3.0, 3.5, 4.0, 9.0])
    found = bilinear(images, torch.ones(1, 1, 8), places.view(1, 1, 8), "zero")
    torch.testing.assert_close(found.flatten(), torch.tensor([0, 0, 0.75, 1, 1, 0.5, 0, 0]))


def test_whole_pixels_are_returned_as_they_are():
    images = torch.rand(2, 3, 6, 5)
    rows, columns = torch.meshgrid(torch.arange(6.0), torch.arange(5.0), indexing="ij")
    for border in ("reflect", "mirror", "nearest", "zero"):
        assert torch.equal(bilinear(images, rows.expand(2, -1, -1), columns.expand(2, -1, -1), border), images)
