"""The conditions of a published set of corruptions under which all runs of a sweep were tested.

A run says so itself: the ``protocol`` in its ``metrics.json`` (:class:`~sextant.corruptions.Protocol`). A sweep is
reported as errors under a set if every tested run has a protocol and they share a corruption; runs tested under
conditions of one's own are reported as accuracies.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

CLEAN = "clean"


@dataclass(frozen=True)
class SharedSet:
    """What the tested runs of a sweep share of a published set.

    Attributes:
        tested: the sets with what else decides which images they are, each once: key and description; more than one if
            runs were tested under different images.
        severities: of the shared conditions, by corruption in the order of the test.
        left_out: conditions that only some runs were tested under.
    """

    tested: tuple[tuple[str, str], ...]
    severities: Mapping[str, tuple[int, ...]]
    left_out: int = 0

    def of(self, corruption: str) -> list[str]:
        """Keys of the conditions of one corruption."""
        return [f"{corruption}/{severity}" for severity in self.severities[corruption]]

    @property
    def keys(self) -> list[str]:
        """Keys of all shared conditions, ``clean`` first."""
        return [CLEAN, *(key for corruption in self.severities for key in self.of(corruption))]

    @property
    def key(self) -> str | None:
        """The one set that all runs name, or None if they name several."""
        names = {name for name, _ in self.tested}
        return names.pop() if len(names) == 1 else None

    def describe(self) -> str:
        """The sets by title, and how their images were made."""
        return "; or ".join(description for _, description in self.tested)


def shared_set(protocols: Sequence[Mapping[str, Any] | None], conditions: Sequence[Sequence[str]]) -> SharedSet | None:
    """What runs share of a published set, None unless each of them was tested under one.

    Args:
        protocols: of each tested run; None for conditions of one's own.
        conditions: keys of each run's conditions, in the order of the test.
    """
    known = [(str(protocol["set"]), _description(protocol)) for protocol in protocols if protocol and "set" in protocol]
    if not known or len(known) < len(protocols):
        return None
    shared = [key for key in conditions[0] if all(key in keys for keys in conditions)]
    severities: dict[str, tuple[int, ...]] = {}
    for key in shared:
        corruption, _, severity = key.rpartition("/")
        if corruption:
            severities[corruption] = (*severities.get(corruption, ()), int(severity))
    if CLEAN not in shared or not severities:
        return None
    left_out = len({key for keys in conditions for key in keys} - set(shared))
    return SharedSet(tuple(dict.fromkeys(known)), severities, left_out)


def _description(protocol: Mapping[str, Any]) -> str:
    return f"{protocol['title']}, {protocol['mode']}, {protocol['rounding']}, seed {protocol['seed']}"
