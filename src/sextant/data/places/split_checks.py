"""Check that a split can be trained on or searched, and report problems in terms of the config before training."""

import numpy as np

from sextant.data.places.batches import PlaceBatches
from sextant.data.places.images import PlaceImages
from sextant.data.places.tolerance import PlaceTolerance
from sextant.errors import ArgumentError, problem_list

#: the class that the arguments belong to
PARENT = "PlaceDataModule"


def check_headings(images: PlaceImages, split: str, tolerance: PlaceTolerance, key: str) -> None:
    """Raise a ``UserError`` that names images without a heading if the tolerance takes headings into account.

    Args:
        images: of the split.
        split: its name.
        tolerance: of one place.
        key: the argument that gives the tolerance.
    """
    if tolerance.heading_deg is None:
        return
    unknown = np.arange(len(images)) if images.heading_deg is None else np.flatnonzero(np.isnan(images.heading_deg))
    if len(unknown):
        raise ArgumentError(
            f"{key}.{tolerance.unit}.heading_deg={tolerance.heading_deg:g}, but {len(unknown):,} of {len(images):,} "
            f"{split} images have no heading\n{problem_list([images.names[row] for row in unknown])}",
            f"Give each a heading, or ignore headings: {key}.{tolerance.unit}.heading_deg=null",
            of=PARENT,
        )


def check_search(images: PlaceImages, split: str, tolerance: PlaceTolerance) -> None:
    """Raise a ``UserError`` unless images of one condition can be looked up in those of another.

    Queries without a positive are not an error as long as one has a positive: metrics count them.

    Args:
        images: of the split.
        split: its name.
        tolerance: within which images show the same place in validation and test.
    """
    key = "test_tolerance"
    check_headings(images, split, tolerance, key)
    reference, *queries = images.conditions
    if not queries:
        setting = "test_conditions" if split == "test" else "train_conditions"
        raise ArgumentError(
            f"the {split} split has one condition, {reference}: the first is the map, and others are looked up in it",
            f"Name at least two in the dataset (`{split}` or `conditions`), and in `{setting}` unless it is null.",
            of=PARENT,
        )
    rows = np.concatenate([images.rows_of(condition) for condition in queries])
    if not images.positives(rows, images.rows_of(reference), tolerance).nnz:
        raise ArgumentError(
            f"none of {len(rows):,} {split} images of {', '.join(queries)} has its place among the images of "
            f"{reference}, within {tolerance.name}",
            "Check the poses: both must be in the same frame, in metres. Or widen the tolerance: "
            f"{key}.{tolerance.unit}.positive=<more>",
            of=PARENT,
        )


def check_training(batches: PlaceBatches) -> None:
    """Raise a ``UserError`` if there are fewer training places than a batch needs."""
    there = len(batches.anchors)
    if batches.batch_places > there:
        raise ArgumentError(
            f"batch_places={batches.batch_places}, but the training split has {there:,} places seen twice or more",
            f"batch_places={there} at most, or add images.",
            of=batches,
        )
