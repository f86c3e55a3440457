"""One drive through a town again and again, each time with one factor of the appearance changed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy import ndarray

from sextant.data.worlds.shots import SPLITS, Shots, WorldPlan
from sextant.data.worlds.towns import TownSeasons, TownSeasonsPlan
from sextant.errors import ArgumentError
from sextant.worlds.appearance import condition, with_factors

#: the drive of the map, and the one of all queries: nothing but the factor differs between two queries of a place
MAP_DRIVE, QUERY_DRIVE = 0, 1
#: a store numbers its conditions in one byte
MOST_CONDITIONS = 127
TRAIN, TEST = SPLITS.index("train"), SPLITS.index("test")


def factor_conditions(base: str, factors: Mapping[str, Sequence[float]]) -> list[Any]:
    """What is rendered: the map, the same appearance on another drive, and ``<factor>=<value>`` for every other value.

    Raises:
        UserError: there is no such condition or factor, a value is out of range or twice there, or they are too many or
            none but the map's own.
    """
    look = condition(base)
    conditions: list[Any] = [base, {"name": f"{base}_again", "condition": base}]
    for factor, values in factors.items():
        with_factors(look, dict.fromkeys([factor], values[0]))  # there is such a factor
        names = [f"{factor}={value:g}" for value in values]
        if len(set(names)) < len(names):
            raise ArgumentError(f"factors.{factor}={list(values)}: each value must occur once, to six digits")
        own = f"{factor}={getattr(look, factor):g}"
        conditions += [
            {"name": name, "condition": base, factor: value}
            for name, value in zip(names, values, strict=True)
            if name != own
        ]
    if len(conditions) == 2:
        raise ArgumentError(
            f"factors={dict(factors)} has no values other than those of {base}, which the map has",
            "For example 'factors.fog_per_m=[0.01,0.04]'",
        )
    if len(conditions) > MOST_CONDITIONS:
        raise ArgumentError(
            f"factors has {len(conditions) - 2} values in all; at most {MOST_CONDITIONS - 2} are possible",
            "Render the factors in two datasets.",
        )
    return conditions


class TownFactorsPlan(TownSeasonsPlan):
    """The towns of :class:`TownSeasonsPlan`, fewer places of them, and more appearances; see :class:`TownFactors`."""

    def lay_out(self) -> Shots:
        """The map's condition in the training town; all conditions in the test town, those of one geometry together."""
        structures = list(dict.fromkeys(look.structure for look in self.appearances))

        def geometry(number: int) -> int:
            return structures.index(self.appearances[number].structure)

        drives = {number: self.traverse(TEST, number) for number in (MAP_DRIVE, QUERY_DRIVE)}
        ordered = sorted(range(len(self.appearances)), key=geometry)  # a town is built once for each geometry
        test = [self._part(TEST, number, *drives[QUERY_DRIVE if number else MAP_DRIVE]) for number in ordered]
        return Shots.join([self._part(TRAIN, 0, *self.traverse(TRAIN, MAP_DRIVE)), *test])

    def _part(self, split: int, number: int, pose: ndarray, velocity: ndarray) -> Shots:
        n = self.config["places"][SPLITS[split]]
        return Shots.of(split, number, split, np.arange(n), pose[:n], velocity=velocity[:n])

    def describe(self) -> dict[str, Any]:
        """Towns, the length of the drive, and the factors."""
        drive_m = self.config["places"]["test"] * self.config["step_m"]
        return super().describe() | {"drive_kilometres": round(drive_m / 1000, 3), "factors": self.config["factors"]}


class TownFactors(TownSeasons):
    """A short drive of ``TownSeasons``' test town under appearances that differ from the map's in one factor.

    For tests alone. The map is driven under the condition ``base``. A second drive along the same route is rendered
    under ``base`` again, as ``<base>_again``, and under ``base`` with one factor changed, as ``<factor>=<value>``: all
    queries of a place are taken from the same spot. Training images, for descriptors that learn from images of the
    map's condition, are of the training town; there are none for validation.

    Keys: those of ``TownSeasons`` but ``conditions``; with ``frames`` equal to those that a network was trained on, the
    streets are those of its towns. ``places`` of the training and the test town that are rendered, ``base``,
    ``factors``: values by the name of a factor of :class:`~sextant.worlds.Appearance`, ``only``: the names of those
    that are rendered, or None for all.
    """

    name = "town_factors"

    def plan(self) -> WorldPlan:
        """What is rendered."""
        for split, places in self.config["places"].items():
            if places > self.config["frames"][split]:
                raise ArgumentError(
                    f"places.{split}={places} is more than frames.{split}="
                    f"{self.config['frames'][split]}, the frames of that drive",
                    f"places.{split}={self.config['frames'][split]}",
                )
        factors = self._chosen()
        conditions = factor_conditions(self.config["base"], factors)
        config = {**self.identified(), "factors": factors, "only": None}
        return TownFactorsPlan(self.name, config, conditions, self.config["samples"])

    def _chosen(self) -> dict[str, list[float]]:
        factors, only = self.config["factors"], self.config["only"]
        if unknown := sorted(set(only or ()) - set(factors)):
            raise ArgumentError(
                f"only names {', '.join(unknown)}, which have no values in factors",
                f"Choose among {', '.join(factors)}, or give values: +factors.{unknown[0]}=[...]",
            )
        return {name: list(values) for name, values in factors.items() if only is None or name in only}
