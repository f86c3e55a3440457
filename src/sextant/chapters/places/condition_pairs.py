"""Recall@1 between all pairs of conditions, as a table with its protocol in the name."""

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from sextant.baselines.place_descriptors import unit_norm
from sextant.chapters.places.condition_recall import ConditionRecall, condition_recall
from sextant.chapters.places.data import PlaceImages, PlaceTolerance
from sextant.chapters.places.report import logged_name, protocol_of
from sextant.evaluation.positives import Positives


def condition_pairs(
    descriptors: Float32[ndarray, "n d"], places: PlaceImages, tolerance: PlaceTolerance
) -> ConditionRecall:
    """Recall@1 between all pairs of conditions of the described images, without copies of other conditions.

    Descriptors are normalised as in :func:`~sextant.chapters.places.report.compare`: if two references are equally near
    in float32, a different rounding would find the other one, and the same figure would have two values.
    """
    if places.copies:
        names = places.originals
        descriptors = descriptors[np.concatenate([places.rows_of(name) for name in names])]
        places = places.only_conditions(names)
    every = np.arange(len(places))
    positives = Positives.from_sparse(places.positives(every, every, tolerance))
    return condition_recall(unit_norm(descriptors), places.traverse, positives, places.conditions)


def pair_metrics(pairs: ConditionRecall, tolerance: PlaceTolerance) -> dict[str, float]:
    """``test/R_at_1_<tolerance>_<query>_to_<reference>`` for every pair of conditions, and the mean ``..._across``.

    A condition against itself is only in :func:`pair_arrays`: an image without a second one of its place has no match.
    """
    found = {protocol_of(tolerance).name("R@1_across"): pairs.across}
    for (row, column), value in np.ndenumerate(pairs.recall):
        if row != column:
            names = pairs.conditions[row], pairs.conditions[column]
            found[protocol_of(tolerance, *names).name("R@1")] = float(value)
    return {logged_name(name): value for name, value in found.items() if value == value}


def pair_arrays(pairs: ConditionRecall, tolerance: PlaceTolerance) -> dict[str, ndarray]:
    """Tables with a row per query condition and a column per reference condition, and their names."""
    name = protocol_of(tolerance).name("R@1")
    return {
        f"{name}/pairs/conditions": np.array(pairs.conditions),
        f"{name}/pairs/recall": pairs.recall,
        f"{name}/pairs/queries": pairs.queries,
        f"{name}/pairs/queries_without_positive": pairs.unmatchable,
    }
