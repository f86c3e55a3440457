"""Testing a trained run on other data or under other conditions."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import groups
from sextant.composing.overrides import parse
from sextant.config import Config, digest, nearest, validate
from sextant.config.building import naming_groups
from sextant.config.path_keys import from_where_it_ran
from sextant.data.source import ImageSource
from sextant.errors import UserError
from sextant.kit.chapter import Source
from sextant.kit.published_places import CARD, card_text
from sextant.kit.trained import own_config, read_trained
from sextant.lifecycle.checks import checked, require_apart, require_device, require_outputs
from sextant.lifecycle.execute import OpenMirror, Outcome, run_once
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.registry import chapter_of
from sextant.runs.directory import RunDirectory, RunKey
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run
from sextant.runs.source_tree import source_sha256
from sextant.tracking.further_loggers import require_loggers

if TYPE_CHECKING:
    from sextant.models.foreign_classifier import ForeignClassifier

#: Config groups that may differ from training; all others belong to the weights.
FREE = (
    *("dataset", "corruption", "test_sampling", "trainer", "tracking", "paths", "reuse"),
    "local",  # which local features re-rank matches
    *("fault", "faults", "recovery", "motion", "filter"),  # how a robot is localized in the trained map
)
#: groups that may be chosen for a classifier of others
OF_FOREIGN = ("dataset", "corruption", "inhibition", "trainer", "tracking", "paths", "reuse")


def evaluate_run(run: str, overrides: Sequence[str], reporter: RunReporter = SILENT_RUN) -> Outcome:
    """Rebuild a model from its checkpoint alone and test it; a test that is already finished is returned.

    Args:
        run: an MLflow run id, a run directory, a checkpoint or a published ``.pth.tar``.
        overrides: overrides of its config, limited to the groups in :data:`FREE` and the task's test settings.
        reporter: listens to the test.

    Raises:
        UserError: the run does not exist, an override is wrong, or the model does not fit the data.
    """
    outputs = _outputs(overrides)
    if outputs.exists():  # created only once it is known to be apart from the images
        require_outputs(outputs)
    found = resolve_run(run, outputs)
    from sextant.runs.checkpoint import KEY

    content = read_trained(found.checkpoint)
    config = checkpoint_config(content[KEY], overrides)
    require_loggers(config.tracking.also)
    require_apart(config)
    require_outputs(outputs)
    if (card := content[KEY].get(CARD)) is not None:
        reporter.say(card_text(card))
    chapter = chapter_of(config.task.name, reporter)
    with naming_groups(config.plain):
        source = chapter.source(config)
        chapter.require_fit(config, content[KEY]["spec"], source)
    return _tested(config, source, content, found.checkpoint, found.identity, reporter)


def evaluate_model(model: str, overrides: Sequence[str], reporter: RunReporter = SILENT_RUN) -> Outcome:
    """Test a classifier of others, with an inhibition put into it or not; a test that is finished is returned.

    Args:
        model: ``timm:<name or file>`` or ``robustbench:<file>``.
        overrides: overrides of a config of classification, limited to :data:`OF_FOREIGN`.
        reporter: listens to the test.

    Raises:
        UserError: the classifier cannot be read, an override is wrong, or the classifier does not fit the data.

    Example:
        >>> evaluate_model("timm:resnet18.safetensors", ["dataset=cifar10", "corruption=cifar10_c"])  # doctest: +SKIP
    """
    outputs = _outputs(overrides)
    require_foreign_overrides(overrides)
    from sextant.kit.foreign import foreign_content, require_foreign_fit
    from sextant.models.foreign_classifier import read_foreign

    foreign = read_foreign(model)
    config = foreign_config(foreign, overrides)
    require_loggers(config.tracking.also)
    require_apart(config)
    require_outputs(outputs)
    with naming_groups(config.plain):
        source = chapter_of(config.task.name, reporter).source(config)
        assert isinstance(source, ImageSource)
        require_foreign_fit(foreign, source)
        source.files("test")
        content = foreign_content(foreign, config, source)
    return _tested(config, source, content, Path(model), foreign.identity, reporter)


def _tested(
    config: Config,
    source: Source,
    content: Mapping[str, Any],
    checkpoint: Path,
    weights: str,
    reporter: RunReporter,
) -> Outcome:
    """Test a model under ``config``, unless that was done before.

    Args:
        config: its config, with the test conditions.
        source: the data.
        content: the model in the form of a checkpoint.
        checkpoint: its file, for messages.
        weights: hash that identifies the weights.
        reporter: listens to the test.
    """
    from sextant.runs.checkpoint import KEY

    with naming_groups(config.plain):
        identity = digest({**chapter_of(config.task.name).identity(config), "checkpoint": weights})
        code = source_sha256(config.custom_targets())
        key = RunKey("evaluation", identity, config.seed, code, source.fingerprint())
    from sextant.lifecycle.training import test_checkpoint

    def work(directory: RunDirectory, open_mirror: OpenMirror) -> dict[str, Any]:
        open_mirror()
        return test_checkpoint(config, source, content, checkpoint, directory, key, reporter)

    device, origin = partial(require_device, config), content[KEY].get("published") or content[KEY].get("foreign")
    with naming_groups(config.plain):
        return run_once(key, config, work, device, published=origin, reporter=reporter)


def require_foreign_overrides(overrides: Sequence[str]) -> None:
    """Raise a ``UserError`` unless all overrides may be given for a classifier of others, and name a dataset."""
    keys, parsed = ("backbone.mean", "backbone.std", "task.test_every"), parse(overrides)
    for override in parsed:
        if override.place not in OF_FOREIGN and override.key not in keys:
            known = nearest(override.key, (*OF_FOREIGN, *keys))
            raise UserError(
                f"{override.text}: this cannot be chosen for model=",
                f"Did you mean {known}?" if known else f"What may change: {', '.join((*OF_FOREIGN, *keys))}",
            )
        if override.deletes or override.sweeps:
            raise UserError(f"{override.text}: give one value to each key", "For example corruption=cifar10_c")
    if not any(override.key == "dataset" for override in parsed):
        raise UserError(
            "dataset= is missing", "For example dataset=cifar10, or dataset=image_folder dataset.folder=..."
        )


def foreign_config(foreign: "ForeignClassifier", overrides: Sequence[str]) -> Config:
    """The config of a test of a classifier of others: size, crop and standardisation are its own unless given.

    Raises:
        UserError: an override is wrong, or the standardisation is not known.
    """
    parsed = parse(overrides)
    own = {o.key.removeprefix("backbone."): o.value for o in parsed if o.place == "backbone"}
    words = [o.text for o in parsed if o.place != "backbone"]
    raw = to_plain(compose(["task=classification", "augmentation=none", "corruption=none", *words]))
    raw["backbone"] = {**foreign.backbone, **own}
    for name in ("mean", "std"):
        if raw["backbone"][name] is None:
            raise UserError(
                f"backbone.{name}= is missing: {foreign.reference} does not say how it standardises images",
                "backbone.mean=[0,0,0] backbone.std=[1,1,1] is for networks of images in [0, 1]. A file with its name "
                "in RobustBench, such as Standard.pt, needs neither.",
            )
        raw["backbone"][name] = [float(value) for value in raw["backbone"][name]]
    if raw["dataset"]["_target_"].endswith(".ImageFolder"):
        given = {override.key for override in parsed}
        for key, value in (("size", foreign.size), ("crop", foreign.crop)):
            if value is not None and f"dataset.{key}" not in given:
                raw["dataset"][key] = value
    return checked(raw)


def checkpoint_config(trained: Mapping[str, Any], overrides: Sequence[str]) -> Config:
    """The config of a checkpoint with ``overrides`` applied.

    Raises:
        UserError: an override is wrong, the checkpoint's label and config name different tasks, or it names an import
            path outside Sextant, which would run code chosen by the file. ``trust=true`` allows this.
    """
    trust = "trust=true" in overrides
    merged = merge(trained["config"], [override for override in overrides if override != "trust=true"])
    return own_config({**trained, "config": merged}, trust=trust)


def merge(trained: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Merge overrides into the config of a checkpoint; paths and tracking are those of this machine.

    Raises:
        UserError: an override cannot be parsed, or would change what the weights were trained with.
    """
    parsed, known_groups = parse(overrides), groups()
    settings = [f"task.{key}" for key in chapter_of(str(trained.get("task", {}).get("name"))).test_settings]
    below = tuple(f"{key}." for key in settings)
    for override in parsed:
        group = override.place
        if group not in FREE and override.key not in settings and not override.key.startswith(below):
            known = nearest(group, FREE) if group not in trained and group not in known_groups else None
            raise UserError(
                f"{override.text}: "
                + ("unknown key" if known else "this belongs to the trained weights and cannot change"),
                f"Did you mean {known}?" if known else f"What may change: {', '.join([*FREE, *settings])}",
            )
    if any(override.deletes or override.sweeps for override in parsed):
        raise UserError(f"{' '.join(overrides)}: give one value to each key", "For example corruption=gaussian")
    chosen = {o.place for o in parsed if o.key in known_groups} | {"paths", "tracking"}
    composed = to_plain(compose([override.text for override in parsed if override.place in chosen]))
    merged = from_where_it_ran(trained) | {group: composed[group] for group in chosen}
    merged["reuse"] = "exact"
    for override in parsed:
        if override.place not in chosen:
            _set(merged, override.key, override.value, override.text, later=_later(trained, override.key))
    return merged


def _later(trained: Mapping[str, Any], key: str) -> bool:
    """Whether a key was added to its config node later, so that configs of earlier runs lack it."""
    *parents, last = key.split(".")
    node: Any = validate(trained)
    for part in parents:
        node = getattr(node, part, None)
    return last in getattr(node, "later", ())


def _set(config: dict[str, Any], key: str, value: Any, text: str, *, later: bool) -> None:
    node: Any = config
    *parents, last = key.split(".")
    for part in parents:
        if not isinstance(node, dict) or part not in node:
            raise UserError(f"{text}: unknown key", f"Keys there: {', '.join(node) if isinstance(node, dict) else ''}")
        node[part] = dict(node[part]) if isinstance(node[part], dict) else node[part]
        node = node[part]
    if not isinstance(node, dict) or (last not in node and not later):
        near = nearest(last, node)
        prefix = ".".join([*parents, ""])
        raise UserError(f"{text}: unknown key", f"Did you mean {prefix}{near}={value}?" if near else "")
    node[last] = value


def _outputs(overrides: Sequence[str]) -> Path:
    given = parse([each for each in overrides if each.startswith("paths.outputs=")])
    return Path(given[-1].option).expanduser().absolute() if given else default_outputs()
