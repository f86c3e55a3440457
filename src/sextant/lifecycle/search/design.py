"""The design of a search: its space, its seeds, and the config that they vary."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import search_words
from sextant.composing.overrides import Override, parse
from sextant.config import Config, validate
from sextant.config.schema.searches import Dimension, Search, is_dimension
from sextant.errors import UserError
from sextant.lifecycle.execute import run_digest
from sextant.lifecycle.sweep_plan import Design, Planned, cell_config, over_seeds, seeds_given
from sextant.registry import chapter_of
from sextant.reporter import SILENT, Reporter

#: distance of the seeds at which a winner is tested from those at which it was chosen
FRESH = 1000


@dataclass(frozen=True)
class SearchDesign:
    """A search, as its command line and its stored sweep describe it.

    Attributes:
        name: name of the sweep.
        definition: the ``sweep`` node, with all defaults filled in.
        arguments: arguments of the command line.
        fixed: the overrides that all runs share.
        search: the validated node, with metric, direction and fresh seeds filled in.
        seeds: seeds of each trial, in the order in which they are run.
        experiment: digest of the config in the middle of the space.
    """

    name: str
    definition: dict[str, Any]
    arguments: tuple[str, ...]
    fixed: tuple[str, ...]
    search: Search
    seeds: tuple[int, ...]
    experiment: str

    @property
    def space(self) -> dict[str, Dimension]:
        """The search space, by key."""
        return self.search.dimensions

    @property
    def fresh(self) -> tuple[int, ...]:
        """The seeds at which the winner is tested."""
        return tuple(self.search.fresh_seeds or ())

    @property
    def trials(self) -> int:
        """The number of trials; a grid has no more than its points."""
        return int(min(self.search.n_trials, self.search.points if self.search.method == "grid" else math.inf))

    @property
    def sign(self) -> int:
        """1 if higher is better, -1 if lower is better."""
        return 1 if self.search.direction == "maximize" else -1

    @property
    def identity(self) -> dict[str, Any]:
        """What identifies a search; the number of its trials and the way they are raced are not part of it."""
        kept = ("method", "space", "metric", "direction", "sampler_seed")
        return {name: getattr(self.search, name) for name in kept} | {
            "seeds": list(self.seeds),
            "experiment": self.experiment,
        }

    @property
    def digest(self) -> str:
        """SHA-256 of :attr:`identity`, which names the folder."""
        return hashlib.sha256(json.dumps(self.identity, sort_keys=True).encode()).hexdigest()

    def planned(self, arm: str, setting: Mapping[str, str], reporter: Reporter = SILENT) -> list[Planned]:
        """The runs of a point, first at the seeds of the search and then at the fresh ones.

        Raises:
            UserError: the config of the point is wrong.
        """
        design = Design(self.name, {}, list(self.fixed), {}, {arm: ([], 0)}, [*self.seeds, *self.fresh])
        overrides, config = cell_config(design, setting, arm)
        return over_seeds(design, dict(setting), arm, overrides, config, reporter)


def read_search(arguments: Sequence[str]) -> tuple[SearchDesign, Config] | None:
    """The search that overrides define and the config in the middle of its space; None if they define no search.

    A key that is given one value is not searched, even if a stored sweep does so; a key that lists several is a choice.

    Raises:
        UserError: a range cannot be parsed, its bounds make an invalid config, or the method does not suit the space.
    """
    parsed = parse(search_words(arguments))
    ranges = {o.key: str(o.value) for o in parsed if _is_range(o)}
    ranges |= {o.key: f"choice({','.join(o.choices())})" for o in parsed if o.sweeps and o.key != "seed"}
    fixed = [o for o in parsed if not o.sweeps and not _is_range(o)]
    started = [o.text for o in fixed] + [f"{o.key}={o.choices()[0]}" for o in parsed if o.sweeps and o.key != "seed"]
    base = to_plain(compose(started))
    node = base.get("sweep") or {}
    if node.get("search") is None:
        if numbers := [o for o in parsed if _is_range(o)]:
            raise UserError(
                f"{numbers[0].key}={numbers[0].value} is a range, but a sweep lists values",
                f"Search it: add sweep.search=tpe. Or list values: {numbers[0].key}=a,b,c",
            )
        return None
    given = {o.key: o.choices() for o in parsed}
    space = {key: text for key, text in (node["search"].get("space") or {}).items() if key not in given} | ranges
    node = {"name": "search", **node, "search": {**node["search"], "space": space}}
    sweep = validate({**base, "sweep": node}).sweep
    assert sweep is not None
    assert sweep.search is not None
    seeds = seeds_given(given.get("seed"), sweep.seeds)
    search = _filled(sweep.search, chapter_of(base["task"]["name"]).monitor, seeds)
    if set(seeds) & set(search.fresh_seeds or ()):
        raise UserError(f"seed={','.join(map(str, seeds))}: sweep.search.fresh_seeds contains one of these")
    kept = tuple(o.text for o in fixed if o.key != "seed" and not o.key.startswith("sweep."))
    config = _check_ends(kept, search)
    definition = {**node, "seeds": seeds, "search": search.model_dump()}
    design = SearchDesign(sweep.name, definition, tuple(arguments), kept, search, tuple(seeds), run_digest(config))
    return design, config


def _is_range(override: Override) -> bool:
    return not override.sweeps and not override.deletes and is_dimension(override.value)


def _filled(search: Search, monitor: tuple[str, str], seeds: Sequence[int]) -> Search:
    """Fill in the defaults of a search; a metric of the user's own needs a direction."""
    metric, mode = monitor
    if search.metric not in (None, metric) and search.direction is None:
        raise UserError(
            f"sweep.search.metric={search.metric}: its direction is unknown",
            "Add sweep.search.direction=minimize or maximize",
        )
    filled = {
        "metric": search.metric or metric,
        "direction": search.direction or {"max": "maximize", "min": "minimize"}[mode],
        "fresh_seeds": search.fresh_seeds or [max(seeds) + FRESH + k for k in range(len(seeds))],
    }
    return search.model_copy(update=filled)


def _check_ends(fixed: Sequence[str], search: Search) -> Config:
    """The config in the middle of the space; raises a ``UserError`` if it or one at the ends of a key is invalid."""
    space = search.dimensions
    middle = {key: found.middle for key, found in space.items()}
    design = Design("search", {}, list(fixed), {}, {"middle": ([], 0)}, [0])
    _, config = cell_config(design, middle, "middle")
    for key, found in space.items():
        for end in found.ends:
            if end != middle[key]:
                cell_config(design, {**middle, key: end}, "middle")
    return config
