"""Convert images of places to what :func:`sextant.retrieval.relations` needs: where each was taken, in which unit."""

import torch

from sextant.chapters.places.data.batches import PlaceBatch
from sextant.chapters.places.data.images import PlaceImages
from sextant.chapters.places.data.tolerance import PlaceTolerance
from sextant.retrieval import Places


def batch_places(batch: PlaceBatch, tolerance: PlaceTolerance) -> Places:
    """Where the images of a batch were taken, in the tolerance's unit."""
    position = batch.position_m if tolerance.unit == "m" else batch.frame[:, None]
    assert position is not None  # the data module read it with this tolerance
    return Places(position, None if tolerance.heading_deg is None else batch.heading_deg, batch.condition)


def places_of(images: PlaceImages, tolerance: PlaceTolerance) -> Places:
    """Where the images of a split were taken, in the tolerance's unit."""
    position = images.position_m if tolerance.unit == "m" else images.frame[:, None]
    assert position is not None
    known = tolerance.heading_deg is not None and images.heading_deg is not None
    heading = torch.from_numpy(images.heading_deg) if known else None
    return Places(torch.from_numpy(position), heading, torch.from_numpy(images.traverse))
