"""What mining is told of a batch is what the images say of themselves."""

import numpy as np
import torch
from data.places.place_pictures import aligned_places

from sextant.data.places import PlaceTolerance
from sextant.data.places.batches import PlaceBatchImages
from sextant.data.places.relation import batch_places, mining_tolerance, places_of
from sextant.retrieval import relations


def test_pairs_are_those_of_the_images():
    places, tolerance = aligned_places(frames=20), PlaceTolerance("frames", 1, 10)
    rows = torch.tensor([0, 1, 5, 10, 11, 20, 21, 30])
    relation = relations(batch_places(PlaceBatchImages(places)[rows], tolerance), mining_tolerance(tolerance))
    chosen = rows.numpy()
    assert np.array_equal(relation.positive.numpy(), places.positives(chosen, chosen, tolerance).toarray())
    assert np.array_equal(~relation.negative.numpy(), places.not_negatives(chosen, chosen, tolerance).toarray())
    whole = relations(places_of(places, tolerance), mining_tolerance(tolerance), rows, rows)
    assert torch.equal(whole.positive, relation.positive)
    assert torch.equal(whole.negative, relation.negative)
