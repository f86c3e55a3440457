"""The methods that a trained place descriptor is compared with, each as descriptors of the test images."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Int64
from numpy import ndarray

from sextant.baselines import Hog, PatchNormalised, Pixels, WhitenedPCA
from sextant.baselines.learned_projections import CCA, LDA, PairedDescriptor
from sextant.baselines.place_descriptors import PlaceDescriptor, unit_norm
from sextant.chapters.places.data import PlaceImages, PlaceTolerance
from sextant.chapters.places.network import device_of

#: images read and described at a time
BATCH = 256


@dataclass(frozen=True)
class Described:
    """Descriptors of the map and of the queries by one method; rows have unit norm."""

    reference: Float32[ndarray, "n d"]
    query: Float32[ndarray, "m d"]

    @property
    def similarities(self) -> Float32[ndarray, "m n"]:
        """Cosine similarities of all pairs."""
        return np.asarray(self.query @ self.reference.T)


def training_free(height: int, width: int) -> dict[str, PlaceDescriptor]:
    """Descriptors that need no image pairs; only whitened PCA is fitted, to images of the map's condition."""
    size = (height, width)
    return {
        "pixels": Pixels(*size),
        "patch-normalised": PatchNormalised(*size),
        "HOG": Hog(*size),
        "whitened PCA": WhitenedPCA(*size),
    }


def pair_supervised(height: int, width: int) -> dict[str, PairedDescriptor]:
    """Linear maps learnt from images of the same places under the two conditions."""
    return {"LDA": LDA(height, width), "CCA": CCA(height, width)}


def baselines(
    train: PlaceImages, images: PlaceImages, query: str, tolerance: PlaceTolerance, *, size: tuple[int, int]
) -> tuple[dict[str, Described], dict[str, str]]:
    """Each method on the traverse ``query`` with the first traverse as map, fitted on the training split alone.

    Args:
        train: images to learn from.
        images: to describe.
        query: condition of the queries.
        tolerance: within which images show the same place.
        size: height and width at which images are described.

    Returns:
        Descriptors by method; and the reason for each method that could not be fitted to these images.
    """
    reference = images.conditions[0]
    maps, queries = (images.images[images.rows_of(name)] for name in (reference, query))
    methods, left_out = fitted(training_free(*size), train, reference)
    found = {
        name: Described(unit_norm(method.describe(maps)), unit_norm(method.describe(queries)))
        for name, method in methods.items()
    }
    if not {reference, query} <= set(train.conditions):
        reason = f"there are no training images of both {reference} and {query}"
        return found, left_out | dict.fromkeys(pair_supervised(*size), reason)
    first, second = training_pairs(train, reference, query, tolerance)
    for name, paired in pair_supervised(*size).items():
        try:
            paired.fit_pairs(train.images[first], train.images[second])
        except ValueError as error:
            left_out[name] = str(error)
            continue
        found[name] = Described(paired.describe(maps), paired.describe_query(queries))
    return found, left_out


def fitted(
    methods: Mapping[str, PlaceDescriptor], train: PlaceImages, reference: str
) -> tuple[dict[str, PlaceDescriptor], dict[str, str]]:
    """Fit methods to the training images of the map's condition, or, without any, of the first condition.

    Returns:
        The methods that could be fitted, and the reasons for the others.
    """
    seen = train.images[train.rows_of(reference if reference in train.conditions else train.conditions[0])]
    found: dict[str, PlaceDescriptor] = {}
    left_out: dict[str, str] = {}
    for name, method in methods.items():
        try:
            found[name] = method.fit(seen)
        except ValueError as error:  # fewer images than dimensions
            left_out[name] = str(error)
    return found, left_out


def describe_all(methods: Mapping[str, PlaceDescriptor], images: PlaceImages) -> dict[str, Float32[ndarray, "n d"]]:
    """Descriptors of all images by methods that describe images of any condition in the same way."""
    return {
        name: np.concatenate([method.describe(images.images[rows]) for rows in _batches(len(images))])
        for name, method in methods.items()
    }


def training_pairs(
    train: PlaceImages, reference: str, query: str, tolerance: PlaceTolerance
) -> tuple[Int64[ndarray, "p"], Int64[ndarray, "p"]]:
    """One image of each training place under both conditions; of several positives, the nearest.

    Nearest in frame number, or in position if frames of the traverses do not correspond.
    """
    first, second = train.rows_of(reference), train.rows_of(query)
    matrix = train.positives(first, second, tolerance)
    pairs = []
    for row, image in enumerate(first):
        partners = second[matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]]]
        if len(partners):
            pairs.append((image, partners[_apart(train, partners, image).argmin()]))
    columns = np.array(pairs, np.int64).reshape(-1, 2)
    return columns[:, 0], columns[:, 1]


def _apart(train: PlaceImages, partners: Int64[ndarray, "k"], image: int) -> ndarray:
    """Distances of images from one image, in frames if these are aligned, otherwise in metres."""
    if train.aligned or train.position_m is None:
        return np.asarray(np.abs(train.frame[partners] - train.frame[image]))
    return np.asarray(np.linalg.norm(train.position_m[partners] - train.position_m[image], axis=1))


@torch.no_grad()
def network_descriptors(network: torch.nn.Module, images: PlaceImages) -> Float32[ndarray, "n d"]:
    """Descriptors of all images by a network in evaluation mode."""
    device = device_of(network)
    parts = []
    for rows in _batches(len(images)):
        chosen = torch.from_numpy(images.images[rows]).permute(0, 3, 1, 2)
        parts.append(network(chosen.to(device).float() / 255).float().cpu().numpy())
    return np.concatenate(parts)


def _batches(count: int) -> list[slice]:
    return [slice(start, start + BATCH) for start in range(0, count, BATCH)]
