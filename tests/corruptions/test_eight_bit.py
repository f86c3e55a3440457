import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.corruptions import eight_bit, to_bytes

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
