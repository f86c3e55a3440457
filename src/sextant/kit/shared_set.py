"""The conditions of a published set of corruptions under which all runs of a sweep were tested.

A run states its set as ``protocol`` in its ``metrics.json`` (:class:`~sextant.corruptions.Protocol`). A sweep is
reported as errors under a set if every tested run has a protocol and they share a corruption. Runs tested under custom
conditions are reported as accuracies.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

CLEAN = "clean"


@dataclass(frozen=True)
class SharedSet:
    """The conditions of a published set that the tested runs of a sweep share.

    Attributes:
        tested: the distinct test sets, as pairs of key and description of how their images were made; more than one if
            runs were tested on different images.
        severities: severities of the shared conditions, by corruption in the order of the test.
        left_out: number of conditions under which only some runs were tested.
        beside: keys of shared conditions that are not of the set, by corruption.
    """

    tested: tuple[tuple[str, str], ...]
    severities: Mapping[str, tuple[int, ...]]
    left_out: int = 0
    beside: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def of(self, corruption: str) -> list[str]:
        """The keys of the conditions of one corruption."""
        return [f"{corruption}/{severity}" for severity in self.severities[corruption]]

    @property
    def keys(self) -> list[str]:
        """The keys of all shared conditions, ``clean`` first."""
        return [CLEAN, *(key for corruption in self.severities for key in self.of(corruption))]

    @property
    def key(self) -> str | None:
        """The set that all runs name; None if they name several."""
        names = {name for name, _ in self.tested}
        return names.pop() if len(names) == 1 else None

    def describe(self) -> str:
        """The titles of the sets, and how their images were made."""
        return "; or ".join(description for _, description in self.tested)


def shared_set(protocols: Sequence[Mapping[str, Any] | None], conditions: Sequence[Sequence[str]]) -> SharedSet | None:
    """The conditions of a published set that runs share; None unless each of them was tested under one.

    Args:
        protocols: protocol of each tested run; None for custom conditions.
        conditions: keys of each run's conditions, in the order of the test.
    """
    known = [(str(protocol["set"]), _description(protocol)) for protocol in protocols if protocol and "set" in protocol]
    if not known or len(known) < len(protocols):
        return None
    shared = [key for key in conditions[0] if all(key in keys for keys in conditions)]
    of_sets = {name for protocol in protocols if protocol for name in protocol.get("severities", ())}
    severities: dict[str, tuple[int, ...]] = {}
    beside: dict[str, tuple[str, ...]] = {}
    for key in shared:
        corruption, _, severity = key.rpartition("/")
        if corruption and (corruption in of_sets or not of_sets):
            severities[corruption] = (*severities.get(corruption, ()), int(severity))
        elif corruption:
            beside[corruption] = (*beside.get(corruption, ()), key)
    if CLEAN not in shared or not severities:
        return None
    left_out = len({key for keys in conditions for key in keys} - set(shared))
    return SharedSet(tuple(dict.fromkeys(known)), severities, left_out, beside)


def _description(protocol: Mapping[str, Any]) -> str:
    return f"{protocol['title']}, {protocol['mode']}, {protocol['rounding']}, seed {protocol['seed']}"
