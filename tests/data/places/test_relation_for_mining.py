"""What mining is told of a batch is what the images say of themselves."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from data.places.place_pictures import aligned_places

from sextant.chapters.places.data import PlaceTolerance
from sextant.chapters.places.data.batches import PlaceBatchImages, batch_places, places_of
from sextant.retrieval import relations


def headed(places):
    """The same images two metres apart along a line, looking about; those of the second traverse unknown."""
    heading = np.where(places.traverse == 0, 40.0 * places.frame, np.nan)
    position = np.stack([2.0 * places.frame, places.traverse], -1)
    return replace(places, position_m=position, heading_deg=heading)


@pytest.mark.parametrize("tolerance", [PlaceTolerance("frames", 1, 10), PlaceTolerance("m", 4, 20)])
def test_pairs_are_those_of_the_images(tolerance):
    places = headed(aligned_places(frames=20))
    rows = torch.tensor([0, 1, 5, 10, 11, 20, 21, 30])
    relation = relations(batch_places(PlaceBatchImages(places)[rows], tolerance), tolerance)
    chosen = rows.numpy()
    assert np.array_equal(relation.positive.numpy(), places.positives(chosen, chosen, tolerance).toarray())
    assert np.array_equal(~relation.negative.numpy(), places.not_negatives(chosen, chosen, tolerance).toarray())
    whole = relations(places_of(places, tolerance), tolerance, rows, rows)
    assert torch.equal(whole.positive, relation.positive)
    assert torch.equal(whole.negative, relation.negative)


def test_headings_count_where_the_tolerance_looks_at_them():
    tolerance, rows = PlaceTolerance("m", 5, 25, 30), np.arange(20)
    places = headed(aligned_places(frames=20)).select(rows)
    relation = relations(places_of(places, tolerance), tolerance)
    assert np.array_equal(relation.positive.numpy(), places.positives(rows, rows, tolerance).toarray())
    assert relation.positive.sum() < relations(places_of(places, tolerance), PlaceTolerance("m", 5, 25)).positive.sum()
