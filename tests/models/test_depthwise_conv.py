"""A convolution of each channel: torch's, but for its gradients under bfloat16 on a CPU."""

import torch
from torch import nn

from sextant.models.convolutions import DepthwiseConv2d


def _pair(**options):
    ours, plain = DepthwiseConv2d(6, 3, **options), nn.Conv2d(6, 6, 3, groups=6, bias=False, **options)
    plain.load_state_dict(ours.state_dict())
    return ours, plain, torch.rand(2, 6, 9, 7, generator=torch.Generator().manual_seed(0))


def _gradient(layer, x):
    y = layer(x)
    y.float().square().sum().backward()
    return y, layer.weight.grad


def test_in_float32_it_is_the_convolution():
    ours, plain, x = _pair(stride=2, padding=1)
    for one, other in zip(_gradient(ours, x), _gradient(plain, x), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=0)


def test_gradients_under_bfloat16_are_those_of_float32():
    ours, plain, x = _pair(padding=1)
    expected = _gradient(plain, x)
    with torch.autocast("cpu", torch.bfloat16):
        found = _gradient(ours, x)
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == torch.float32
        torch.testing.assert_close(one, other, rtol=0, atol=0)


def test_a_map_of_bfloat16_comes_in():
    ours, _, x = _pair()
    x = x.bfloat16().requires_grad_()
    with torch.autocast("cpu", torch.bfloat16):
        ours(x).sum().backward()
    assert x.grad.dtype == torch.bfloat16


def test_without_gradients_nothing_differs():
    ours, plain, x = _pair()
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        y = ours(x)
        assert y.dtype == torch.bfloat16
        torch.testing.assert_close(y, plain(x), rtol=0, atol=0)
