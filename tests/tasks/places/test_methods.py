"""Which training images are taken for pairs."""

import numpy as np
import pytest

from sextant.chapters.places.data import ImageRows, PlaceImages, PlaceTolerance
from sextant.chapters.places.methods import training_pairs


@pytest.mark.parametrize(("aligned", "partner"), [(False, 1), (True, 2)])
def test_of_several_partners_the_next_is_taken(aligned, partner):
    """Image 1 is nearer to image 0 in metres, image 2 in frame number, and image 3 is at another place."""
    images = PlaceImages(
        ImageRows(np.zeros((4, 4, 4, 3), np.uint8)),
        np.array([0, 1, 1, 1]),
        ("day", "night"),
        np.array([500, 3, 490, 500]),
        tuple("abcd"),
        np.array([[0, 0], [0.1, 0], [2.9, 0], [40, 0]]),
        aligned=aligned,
    )
    first, second = training_pairs(images, "day", "night", PlaceTolerance("m", 3, 15))
    assert (first.tolist(), second.tolist()) == ([0], [partner])
