"""Validation images, taken from the training split and never from the test split."""

import numpy as np
from jaxtyping import Int64
from numpy import ndarray


def stratified_split(
    labels: Int64[ndarray, "n"], fraction: float, seed: int
) -> tuple[Int64[ndarray, "t"], Int64[ndarray, "v"]]:
    """Indices of training and validation images, with the same share of every class in each.

    Args:
        labels: class of every image.
        fraction: share of validation images, in (0, 1); at least one image of each class is held out.
        seed: of the choice.

    Raises:
        ValueError: a class has a single image.
    """
    rng = np.random.default_rng(seed)
    train, validation = [], []
    for label in np.unique(labels):
        members = rng.permutation(np.flatnonzero(labels == label))
        held_out = max(1, round(fraction * len(members)))
        if held_out >= len(members):
            raise ValueError(f"class {label} has {len(members)} training images, too few to hold out {held_out}")
        validation.append(members[:held_out])
        train.append(members[held_out:])
    return np.sort(np.concatenate(train)), np.sort(np.concatenate(validation))
