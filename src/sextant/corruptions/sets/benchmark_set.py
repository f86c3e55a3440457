"""A published benchmark set: its corruptions in order, their parameters, and its protocol."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from importlib import import_module
from typing import Any

from sextant.corruptions.benchmark_corruption import SEVERITIES, BenchmarkCorruption, Mode
from sextant.errors import ArgumentError

BENCHMARK_15, EXTRA_4 = "benchmark15", "extra4"


@dataclass(frozen=True)
class Recipe:
    """One corruption of a set.

    Args:
        path: ``group.module.Class`` within :mod:`sextant.corruptions`, imported when it is built.
        table: its row of parameters for each severity.
        published: the severities in the published set.
        options: further arguments in both modes.
        quirks: further arguments in faithful mode alone.
    """

    path: str
    table: Sequence[Any]
    published: tuple[int, ...] = SEVERITIES
    options: Mapping[str, Any] = field(default_factory=dict)
    quirks: Mapping[str, Any] = field(default_factory=dict)

    def build(self, name: str, severities: Sequence[int] | None, mode: Mode) -> BenchmarkCorruption[Any, Any]:
        """The corruption ``name`` at those of ``severities`` that it has, or else at the published ones."""
        module, kind = self.path.rsplit(".", 1)
        family = getattr(import_module(f"sextant.corruptions.{module}"), kind)
        chosen = self.published if severities is None else tuple(s for s in severities if s <= len(self.table))
        options = {**self.options, **(self.quirks if mode == "faithful" else {})}
        if any(f.name == "mode" for f in fields(family)):
            options["mode"] = mode
        built: BenchmarkCorruption[Any, Any] = family(self.table, name, chosen or self.published, **options)
        return built


@dataclass(frozen=True)
class BenchmarkSet:
    """A published set.

    Args:
        key: its name in configs.
        title: its name in reports, with the source.
        families: the corruptions by name in the published order.
        groups: names of groups of corruptions, for ``names``.
        baseline: the errors that a corruption error is divided by in the set's literature.
        image_size: size of the images the set was published for, in pixels; parameters in pixels are meant for it.
    """

    key: str
    title: str
    families: Mapping[str, Recipe]
    groups: Mapping[str, tuple[str, ...]]
    baseline: str
    image_size: int

    def build(
        self,
        names: str | Sequence[str] | None = None,
        severities: Sequence[int] | None = None,
        mode: Mode = "faithful",
    ) -> dict[str, BenchmarkCorruption[Any, Any]]:
        """The chosen corruptions by name, in the published order.

        Args:
            names: all (``None``), a group, one name, or a list of names and groups.
            severities: some of 1 to 5; ``None`` for the published ones. A corruption without severities is there once.
            mode: ``faithful`` to the authors' code, errors included, or ``corrected``.

        Raises:
            UserError: the set does not have a name, severity or mode.
        """
        if mode not in ("faithful", "corrected"):
            raise ArgumentError(f"mode={mode} is not known; it is faithful or corrected")
        chosen = self._names(names)
        wanted = self._severities(severities)
        return {name: f.build(name, wanted, mode) for name, f in self.families.items() if name in chosen}

    def _names(self, names: str | Sequence[str] | None) -> set[str]:
        if names is None:
            return set(self.families)
        chosen: set[str] = set()
        for name in [names] if isinstance(names, str) else names:
            if name not in self.families and name not in self.groups:
                known = ", ".join([*self.groups, *self.families])
                raise ArgumentError(f"names={name} is not in the set {self.key}", f"It has: {known}.")
            chosen |= set(self.groups.get(name, (name,)))
        if not chosen:
            raise ArgumentError("names=[] chooses no corruption", "Leave it out, or null, for all.")
        return chosen

    def _severities(self, severities: Sequence[int] | None) -> tuple[int, ...] | None:
        if severities is None:
            return None
        if not severities or any(s not in SEVERITIES for s in severities) or len(set(severities)) < len(severities):
            given = "[" + ",".join(map(str, severities)) + "]"
            raise ArgumentError(f"severities={given} has to be a list of some of 1, 2, 3, 4, 5, each once")
        return tuple(sorted(int(s) for s in severities))
