"""Descriptors less what all images of their traverse share."""

import numpy as np
import pytest

from sextant.errors import ArgumentError
from sextant.retrieval.without_mean import PRIOR_IMAGES, centred


def unit(rows):
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize("centring", ["running", "all"])
def test_what_a_season_adds_to_all_images_of_a_ride_goes(centring):
    rng = np.random.default_rng(0)
    places, season = rng.normal(size=(200, 16)), 6 * rng.normal(size=16)
    reference, query = (unit(places + 0.1 * rng.normal(size=places.shape) + add) for add in (0, season))
    late = slice(100, None)  # once the running mean is known

    def share(reference, query):
        return np.mean((query @ reference.T).argmax(axis=1)[late] == np.arange(200)[late])

    assert share(*centred(reference, query, "none")) < 0.8
    assert share(*centred(reference, query, centring)) > 0.9


def test_the_running_mean_starts_from_that_of_the_map_and_looks_at_no_later_image():
    rng = np.random.default_rng(1)
    reference, query = unit(rng.normal(size=(7, 4)) + 1), unit(rng.normal(size=(5, 4)) + 1)
    (_, all_of_them), (_, first) = (centred(reference, query[:k], "running") for k in (5, 1))
    np.testing.assert_allclose(all_of_them[:1], first, rtol=1e-6)
    by_hand = query[2] - (PRIOR_IMAGES * reference.mean(axis=0) + query[:3].sum(axis=0)) / (PRIOR_IMAGES + 3)
    np.testing.assert_allclose(all_of_them[2], by_hand / np.linalg.norm(by_hand), rtol=1e-4)


def test_norms_are_one_and_nothing_is_divided_by_zero():
    rows = unit(np.random.default_rng(2).normal(size=(6, 4)))
    for part in centred(rows, rows, "all"):
        np.testing.assert_allclose(np.linalg.norm(part, axis=1), 1, rtol=1e-6)
    assert np.isfinite(centred(rows[:1], rows[:1], "running")).all()


def test_mistakes():
    rows = np.eye(3, dtype=np.float32)
    with pytest.raises(ArgumentError, match="a single photo equals its mean"):
        centred(rows, rows[:1], "all")
