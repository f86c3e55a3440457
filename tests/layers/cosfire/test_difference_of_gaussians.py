"""Differences of Gaussians against scipy, and what they answer to."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from layers.cosfire.cosfire_cases import random_images
from scipy.ndimage import gaussian_filter

from sextant.errors import UserError
from sextant.layers.cosfire import ConcentricCircles, Cosfire, DoGBank, Move

SCIPY_BORDER = {"zeros": "constant", "replicate": "nearest", "reflect": "mirror", "circular": "wrap"}


@given(st.floats(0.8, 3.0), st.floats(0.3, 0.8), st.sampled_from([1, -1]), st.sampled_from(list(SCIPY_BORDER)))
def test_responses_are_scipys(sigma, ratio, polarity, border):
    image = random_images(0, 1, 1, 14, 11)
    found = DoGBank((sigma,), (polarity,), ratio, border).describe(image)[0, 0]
    reach = {"radius": math.ceil(3 * sigma), "mode": SCIPY_BORDER[border]}
    inner, outer = (gaussian_filter(image[0, 0].numpy(), s, **reach) for s in (ratio * sigma, sigma))
    np.testing.assert_allclose(found, np.maximum(0, polarity * (inner - outer)), atol=1e-12)


def test_polarities_tell_bright_spots_from_dark_ones():
    spot = torch.zeros(1, 1, 15, 15)
    spot[..., 7, 7] = 1
    bright, dark = DoGBank((2.0,), (1, -1)).describe(spot)[0, :, 7, 7].tolist()
    assert bright > 0 == dark


def test_of_several_widths_at_a_place_the_strongest_is_kept_for_each_polarity():
    layer = Cosfire(DoGBank((1.0, 2.0, 4.0), (1, -1)), ConcentricCircles((0.0, 3.0), t2=0.0))
    image = torch.rand(1, 21, 21, generator=torch.Generator().manual_seed(0))
    parts = layer.configure(image).tuples(0)
    places = torch.stack([parts.rho, parts.phi, parts.channels[:, 1]], 1)
    assert len(torch.unique(places, dim=0)) == len(places) > 4
    maps = layer.bank.describe(image[None])[0, :, 10, 10]
    (sigma,) = parts.channels[(parts.rho == 0) & (parts.channels[:, 1] == 1), 0].tolist() or [0.0]
    bright = maps[layer.bank.grid()[:, 1] == 1]
    assert sigma == ([1.0, 2.0, 4.0][int(bright.argmax())] if bright.max() > 0 else 0.0)


def test_a_channel_of_a_moved_image_grows_with_it_alone():
    moved = DoGBank().moved(torch.tensor([[2.0, 1.0], [3.0, -1.0]]), Move(1.0, 1.5, True))
    assert moved.tolist() == [[3.0, 1.0], [4.5, -1.0]]


def test_colour_images_are_refused_in_one_message():
    with pytest.raises(UserError, match="DoGBank takes grey images"):
        DoGBank().describe(torch.zeros(1, 3, 9, 9))
