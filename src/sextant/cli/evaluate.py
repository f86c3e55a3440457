"""``evaluate.py``: test a trained model, under other data or corruptions."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import OverrideParseException

from sextant.cli.compose import compose, to_plain
from sextant.cli.config_files import groups
from sextant.cli.show import show_result
from sextant.cli.terminal import TERMINAL
from sextant.config import Config, digest, nearest
from sextant.config.trained import trained_config
from sextant.errors import UserError
from sextant.lifecycle.checks import require_device
from sextant.lifecycle.execute import OpenMirror, identity_of, run_once
from sextant.recipes import Source, recipe_of
from sextant.runs.directory import RunDirectory, RunKey
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import FoundRun, resolve_run
from sextant.runs.source_tree import source_sha256
from sextant.tracking.environment import quiet_libraries

USAGE = (
    "python evaluate.py run=<MLflow run id, run directory, checkpoint or published .pth.tar> "
    "[dataset=..] [corruption=..] [key=value ..]"
)
#: What may differ from training; the rest belongs to the weights.
FREE = (
    *("dataset", "corruption", "test_sampling", "trainer", "tracking", "paths", "reuse"),
    *("fault", "faults", "recovery", "motion", "filter"),  # how a robot is localized, in the map that was trained
)


def main(arguments: Sequence[str]) -> None:
    """Rebuild the model from its checkpoint alone and test it."""
    quiet_libraries()
    if any(argument in ("-h", "--help") for argument in arguments):
        print(f"{USAGE}\n\n  what may change: {', '.join(FREE)}; keys as in train.py --cfg job")
        return
    reference, overrides = split_run(arguments, USAGE)
    found = resolve_run(reference, _outputs(overrides))
    from sextant.runs.checkpoint import KEY
    from sextant.trained.content import read_trained

    content = read_trained(found.checkpoint)
    raw, config = checkpoint_config(content[KEY], overrides)
    recipe = recipe_of(config.task.name, TERMINAL)
    source = recipe.source(raw, config)
    recipe.require_fit(raw, content[KEY]["spec"], source)
    from sextant.lifecycle.training import test_checkpoint

    key = _key(config, source, found)

    def work(directory: RunDirectory, open_mirror: OpenMirror) -> dict[str, Any]:
        open_mirror()
        return test_checkpoint(raw, config, source, content, found.checkpoint, directory, key, TERMINAL)

    device, published = partial(require_device, config), content[KEY].get("published")
    outcome = run_once(key, raw, config, work, device, published=published, reporter=TERMINAL)
    show_result(RunDirectory(outcome.directory), task=config.task.name, reused=outcome.reused)


def checkpoint_config(trained: Mapping[str, Any], overrides: Sequence[str]) -> tuple[dict[str, Any], Config]:
    """The config of a checkpoint with ``overrides``, plain and typed.

    Raises:
        UserError: an override is wrong, label and config are of two tasks, or the checkpoint names an import path that
            is not one of Sextant's: building it would run code that the file chose. ``trust=true`` allows it.
    """
    trust = "trust=true" in overrides
    raw = merge(trained["config"], [override for override in overrides if override != "trust=true"])
    config = trained_config(raw, trained["task"], trust=trust)
    if (within := trained["spec"].get("features")) is not None:  # of another run's network, which is built as well
        trained_config(within["config"], within["task"], trust=trust)
    return raw, config


def split_run(arguments: Sequence[str], usage: str) -> tuple[str, list[str]]:
    """Take ``run=`` out of the arguments.

    Raises:
        UserError: it is not there.
    """
    runs = [argument.removeprefix("run=") for argument in arguments if argument.startswith("run=")]
    if not runs:
        raise UserError("which run?", usage)
    return runs[-1], [argument for argument in arguments if not argument.startswith("run=")]


def merge(trained: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """The config of a checkpoint with other groups and values; where things lie is taken from here, not from there.

    Raises:
        UserError: an override is not understood, or would change what the weights were trained with.
    """
    try:
        parsed = OverridesParser.create().parse_overrides(list(overrides))
    except OverrideParseException:
        compose(overrides)  # names the one that cannot be parsed
        raise
    settings = [f"task.{key}" for key in recipe_of(str(trained.get("task", {}).get("name"))).test_settings]
    for override, text in zip(parsed, overrides, strict=True):
        group = _place(override)
        if group not in FREE and override.key_or_group not in settings:
            known = nearest(group, FREE) if group not in trained and group not in groups() else None
            raise UserError(
                f"{text}: " + ("unknown key" if known else "this belongs to the trained weights and cannot change"),
                f"Did you mean {known}?" if known else f"What may change: {', '.join([*FREE, *settings])}",
            )
    if any(override.is_delete() or override.is_sweep_override() for override in parsed):
        raise UserError(f"{' '.join(overrides)}: give one value to each key", USAGE)
    chosen = {_place(o) for o in parsed if o.key_or_group in groups()} | {"paths", "tracking"}
    composed = to_plain(compose([t for o, t in zip(parsed, overrides, strict=True) if _place(o) in chosen]))
    merged = dict(trained) | {group: composed[group] for group in chosen}
    merged |= {"reuse": "exact", "init_from": None, "sweep": None}
    for override, text in zip(parsed, overrides, strict=True):
        if _place(override) not in chosen:
            _set(merged, override.key_or_group, override.value(), text)
    return merged


def _place(override: Override) -> str:
    """Where in the config an override belongs: ``test_sampling`` for ``sampling@test_sampling=..``."""
    return str(override.package or override.key_or_group.split(".")[0])


def _set(config: dict[str, Any], key: str, value: Any, text: str) -> None:
    node: Any = config
    *parents, last = key.split(".")
    for part in parents:
        if not isinstance(node, dict) or part not in node:
            raise UserError(f"{text}: unknown key", f"Keys there: {', '.join(node) if isinstance(node, dict) else ''}")
        node[part] = dict(node[part]) if isinstance(node[part], dict) else node[part]
        node = node[part]
    if not isinstance(node, dict) or last not in node:
        near = nearest(last, node)
        prefix = ".".join([*parents, ""])
        raise UserError(f"{text}: unknown key", f"Did you mean {prefix}{near}={value}?" if near else "")
    node[last] = value


def _key(config: Config, source: Source, found: FoundRun) -> RunKey:
    identity = digest({**identity_of(config), "checkpoint": found.identity})
    code = source_sha256(config.custom_targets())
    return RunKey("evaluation", identity, config.seed, code, source.fingerprint())


def _outputs(overrides: Sequence[str]) -> Path:
    given = [o.removeprefix("paths.outputs=") for o in overrides if o.startswith("paths.outputs=")]
    return Path(given[-1]).expanduser().absolute() if given else default_outputs()
