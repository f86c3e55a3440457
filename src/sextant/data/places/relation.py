"""From images of places to what mining and losses ask: who shows the same place as whom."""

import math

import torch

from sextant.data.places.batches import PlaceBatch
from sextant.data.places.images import PlaceImages
from sextant.data.places.tolerance import PlaceTolerance
from sextant.retrieval import Places, Tolerance


def mining_tolerance(tolerance: PlaceTolerance) -> Tolerance:
    """The tolerance without its unit, which :func:`batch_places` and :func:`places_of` choose the positions by.

    Mining takes pairs *beyond* its tolerance for negatives, places from theirs on: 10 frames apart are two places.
    """
    return Tolerance(tolerance.positive, math.nextafter(tolerance.negative, 0), tolerance.heading_deg)


def batch_places(batch: PlaceBatch, tolerance: PlaceTolerance) -> Places:
    """Where the images of a batch were taken, in the tolerance's unit."""
    position = batch.position_m if tolerance.unit == "m" else batch.frame[:, None]
    assert position is not None  # the data module read it with this tolerance
    return Places(position, batch.heading_deg, batch.condition)


def places_of(images: PlaceImages, tolerance: PlaceTolerance) -> Places:
    """Where the images of a split were taken, in the tolerance's unit."""
    position = images.position_m if tolerance.unit == "m" else images.frame[:, None]
    assert position is not None
    heading = None if images.heading_deg is None else torch.from_numpy(images.heading_deg)
    return Places(torch.from_numpy(position), heading, torch.from_numpy(images.traverse))
