import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.corruptions import eight_bit, to_bytes
from sextant.corruptions.pixels import luma
from sextant.errors import ArgumentError

bytes_ = torch.arange(256)


@pytest.mark.parametrize("mode", ["faithful", "corrected"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_whole_values_are_kept_by_either_mode(mode, dtype):
    images = bytes_.to(dtype) / 255
    assert torch.equal(to_bytes(images, mode).long(), bytes_)
    assert torch.equal(eight_bit(images, mode), images)


@given(st.floats(0, 1))
def test_faithful_drops_the_fraction_and_corrected_rounds(value):
    image, scaled = torch.tensor([value], dtype=torch.float64), value * 255
    if abs(scaled - round(scaled)) > 1e-3:
        assert to_bytes(image).item() == np.uint8(scaled)
    if abs(scaled % 1 - 0.5) > 1e-3:
        assert to_bytes(image, "corrected").item() == round(scaled)


def test_dropping_the_fraction_darkens_by_half_a_grey_level():
    images = torch.rand(100000, generator=torch.Generator().manual_seed(0))
    for mode, shift in (("faithful", 0.5), ("corrected", 0.0)):
        assert (images - eight_bit(images, mode)).mean().item() * 255 == pytest.approx(shift, abs=0.01)


@pytest.mark.parametrize("mode", ["faithful", "corrected"])
def test_values_outside_are_clipped_and_images_are_not_changed(mode):
    images = torch.tensor([-0.3, 1.7])
    assert to_bytes(images, mode).tolist() == [0, 255]
    assert images.tolist() == pytest.approx([-0.3, 1.7])


def test_half_precision_keeps_its_type():
    assert eight_bit(torch.rand(4, dtype=torch.bfloat16)).dtype == torch.bfloat16


@pytest.mark.parametrize("change", [to_bytes, eight_bit])
def test_an_unknown_mode_is_refused(change):
    with pytest.raises(ArgumentError, match="mode=exact is not known; it is faithful or corrected"):
        change(torch.rand(4), "exact")


@pytest.mark.parametrize("change", [to_bytes, eight_bit, luma])
def test_bytes_are_refused_as_images_within_0_and_1(change):
    with pytest.raises(ArgumentError, match=r"images hold torch\.uint8, not floating-point values"):
        change(torch.full((3, 2, 2), 200, dtype=torch.uint8))
