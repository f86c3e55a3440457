"""Planning a sweep: from overrides and the ``sweep`` config to the runs it consists of."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

from sextant.composing.compose import compose, composing_many, to_plain
from sextant.composing.config_files import search_words, with_folders
from sextant.composing.overrides import Override, parse
from sextant.config import Config, validate
from sextant.config.building import naming_groups
from sextant.config.schema.searches import dimension, is_dimension
from sextant.errors import UserError
from sextant.lifecycle.checks import checked, require_environment
from sextant.lifecycle.execute import run_key
from sextant.registry import chapter_of
from sextant.reporter import SILENT, Reporter
from sextant.runs.directory import claim
from sextant.runs.sweep_directory import Cell, SweepPlan

#: key of the world of a rendered dataset, whose values are the replicates of a sweep, as seeds are
WORLD = "dataset.world"
#: name -> the overrides of an arm, and its offset to the seed
Arms = dict[str, tuple[list[str], int]]


@dataclass(frozen=True)
class Planned:
    """A cell, the overrides that run it, and whether it is finished."""

    cell: Cell
    overrides: list[str]
    finished: bool


@dataclass(frozen=True)
class Design:
    """The design of a sweep: factors x arms x worlds x seeds, with the overrides that all runs share.

    Attributes:
        definition: the ``sweep`` node without ``block``, with any arms defined by the command line.
        worlds: overrides that choose each world; a single empty one if seeds are the replicates.
        only: for some arms, the values of factors to whose settings they are confined.
        most: for some values of factors, the largest number of seeds of their settings.
        block: the part of the design to run, ``k/n``; None for all.
    """

    name: str
    definition: dict[str, Any]
    fixed: list[str]
    factors: dict[str, list[str]]
    arms: Arms
    seeds: list[int]
    worlds: list[str] = field(default_factory=lambda: [""])
    only: Mapping[str, Sequence[str]] = field(default_factory=dict)
    most: Mapping[str, int] = field(default_factory=dict)
    block: str | None = None

    @property
    def runs(self) -> int:
        """The number of different runs: arms that read different methods of the same runs share them."""
        different = {(tuple(overrides), offset): arm for arm, (overrides, offset) in self.arms.items()}
        settings = [dict(zip(self.factors, values, strict=True)) for values in product(*self.factors.values())]
        return len(self.worlds) * sum(len(self.pairs(each, arm)) for each in settings for arm in different.values())

    def pairs(self, setting: Mapping[str, str], arm: str) -> list[tuple[int, int]]:
        """Index and seed of each pair of an arm in a setting; empty if the arm is confined to others."""
        values = set(setting.values())
        if (within := self.only.get(arm)) and not values.intersection(within):
            return []
        count = min([len(self.seeds), *(most for value, most in self.most.items() if value in values)])
        return list(enumerate(self.seeds[:count]))


def make_plan(arguments: Sequence[str], reporter: Reporter = SILENT) -> tuple[SweepPlan, list[Planned], Config]:
    """Expand overrides into cells, and compose, validate and look up each on disk.

    Returns:
        The plan of the whole design, the cells of the block to run with their overrides, and the config of the first
        cell.

    Raises:
        UserError: a cell's config is wrong, the data are missing, or the sweep's keys contradict each other.
    """
    design = read_design(arguments)
    if design.definition.get("interval") == "bootstrap":
        reporter.say("sweep.interval=bootstrap has no effect: all intervals of reports are Student's t.")
    planned: list[Planned] = []
    first: Config | None = None
    with composing_many():
        for values, arm in product(product(*design.factors.values()), design.arms):
            setting = dict(zip(design.factors, values, strict=True))
            if not design.pairs(setting, arm):
                continue
            for number, world in enumerate(design.worlds):
                overrides, config = cell_config(design, setting, arm, world)
                if first is None:
                    require_environment(config, reporter)
                    first = config
                found = over_seeds(design, setting, arm, overrides, config, reporter)
                planned += [_in_world(entry, world, number * len(design.seeds)) for entry in found]
    if first is None:
        raise UserError(f"sweep={design.name}: no arm runs in any of its settings", "Correct sweep.arms.<arm>.only.")
    tracking = {"kind": first.tracking.kind, "uri": first.tracking.uri}
    cells = [entry.cell for entry in planned]
    plan = SweepPlan(design.name, design.definition, with_folders(arguments), cells, [], tracking, time.time())
    return plan, _of_block(planned, design.block), first


def _of_block(planned: list[Planned], block: str | None) -> list[Planned]:
    """The cells of the k-th of n blocks: settings and seeds in the order of the seeds, cut into n parts.

    The arms of a setting and seed stay together, so that the pairs of a block are complete.

    Raises:
        UserError: there are more blocks than settings and seeds.
    """
    if block is None:
        return planned
    places = {(entry.cell.pair, entry.cell.setting) for entry in planned}
    settings = list(dict.fromkeys(entry.cell.setting for entry in planned))
    units = sorted(places, key=lambda place: (place[0], settings.index(place[1])))
    number, count = map(int, block.split("/"))
    if count > len(units):
        raise UserError(
            f"sweep.block={block}: the sweep has {len(units)} settings and seeds, too few for {count} blocks",
            f"sweep.block={min(number, len(units))}/{len(units)}",
        )
    chosen = set(units[(number - 1) * len(units) // count : number * len(units) // count])
    return [entry for entry in planned if (entry.cell.pair, entry.cell.setting) in chosen]


def _in_world(planned: Planned, world: str, first_pair: int) -> Planned:
    """A planned cell with its world, and a pair of its own."""
    cell = replace(planned.cell, world=world.partition("=")[2], pair=first_pair + planned.cell.pair)
    return replace(planned, cell=cell)


def cell_config(design: Design, setting: Mapping[str, str], arm: str, world: str = "") -> tuple[list[str], Config]:
    """The overrides of an arm in a setting and a world, and the config that they compose.

    Raises:
        UserError: the config is wrong, or the arm reads a method that its runs will not have.
    """
    chosen = [f"{key}={value}" for key, value in setting.items()] + [world] * bool(world)
    overrides = [*design.fixed, *chosen, *design.arms[arm][0]]
    config = checked(to_plain(compose(overrides)))
    _require_room(config)
    _check_read(arm, design.definition, config)
    return overrides, config


def _require_room(config: Config) -> None:
    """Raise a ``UserError`` unless the launcher provides a run of several processes with enough devices."""
    launcher, devices = config.launcher, config.trainer.devices
    if devices == 1:
        return
    if launcher.kind == "local":
        raise UserError(
            f"trainer.devices={devices} launcher=local: a sweep's process cannot start a run of several",
            "Give each run a process of its own: launcher=joblib launcher.workers=1; or a job: launcher=slurm "
            f"launcher.cpus={devices}. Without -m, train.py runs a single one.",
        )
    unit = "gpus" if config.trainer.accelerator == "gpu" else "cpus"
    if getattr(launcher, unit, devices) < devices:
        raise UserError(
            f"trainer.devices={devices} needs as many {unit}; a run has launcher.{unit}={getattr(launcher, unit)}",
            f"launcher.{unit}={devices}",
        )


def over_seeds(
    design: Design,
    setting: dict[str, str],
    arm: str,
    overrides: list[str],
    config: Config,
    reporter: Reporter,
) -> list[Planned]:
    """The runs of an arm in a setting, one per seed of the design, looked up on disk."""
    outputs = Path(config.paths.outputs)
    planned = []
    follows_seed = any("${seed}" in override for override in overrides)
    with naming_groups(config.plain):
        source = chapter_of(config.task.name, reporter).source(config)
        key = run_key(config, source)
    for pair, number in design.pairs(setting, arm):
        seed = number + design.arms[arm][1]
        if follows_seed:
            config = validate(to_plain(compose([*overrides, f"seed={seed}"])))
            key = run_key(config, source)
        key = replace(key, seed=seed)
        found = claim(outputs, key, config.reuse)
        run = found.directory.path.relative_to(outputs).as_posix()
        cell = Cell(setting, arm, pair, key.seed, key.digest, run)
        planned.append(Planned(cell, [*overrides, f"seed={key.seed}"], found.finished))
    return planned


def read_design(arguments: Sequence[str]) -> Design:
    """The design that overrides define.

    Values of the overrides replace a stored sweep's factors, seeds and worlds; several values of ``dataset.world`` are
    worlds, too. Without arms in the config, the sweep compares the values of the last key that lists several, and its
    first value is the control.
    """
    parsed = parse(arguments)
    given = {o.key: o.choices() for o in parsed}
    swept = {o.key: given[o.key] for o in parsed if o.sweeps}
    fixed = [o.text for o in parsed if not o.sweeps]
    base = to_plain(compose([*fixed, *(f"{key}={choices[0]}" for key, choices in swept.items())]))
    definition: dict[str, Any] = base.get("sweep") or {"name": "sweep"}
    sweep = validate({**base, "sweep": definition}).sweep
    assert sweep is not None

    seeds = seeds_given(swept.pop("seed", given.get("seed")), sweep.seeds if base.get("sweep") else [base["seed"]])
    named = {key: [str(value) for value in values] for key, values in sweep.worlds.items()} or {WORLD: []}
    world = next(iter(named))
    if world in swept:
        named = {world: swept.pop(world)}
        definition |= {"worlds": named}
    if len(set(named[world])) < len(named[world]):
        raise UserError(f"{world}={','.join(named[world])}: worlds must differ", "Name others.")
    factors = {key: given.get(key, [str(v) for v in values]) for key, values in sweep.factors.items()} | swept
    arms: Arms = {name: (arm.overrides, arm.seed_offset) for name, arm in sweep.arms.items()}
    _refuse_arm_keys(given, arms)
    if not arms and factors:
        compared = list(factors)[-1]
        arms = {value: ([f"{compared}={value}"], 0) for value in factors.pop(compared)}
        definition |= {"arms": {name: {"overrides": overrides} for name, (overrides, _) in arms.items()}}
    only = {name: arm.only for name, arm in sweep.arms.items()}
    definition = {key: value for key, value in definition.items() if key != "block"}
    return Design(
        sweep.name,
        definition,
        fixed,
        factors,
        arms or {"run": ([], 0)},
        seeds,
        [f"{world}={value}" for value in named[world]] or [""],
        only,
        sweep.seeds_of,
        sweep.block,
    )


def sweep_words(arguments: Sequence[str]) -> list[str]:
    """Rewrite the arguments of a sweep so that Hydra can compose them.

    ``preset=quick`` becomes the sweep's small form, in which keys given with it win. ``sweep.block`` is a key of
    every sweep, whether its file names it or not.

    Raises:
        UserError: there is no such preset, no named sweep, or the sweep has no small form.
    """
    chosen = [word for word in arguments if word.startswith("preset=")]
    rest = [f"++{word}" if word.startswith("sweep.block=") else word for word in arguments if word not in chosen]
    if not chosen or chosen[-1] == "preset=full":
        return rest
    named = [word for word in rest if word.startswith("sweep=")]
    if chosen[-1] != "preset=quick" or not named:
        raise UserError(
            f"{chosen[-1]} {' '.join(named)}: preset= sets the size of a named sweep, quick or full",
            "For example -m sweep=pushpull_placement preset=quick",
        )
    quick = (to_plain(compose(named[-1:])).get("sweep") or {}).get("quick")
    if quick is None:
        raise UserError(f"{named[-1]} has no quick form", "preset=full runs it; so does leaving the preset out.")
    given = {override.key for override in parse(search_words(rest))}
    at = rest.index(named[-1]) + 1
    return [*rest[:at], *(each.text for each in parse(quick) if each.key not in given), *rest[at:]]


def _check_read(arm: str, definition: Mapping[str, Any], config: Config) -> None:
    """Raise a ``UserError`` if an arm reads a method that its runs will not have."""
    reads = definition.get("arms", {}).get(arm, {}).get("reads")
    if reads is None:
        return
    known = chapter_of(config.task.name).answers(config)
    if reads not in known:
        told = f"its runs have the methods {', '.join(known)}" if known else f"task={config.task.name} has one method"
        raise UserError(
            f"sweep.arms.{arm}.reads={reads}: {told}",
            "Name one of them, or add it to task.methods and the network it needs to the run: descriptor=run:<id>.",
        )


def seeds_given(given: list[str] | None, default: list[int]) -> list[int]:
    """The seeds given on the command line, or else the default.

    Raises:
        UserError: a seed is not a whole number, or two are equal.
    """
    if given is None:
        return default
    if not all(seed.isdigit() for seed in given) or len(set(given)) < len(given):
        raise UserError(
            f"seed={','.join(given)}: seeds must be different whole numbers from 0", "For example seed=0,1,2"
        )
    return [int(seed) for seed in given]


def _refuse_arm_keys(given: Mapping[str, object], arms: Arms) -> None:
    """Raise a ``UserError`` if the command line sets a key that the arms of a stored sweep set."""
    for name, (overrides, _) in arms.items():
        for override in overrides:
            key = override.split("=")[0]
            if key in given:
                raise UserError(
                    f"{key} is what the arms of this sweep compare (arm {name} sets {override})",
                    f"Leave {key} out, or list the values in a sweep of your own: -m {key}=a,b",
                )


def check_sweep_overrides(overrides: Sequence[str]) -> None:
    """Find mistakes in the choices of a sweep before it is planned, by composing each choice once.

    Raises:
        UserError: as :func:`~sextant.composing.compose.compose`.
    """
    parsed = parse(search_words(overrides))
    for override in parsed:
        if override.key.replace(".", "/").startswith("hydra/launcher"):
            raise UserError(
                f"{override.text}: sweeps do not use Hydra's launchers", "launcher=joblib launcher.workers=4"
            )
    choices = [[f"{o.key}={choice}" for choice in o.choices()] if o.sweeps else [_one_value(o)] for o in parsed]
    first = [options[0] for options in choices]
    with composing_many():
        compose(first)
        for number, options in enumerate(choices):
            for option in options[1:]:
                compose([*first[:number], option, *first[number + 1 :]])


def _one_value(override: Override) -> str:
    """An override as it is composed, with a range replaced by its middle.

    Raises:
        UserError: the range is invalid.
    """
    if override.deletes or not is_dimension(override.value):
        return override.text
    try:
        return f"{override.key}={dimension(override.value).middle}"
    except ValueError as error:
        raise UserError(f"{override.key}={override.value}: not a range to search", str(error)) from None
