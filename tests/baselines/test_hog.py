import numpy as np
import pytest

from sextant.baselines import Hog


def wave(angle_deg):
    """A grating whose gradient has that direction, clockwise from the right (y points down)."""
    y, x = np.mgrid[:32, :64]
    angle = np.radians(angle_deg)
    phase = 2 * np.pi * (np.cos(angle) * x + np.sin(angle) * y) / 9
    return np.rint(127 + 100 * np.sin(phase)).astype(np.uint8)[None, :, :, None]


@pytest.mark.parametrize("turn", range(8))
def test_a_grating_falls_into_the_bin_of_its_direction(turn):
    angle = 11.25 + 22.5 * turn
    histograms = Hog().describe(wave(angle)).reshape(32, 8)
    peaks = histograms.argmax(1)
    assert (peaks == peaks[0]).all()
    others = [Hog().describe(wave(11.25 + 22.5 * other)).reshape(32, 8).argmax(1)[0] for other in range(8)]
    assert others.count(peaks[0]) == 1


def test_opposite_directions_are_one():
    images = wave(40)
    np.testing.assert_allclose(Hog().describe(images), Hog().describe(255 - images), atol=1e-6)


def test_cells_have_norm_one_or_are_flat():
    images = np.full((1, 32, 64, 1), 90, np.uint8)
    images[0, :, 32:] = wave(0)[0, :, 32:]
    norms = np.linalg.norm(Hog().describe(images).reshape(4, 8, 8), axis=2)
    np.testing.assert_allclose(norms[:, :3], 0, atol=1e-6)
    np.testing.assert_allclose(norms[:, 4:], 1, atol=1e-6)


def test_cells_that_do_not_tile_the_image_are_refused():
    with pytest.raises(ValueError, match="grid of 5 x 8 cells must divide"):
        Hog(rows=5).describe(wave(0))
