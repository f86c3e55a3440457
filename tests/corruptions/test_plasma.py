"""Plasma fractals against the midpoint rule written out point by point."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.corruptions.textures import _grids, map_side, plasma


def point_by_point(noise, decay):
    """Each point's height from its four neighbours, by asking for them one after the other."""
    n = len(noise)
    height = np.zeros((n, n))
    step, amplitude = n, 1.0
    while step > 1:
        half = step // 2
        diagonal = [(-half, -half), (-half, half), (half, -half), (half, half)]
        straight = [(-half, 0), (half, 0), (0, -half), (0, half)]
        for offsets, odd in ((diagonal, 2), (straight, 1)):
            for y in range(0, n, half):
                for x in range(0, n, half):
                    if (y // half) % 2 + (x // half) % 2 == odd:
                        neighbours = [height[(y + dy) % n, (x + dx) % n] for dy, dx in offsets]
                        height[y, x] = sum(neighbours) / 4 + amplitude * noise[y, x]
        step, amplitude = half, amplitude / decay**2
    return (height - height.min()) / np.ptp(height)


@given(st.integers(0, 99), st.integers(1, 5), st.floats(1.1, 3.5))
def test_a_map_is_the_midpoint_rule(seed, exponent, decay):
    noise = torch.rand(2, 2**exponent, 2**exponent, generator=torch.Generator().manual_seed(seed)) * 2 - 1
    maps = plasma(noise, decay)
    for one, expected in zip(maps, noise.double().numpy(), strict=True):
        np.testing.assert_allclose(one, point_by_point(expected, decay), atol=1e-12)
    assert maps.amin() == 0
    assert maps.amax() == 1


@given(st.integers(0, 99), st.sampled_from([2, 8, 64]), st.floats(1.1, 3.5))
def test_machine_code_and_whole_grids_agree(seed, side, decay):
    noise = torch.rand(3, side, side, generator=torch.Generator().manual_seed(seed)) * 2 - 1
    height = _grids(noise.double(), decay)
    lowest, highest = height.amin((1, 2), keepdim=True), height.amax((1, 2), keepdim=True)
    torch.testing.assert_close(plasma(noise, decay), (height - lowest) / (highest - lowest), rtol=0, atol=1e-15)


def test_a_corner_of_the_map_is_cut_from_the_whole():
    noise = torch.rand(2, 32, 32) * 2 - 1
    assert torch.equal(plasma(noise, 2.0, (7, 20)), plasma(noise, 2.0)[:, :7, :20])


def test_without_noise_there_is_no_relief():
    assert torch.equal(plasma(torch.zeros(1, 8, 8), 2.0), torch.zeros(1, 8, 8, dtype=torch.float64))


def test_maps_are_rougher_the_weaker_the_decay():
    noise = torch.rand(20, 64, 64, generator=torch.Generator().manual_seed(0)) * 2 - 1
    roughness = [plasma(noise, decay).diff(dim=-1).abs().mean().item() for decay in (3, 2.5, 2, 1.75, 1.4)]
    assert roughness == sorted(roughness)
    assert roughness[-1] > 3 * roughness[0]


@pytest.mark.parametrize("shape", [(1, 8, 4), (1, 6, 6), (1, 0, 0)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(ValueError, match="power of two"):
        plasma(torch.zeros(shape), 2.0)


@pytest.mark.parametrize(
    ("size", "side"), [((32, 32), 32), ((28, 28), 32), ((224, 224), 256), ((33, 5), 64), ((1, 1), 1)]
)
def test_the_smallest_map_covers_the_image(size, side):
    assert map_side(*size) == side
