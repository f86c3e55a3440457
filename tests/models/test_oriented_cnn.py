import math

import numpy as np
import pytest
import torch

from sextant.models import OrientedCNN, OrientedGradients


def stripes(angle, size=64, wavelength=8.0):
    """A wave whose gradient points along ``angle`` (radians, y down), grey in [-1, 1]."""
    y, x = np.mgrid[:size, :size]
    wave = np.sin(2 * np.pi * (x * math.cos(angle) + y * math.sin(angle)) / wavelength)
    return torch.from_numpy(wave).float().expand(1, 3, size, size)


@pytest.mark.parametrize("bin_", range(8))
def test_an_edge_votes_for_its_own_direction_most(bin_):
    gradients = OrientedGradients(orientations=8, cell=4)
    cells = gradients(stripes(math.pi * bin_ / 8))[0, :8, 2:-2, 2:-2].mean((1, 2))
    assert int(cells.argmax()) == bin_
    assert cells[(bin_ + 4) % 8] < 0.02 * cells[bin_]  # nothing across


def test_dark_on_light_is_the_same_edge_as_light_on_dark():
    gradients = OrientedGradients()
    torch.testing.assert_close(gradients(stripes(0.7))[:, :11], gradients(-stripes(0.7))[:, :11], atol=1e-5, rtol=1e-4)


def test_contrast_does_not_matter_to_directions():
    gradients = OrientedGradients()
    strong, weak = (gradients(scale * stripes(0.7))[:, :10] for scale in (1.0, 0.4))
    torch.testing.assert_close(strong, weak, rtol=0.15, atol=0.01)


def test_turning_the_image_a_quarter_turns_the_bins():
    gradients = OrientedGradients(orientations=8, cell=4)
    images = torch.rand(1, 3, 32, 32)
    cells, turned = gradients(images)[:, :8], gradients(torch.rot90(images, 1, (2, 3)))[:, :8]
    torch.testing.assert_close(torch.rot90(cells, 1, (2, 3)).roll(4, 1), turned, atol=1e-4, rtol=1e-3)


def test_a_blank_image_has_no_edges_and_is_finite():
    cells = OrientedGradients()(torch.zeros(1, 6, 32, 32))
    assert cells.isfinite().all()
    assert (cells[:, :10] < 1e-3).all()
    assert cells.shape == (1, 17, 8, 8)


@pytest.mark.parametrize("layout", [torch.contiguous_format, torch.channels_last])
def test_an_image_is_seen_alike_alone_and_in_a_batch_that_is_worked_through_in_parts(layout):
    gradients, images = OrientedGradients(), torch.rand(9, 6, 96, 128)
    alone = torch.cat([gradients(image[None]) for image in images])
    assert torch.equal(gradients(images.contiguous(memory_format=layout)), alone)


def test_the_network_gives_as_many_numbers_as_it_is_asked_for():
    assert OrientedCNN(6, (72, 96), 11)(torch.rand(2, 6, 72, 96)).shape == (2, 11)
    assert OrientedCNN(3, (64, 64), 11, grid=(2, 2))(torch.rand(2, 3, 64, 64)).shape == (2, 11)


def test_what_is_wrong_is_named():
    with pytest.raises(ValueError, match="strides"):
        OrientedCNN(3, (72, 96), 4, widths=(8, 8), strides=(1,))
    with pytest.raises(ValueError, match="colour images"):
        OrientedCNN(1, (72, 96), 4)
    with pytest.raises(ValueError, match="too small"):
        OrientedCNN(3, (28, 28), 4)
