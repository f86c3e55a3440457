"""Suggested next commands after a run, built from the user's overrides."""

from collections.abc import Sequence
from typing import Any

from sextant.composing.compose import composing_many
from sextant.composing.config_files import sweep_command
from sextant.composing.overrides import parse
from sextant.config import Config
from sextant.errors import UserError, command
from sextant.kit.chapter import Chapter
from sextant.lifecycle.sweep_plan import cell_config, read_design
from sextant.registry import chapter_of
from sextant.runs.directory import RunDirectory
from sextant.runs.outputs_folder import other_than_default

#: groups of a run's config that determine where results go, for commands that also write results
WHERE = ("paths", "tracking")
SEEDS = "seed=0,1,2"
#: for runs of several processes, which a sweep cannot start within its own
APART = ("launcher=joblib", "launcher.workers=1")


def next_commands(config: Config, directory: RunDirectory, name: str, overrides: Sequence[str]) -> dict[str, str]:
    """Commands that test, apply and vary a run, and show it in MLflow.

    Args:
        config: config of the run.
        directory: its directory.
        name: how commands refer to the run.
        overrides: what the user typed to train it.

    Returns:
        The commands by what they do.
    """
    chapter = chapter_of(config.task.name)
    trust = ["trust=true"] if config.custom_parts() else []
    where = [each.text for each in parse(overrides) if each.place in WHERE and not each.deletes]
    tracking = config.tracking
    server = ["tracking=server", f"tracking.uri={tracking.uri}"] if tracking.kind == "server" else []
    outputs = other_than_default(directory.path.parents[2])
    sweep, given = _sweep(chapter, overrides), chapter.prediction_example(config)
    return {
        "evaluate": command("evaluate", f"run={name}", *chapter.evaluation_words(config), *where, *trust),
        **({"predict": command("predict", f"run={name}", *given, "output=<folder>", *trust)} if given else {}),
        **({} if sweep is None else {"sweep": sweep}),
        "dashboard": command("dashboard", *server, outputs=outputs),
    }


def _sweep(chapter: Chapter[Any], typed: Sequence[str]) -> str | None:
    """A sweep of the run over three seeds and a second option; over seeds alone if the option is incompatible."""
    group, options = chapter.sweep_example
    parsed = [each for each in parse(typed) if each.key != "seed"]
    own = next((each.option for each in parsed if each.key == group and each.option not in ("", *options)), None)
    compared = options if own is None else (options[0], own)
    kept = [each.text for each in parsed]
    varied = [each.text for each in parsed if each.key != group]
    with composing_many():
        for words in ([*varied, SEEDS, f"{group}={','.join(compared)}"], [*kept, SEEDS], [*kept, *APART, SEEDS]):
            try:
                design = read_design(words)
                for arm in design.arms:
                    cell_config(design, {}, arm)
            except UserError:
                continue
            return sweep_command(words)
    return None
