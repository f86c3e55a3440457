"""What is reported of the run whose network describes the photos, and the temperature that its test fitted."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from sextant.chapters.places.match_confidence import UNSEEN, MatchConfidence
from sextant.runs.resolve import FoundRun, resolve_run

#: the test fits one temperature and reports it under the protocol of every condition
TEMPERATURE = "test/place_temperature_"
#: key of a network's spec: ``temperature``, ``slope`` and ``offset`` of its confidences, where they were fitted to
#: scenes unseen in training
FITTED = "fitted_unseen"


class Temperature(NamedTuple):
    """The temperature of the posterior over a map, or None and the reason why there is none."""

    value: float | None
    lacking: str = ""


def run_temperature(found: FoundRun) -> Temperature:
    """The temperature that the run's test fitted on its validation split, for the weights in this checkpoint."""
    if found.directory is None:
        return Temperature(None, "the checkpoint lies outside of its run's folder, which has the temperature")
    results = found.directory.results()
    if results is None:
        return Temperature(None, "the run is not finished, and its test fits the temperature")
    tested = resolve_run(str(found.directory.path), found.directory.path).checkpoint
    if tested != found.checkpoint:
        return Temperature(None, f"the run's temperature is of {tested.name}, not of {found.checkpoint.name}")
    fitted = [value for name, value in results.get("metrics", {}).items() if name.startswith(TEMPERATURE)]
    if not fitted or not isinstance(fitted[0], float) or not fitted[0] > 0:
        return Temperature(None, "the run's test told none")
    return Temperature(fitted[0])


def fitted_confidence(facts: Mapping[str, Any]) -> MatchConfidence | None:
    """The confidence of matches by their margin: the network's own, or the usual one of networks.

    None for descriptors other than networks.

    Args:
        facts: facts of the descriptor, as in :class:`~sextant.chapters.places.kept_descriptor.KeptDescriptor`.
    """
    if facts["kind"] != "network":
        return None
    fitted = facts["spec"].get(FITTED)
    return UNSEEN if fitted is None else MatchConfidence(fitted["slope"], fitted["offset"])


def run_facts(given: str, found: FoundRun, model: str, trained: Mapping[str, Any]) -> dict[str, Any]:
    """Which run, which weights, and which training data."""
    facts = {"run": given, "checkpoint": str(found.checkpoint), "checkpoint_sha256": model}
    return facts | {key: trained.get(key) for key in ("digest", "seed", "code")} | {"data": trained.get("data")}
