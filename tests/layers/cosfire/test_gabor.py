"""Gabor kernels: what they answer to, and their symmetries."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.errors import ArgumentError, UserError
from sextant.layers.cosfire import DoGBank, FeatureBank, GaborBank, Move, VectorBank, gabor_kernel

wavelengths, thetas = st.floats(2.5, 12.0), st.floats(-7.0, 7.0)


@given(wavelengths, thetas, st.floats(-4.0, 4.0), st.floats(0.5, 3.0), st.floats(0.3, 1.0))
def test_uniform_brightness_gives_nothing_and_either_sign_weighs_one(wavelength, theta, phase, bandwidth, aspect):
    kernel = gabor_kernel(wavelength, theta, phase_rad=phase, bandwidth=bandwidth, aspect=aspect)
    assert kernel.sum().abs() < 1e-12
    assert kernel.clamp(min=0).sum() == pytest.approx(1)


@given(wavelengths, thetas, st.sampled_from([0.0, math.pi]))
def test_kernels_of_bars_are_symmetric(wavelength, theta, phase):
    kernel = gabor_kernel(wavelength, theta, phase_rad=phase)
    torch.testing.assert_close(kernel, torch.rot90(kernel, 2))
    torch.testing.assert_close(gabor_kernel(wavelength, theta + math.pi, phase_rad=phase), kernel, atol=1e-12, rtol=0)


@given(wavelengths, thetas, st.sampled_from([math.pi / 2, -math.pi / 2]))
def test_kernels_of_edges_are_antisymmetric(wavelength, theta, phase):
    kernel = gabor_kernel(wavelength, theta, phase_rad=phase)
    torch.testing.assert_close(kernel, -torch.rot90(kernel, 2), atol=1e-12, rtol=0)


@given(wavelengths, thetas, st.sampled_from([0.0, 1.0, math.pi / 2]))
def test_a_quarter_turn_of_the_kernel_is_one_of_its_orientation(wavelength, theta, phase):
    turned = gabor_kernel(wavelength, theta + math.pi / 2, phase_rad=phase)
    torch.testing.assert_close(
        turned, torch.rot90(gabor_kernel(wavelength, theta, phase_rad=phase)), atol=1e-12, rtol=0
    )


@pytest.mark.parametrize("turn", range(8))
def test_a_bar_is_answered_by_the_orientation_across_it_counter_clockwise_with_y_upwards(turn):
    theta = math.pi * turn / 8
    line = torch.arange(41, dtype=torch.float64) - 20
    across = line[None, :] * math.cos(theta) - line[:, None] * math.sin(theta)
    bar = torch.exp(-(across**2) / 2)[None, None]
    found = GaborBank((6.0,), 8, phase_deg=0.0).describe(bar)[0, :, 20, 20]
    assert int(found.argmax()) == turn


def test_phases_tell_bright_from_dark_bars_and_one_side_of_an_edge_from_the_other():
    bar, edge = torch.zeros(2, 1, 1, 31, 31).unbind()
    bar[..., 14:17] = 1
    edge[..., 15:] = 1

    def answer(image, phase, theta):
        return float(GaborBank((6.0,), 1, phase_deg=phase)(image, torch.tensor([[6.0, theta]]))[0, 0, 15, 15])

    assert answer(bar, 0.0, 0.0) > 0.5 > answer(bar, 180.0, 0.0) == 0
    assert answer(1 - bar, 180.0, 0.0) > 0.5 > answer(1 - bar, 0.0, 0.0) == 0
    assert answer(edge, -90.0, 0.0) > 0.5 > answer(edge, -90.0, math.pi) == 0


@given(thetas, st.integers(0, 3), st.booleans())
def test_moved_channels_answer_to_the_moved_image(theta, quarters, mirrored):
    bank = GaborBank((4.0,), 8, phase_deg=90.0)
    image = torch.rand(1, 1, 17, 17, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    channel = torch.tensor([[4.0, theta]], dtype=torch.float64)

    def move(maps):
        return torch.rot90(maps.flip(-1) if mirrored else maps, quarters, (-2, -1))

    moved = bank.moved(channel, Move(quarters * math.pi / 2, 1.0, mirrored))
    torch.testing.assert_close(bank(move(image), moved), move(bank(image, channel)), atol=1e-12, rtol=0)


@pytest.mark.parametrize(("phase", "span"), [(0.0, 180.0), (180.0, 180.0), (90.0, 360.0), (45.0, 360.0)])
def test_orientations_span_what_the_phase_needs(phase, span):
    grid = GaborBank((3.0, 5.0), 4, phase_deg=phase).grid()
    assert grid[:, 0].tolist() == [3.0] * 4 + [5.0] * 4
    torch.testing.assert_close(grid[:4, 1], torch.arange(4).double() * math.radians(span) / 4)


def test_a_scale_that_pixels_cannot_show_is_refused():
    with pytest.raises(UserError, match=r"at scale 0\.5 .* down to 2 pixels"):
        GaborBank().moved(GaborBank().grid(), Move(0.0, 0.5, False))


def test_colour_images_are_refused_in_one_message():
    with pytest.raises(UserError, match="GaborBank takes grey images"):
        GaborBank().describe(torch.zeros(1, 3, 9, 9))


@pytest.mark.parametrize("phase", [float("nan"), float("inf")])
def test_a_phase_that_is_no_angle_is_refused(phase):
    with pytest.raises(ArgumentError, match=f"phase_deg={phase} must be a finite number"):
        GaborBank(phase_deg=phase)


@pytest.mark.parametrize(
    "bank", [GaborBank(), DoGBank(), FeatureBank(torch.nn.Identity(), 1), VectorBank(torch.nn.Identity(), 1)]
)
def test_no_bank_takes_bytes_as_they_would_round_its_kernels(bank):
    with pytest.raises(UserError, match=r"floating-point \w+, got torch\.uint8"):
        bank.describe(torch.ones(1, 1, 9, 9, dtype=torch.uint8))
