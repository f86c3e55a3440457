"""B-COSFIRE against MATLAB's published result, and against the recipe written out in numpy."""

import numpy as np
import pytest
import torch
from layers.cosfire.cosfire_cases import random_images
from PIL import Image
from scipy.ndimage import correlate

from sextant.errors import ArgumentError, UserError
from sextant.layers.cosfire import BCosfire, Blur, Cosfire, DoGBank, GaborBank, preset
from sextant.layers.cosfire.b_cosfire import scaled


@pytest.fixture(scope="module")
def vessels(real_data):
    """Inverted green channel, field of view, and MATLAB's response and segmentation of a retina of DRIVE."""
    folder = real_data / "cosfire_oracle"
    names = ("01_test.tif", "mask.png", "_MATLAB_output.png", "_MATLAB_output_binary.png")
    retina, mask, response, segmentation = (np.asarray(Image.open(folder / name)) for name in names)
    image = torch.from_numpy((255 - retina[..., 1].astype(np.float64)) / 255)[None, None]
    return image, torch.from_numpy(mask > 0)[None], response, segmentation > 0


@pytest.mark.slow
@pytest.mark.real_data
def test_response_and_segmentation_are_matlabs_to_the_pixel(vessels):
    image, mask, response, segmentation = vessels
    layer = BCosfire()
    assert np.count_nonzero(np.round(scaled(layer(image) * mask)[0].numpy()) != response) == 0
    assert np.count_nonzero(layer.segment(image, mask)[0].numpy() != segmentation) == 0


@pytest.mark.real_data
def test_in_single_precision_the_segmentation_is_the_same_and_hardly_a_pixel_of_the_response_rounds_otherwise(vessels):
    image, mask, response, segmentation = vessels
    layer = BCosfire()
    rounded = np.round(scaled(layer(image.float()) * mask)[0].numpy())
    assert np.count_nonzero(rounded != response) < 1e-4 * response.size
    assert np.abs(rounded - response).max() <= 1
    assert np.count_nonzero(layer.segment(image.float(), mask)[0].numpy() != segmentation) == 0


@pytest.mark.real_data
def test_with_the_maximum_as_blur_the_picture_is_another(vessels):
    image, mask, response, _ = vessels
    bar, end = preset("vessel_drive"), preset("vessel_end_drive")
    for layer in (bar, end):
        layer.blur = Blur(layer.blur.sigma0, layer.blur.alpha, kind="max", reach=3.5)
    other = scaled(BCosfire(bar, end)(image) * mask)[0].numpy()
    assert np.corrcoef(other.ravel(), response.ravel())[0, 1] == pytest.approx(0.997, abs=0.002)
    assert np.abs(np.round(other) - response).max() == pytest.approx(32, abs=4)


def recipe(image, sigma, radii, sigma0, alpha, turns, sides, mode):
    """One filter for bars: parts above (and below) the centre, turned, on blurred maps that are rolled."""

    def line(width, reach):
        weights = np.exp(-(np.arange(-reach, reach + 1) ** 2) / (2 * width**2))
        return np.outer(weights / weights.sum(), weights / weights.sum())

    def blurred(width):
        length = int(6 * width + 0.5)
        return correlate(dog, line(width, (length + 1 - length % 2) // 2), mode=mode)

    reach = int(np.ceil(3 * sigma))
    dog = np.maximum(0, correlate(image, line(sigma / 2, reach) - line(sigma, reach), mode="constant"))
    maps = {rho: blurred((sigma0 + alpha * rho) / 6) for rho in radii}
    best = np.zeros_like(image)
    for turn in turns:
        parts = [maps[0]] if 0 in radii else []
        for rho in radii:
            for side in sides if rho else ():
                angle = np.pi / 2 + side + turn
                dx, dy = (np.round(v, 4) for v in (rho * np.cos(angle), -rho * np.sin(angle)))
                dx, dy = (int(np.sign(v) * np.floor(abs(v) + 0.5)) for v in (dx, dy))
                parts.append(np.roll(maps[rho], (-dy, -dx), (0, 1)))
        best = np.maximum(best, np.prod(parts, 0) ** (1 / len(parts)))
    return best


@pytest.mark.parametrize(("border", "mode"), [("zeros", "constant"), ("reflect", "mirror")])
def test_both_conventions_of_the_blurs_border_are_reached(border, mode):
    """MATLAB's zeros, and the mirror without the border's pixel of the Python port."""
    image = random_images(0, 1, 1, 60, 70)
    bar, end = preset("vessel_drive"), preset("vessel_end_drive")
    for layer in (bar, end):
        layer.blur = Blur(layer.blur.sigma0, layer.blur.alpha, kind="sum", border=border)
    found = BCosfire(bar, end)(image)[0]
    half, whole = np.pi * np.arange(12) / 12, 2 * np.pi * np.arange(24) / 24
    expected = recipe(image[0, 0].numpy(), 2.4, range(0, 9, 2), 3.0, 0.7, half, (0, np.pi), mode)
    expected = expected + recipe(image[0, 0].numpy(), 1.8, range(0, 23, 2), 2.0, 0.1, whole, (0,), mode)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_filters_that_are_given_are_the_ones_used():
    bar, end = (Cosfire(DoGBank((sigma,)), tolerance=preset("vessel_drive").tolerance) for sigma in (2.0, 1.5))
    layer = BCosfire(bar, end, bar_length=41)
    assert layer.bar is bar
    assert layer.end is end
    assert len(bar) == len(end) == 1


def test_one_side_of_the_end_is_taken_away():
    layer = BCosfire()
    assert sorted(layer.bar.tuples(0).rho.tolist()) == [0, 2, 2, 4, 4, 6, 6, 8, 8]
    assert layer.end.tuples(0).rho.tolist() == list(range(0, 23, 2))
    torch.testing.assert_close(layer.end.tuples(0).phi[1:], torch.full((11,), np.pi / 2, dtype=torch.float64))


def test_a_response_without_differences_is_scaled_to_nothing():
    assert not scaled(torch.full((1, 3, 4), 0.7)).any()
    span = scaled(random_images(0, 2, 3, 4))
    assert span.amin((1, 2)).tolist() == [0, 0]
    assert span.amax((1, 2)).tolist() == pytest.approx([255, 255])


def test_a_bank_without_dogs_is_told_what_is_missing():
    with pytest.raises(UserError, match="nothing in the prototype's neighbourhood"):
        Cosfire(GaborBank(), t1=1.0).configure(torch.eye(41, dtype=torch.float64)[None], (0, 40))


def test_a_threshold_that_is_no_number_is_refused():
    with pytest.raises(ArgumentError, match="threshold=nan must be a number"):
        BCosfire().segment(torch.rand(1, 1, 9, 9), threshold=float("nan"))
