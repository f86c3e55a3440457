"""The measure of a run of place recognition in reports: recall@1."""

from collections.abc import Mapping

from numpy import ndarray

from sextant.chapters.places.report import logged_name
from sextant.kit.measure import Measure, RunValues

RECALL = Measure(
    "Recall@1 on the test split, per cent",
    "recall@1",
    "difference in recall@1 (points)",
    "mean",
    "higher",
    "its recall@1 on the validation split is below three times chance",
    trained_by=("trainer.max_epochs",),
)
#: prefix and suffix of the arrays of place recognition that mark the queries found by the network
FOUND_FIRST, FOUND_LAST = "R@1_", "/network"


def places_found(arrays: Mapping[str, ndarray]) -> RunValues:
    """Recall of the network under each condition of the queries, without sequences or re-ranking."""
    found = {key: key.removesuffix(FOUND_LAST) for key in arrays if key.endswith(FOUND_LAST)}
    recalls = {logged_name(name): float(arrays[key].mean()) for key, name in found.items()}
    others = (f"{FOUND_FIRST}sequence", f"{FOUND_FIRST}reranked")
    single = {key: name for key, name in found.items() if not name.startswith(others)}
    return RunValues(RECALL, {name: 100.0 * arrays[key] for key, name in single.items()}, metrics=recalls)
