"""The last layer of a place network, computed in closed form instead of trained; see ``models.learned_whitening``."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Int64
from numpy import ndarray

from sextant.chapters.places.data import PlaceImages, PlaceTolerance
from sextant.chapters.places.methods import training_pairs
from sextant.errors import ArgumentError
from sextant.models.learned_whitening import learned_whitening
from sextant.models.place_net import PlaceNet

#: images described at a time
BATCH = 256


@dataclass(frozen=True)
class Whitening:
    """Settings of the whitening that replaces the last layer.

    Attributes:
        components: number of principal components of the pooled features used.
        shrinkage: of the within-place scatter, as a multiple of its mean variance.
        images: approximate maximum number of training images used, whose features are held in memory; an image of
            several places counts once for each.
    """

    components: int = 256
    shrinkage: float = 1.0
    images: int = 4_000


@torch.no_grad()
def solve_projection(network: PlaceNet, train: PlaceImages, tolerance: PlaceTolerance, whitening: Whitening) -> None:
    """Replace weight and bias of the projection by the solution.

    Args:
        network: the network whose projection is replaced, on any device.
        train: images of the training split.
        tolerance: within which images show the same place.
        whitening: the settings.

    Raises:
        UserError: too few training places have images under two conditions, or the pooling has too few outputs.
    """
    rows, place = _thinned(*images_by_place(train, tolerance), whitening.images)
    device, training = next(network.parameters()).device, network.training
    network.eval()
    features = []
    for start in range(0, len(rows), BATCH):
        images = torch.from_numpy(train.images[rows[start : start + BATCH]]).permute(0, 3, 1, 2).to(device)
        features.append(network.pooling(network.feature_map(images.float() / 255)).float())
    network.train(training)
    try:
        weight, bias = learned_whitening(
            torch.cat(features),
            torch.from_numpy(place).to(device),
            network.dimension,
            components=whitening.components,
            shrinkage=whitening.shrinkage,
        )
    except ValueError as error:
        fix = "whitening=null, or a smaller dimension"
        raise ArgumentError(f"whitening: {error}", fix, of="PlaceRecognition") from None
    network.projection.weight.copy_(weight)  # type: ignore[operator]
    network.projection.bias.copy_(bias)  # type: ignore[operator]


def images_by_place(train: PlaceImages, tolerance: PlaceTolerance) -> tuple[Int64[ndarray, "n"], Int64[ndarray, "n"]]:
    """Rows of images, and their places from 0: an image of the first condition with its positives of other conditions.

    Of several positives under one condition the nearest is taken, as in ``training_pairs``; an image may belong to
    several places. Images of the first condition without positives are left out.
    """
    first, *others = train.conditions
    anchors = {int(row): [int(row)] for row in train.rows_of(first)}
    for condition in others:
        for anchor, partner in zip(*training_pairs(train, first, condition, tolerance), strict=True):
            anchors[int(anchor)].append(int(partner))
    places = [rows for rows in anchors.values() if len(rows) > 1]
    place = np.repeat(np.arange(len(places)), [len(rows) for rows in places])
    return np.array([row for rows in places for row in rows], np.int64), place


def _thinned(
    rows: Int64[ndarray, "n"], place: Int64[ndarray, "n"], most: int
) -> tuple[Int64[ndarray, "k"], Int64[ndarray, "k"]]:
    """The images of all places; if they are more than ``most``, of every second, third, ... place."""
    step = max(1, -(-len(rows) // most))
    kept = place % step == 0
    return rows[kept], place[kept] // step


def require_enough(train: PlaceImages, tolerance: PlaceTolerance, dimension: int, most: int) -> None:
    """Raise a ``UserError`` if the training split, or ``most`` of its images, cannot span ``dimension`` directions.

    It is called before training.
    """
    rows, place = images_by_place(train, tolerance)
    used = len(_thinned(rows, place, most)[0])
    if len(rows) - 1 < dimension:
        raise ArgumentError(
            f"whitening: {len(rows)} training images show places with images under two conditions; for "
            f"dimension={dimension} more than {dimension} are needed",
            f"whitening=null, or dimension={max(1, len(rows) - 1)} or less",
            of="PlaceRecognition",
        )
    if used - 1 < dimension:
        raise ArgumentError(
            f"whitening.images={most} leaves {used}; for dimension={dimension} more than {dimension} are needed",
            f"whitening.images={len(rows)}",
            of="PlaceRecognition",
        )
