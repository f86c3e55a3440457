"""Filters of published applications."""

import pytest
import torch

from sextant.layers.cosfire import PRESETS, preset


def wye(size=101):
    """Three bars that meet in the middle."""
    line = torch.arange(size, dtype=torch.float64) - size // 2
    x, y = line[None, :], -line[:, None]
    bars = ((x.abs() <= 2) & (y >= 0)) | (((x.abs() + y).abs() <= 3) & (y <= 0))
    return bars.double()[None]


@pytest.mark.parametrize("name", PRESETS)
def test_each_is_configured_from_a_junction_of_bars_and_finds_it(name):
    image = wye()
    layer = preset(name).configure(image)
    parts = layer.tuples(0)
    assert len(parts) >= 2
    assert parts.rho.max() > 0
    response = layer(image[None])[0, 0]
    assert response.shape == (101, 101)
    assert response[46:55, 46:55].max() >= 0.8 * response.max() > 0


@pytest.mark.parametrize("name", PRESETS)
def test_each_is_new_every_time(name):
    first = preset(name).configure(wye())
    assert len(first) == 1
    assert len(preset(name)) == 0


def test_an_unknown_one_is_refused():
    with pytest.raises(ValueError, match="choose among bifurcation, symbol"):
        preset("bifurkation")
