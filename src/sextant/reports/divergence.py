"""Text about diverged runs: the rule, how they were trained, and what to try."""

from collections.abc import Iterable, Sequence
from typing import Any

from sextant.errors import command
from sextant.kit.measure import Measure
from sextant.reports.results import SweepResults, Training
from sextant.runs.sweep_directory import SweepPlan
from sextant.tables import counted

#: how much longer, in how much smaller batches, and at how much lower a rate is proposed
LONGER, SMALLER, LOWER = 4, 4, 10
SMALLEST_BATCH, LARGEST_RATE = 8, 0.1


def divergence(results: SweepResults) -> str:
    """The Markdown of a report about the diverged runs of a sweep; empty if none diverged."""
    diverged = [cell for cell in results.cells if cell.outcome == "diverged"]
    if not diverged:
        return ""
    measure = next((cell.measure for cell in diverged if cell.values), results.measure)
    compared = {key for cell in results.cells for key in cell.cell.factors}
    compared |= {text.split("=")[0] for arm in _arms(results.plan) for text in arm.get("overrides", [])}
    ended = sum(cell.outcome in ("finished", "diverged") for cell in results.cells)
    learnt = ended - len(diverged)
    which = "None of the runs learnt" if not learnt else f"{len(diverged)} of {ended} runs did not learn"
    trainings = [cell.training for cell in sorted(diverged, key=lambda cell: cell.cell.run) if cell.training]
    words = ["train", "-m", *results.plan.own_words]
    missing = "" if learnt else " There is nothing to compare: means and contrasts are over runs that learnt."
    return f"**{which}.**{missing} {what_to_do(measure, trainings, words, compared)}"


def what_to_do(measure: Measure, trainings: Sequence[Training], words: Sequence[str], fixed: Iterable[str] = ()) -> str:
    """The rule by which runs diverged, how they were trained, and a command that may help.

    Args:
        measure: measure of the runs, which has the rule.
        trainings: how the diverged runs were trained; the text describes the first.
        words: the command that started them, without ``sextant``.
        fixed: keys that the command must not set, since its runs differ in them.
    """
    by_nan = bool(trainings) and all(training.stopped for training in trainings)
    whose = "Their" if len(trainings) > 1 else "Its"
    became = f"{whose} training loss became infinite or not a number."
    text = became if by_nan else f"A run has diverged if {measure.diverged}."
    if not trainings:  # cells that were stored without them
        return text
    first = trainings[0]
    rate, batch = first.rate, first.batch_size
    if measure.trained_by and first.epochs is not None and first.steps is not None and rate is not None:
        steps = f"{counted(first.epochs, 'epoch')}, {first.steps} step{'s' * (first.steps != 1)}"
        text += f" {'They' if len(trainings) > 1 else 'It'} trained for {steps}, at a learning rate of {rate:g}."
    changes: dict[str, Any] = {}
    if by_nan:
        text += " Most often the learning rate is too high, or the data hold extreme values."
        changes = {} if rate is None else {"optimizer.lr": f"{min(rate / LOWER, LARGEST_RATE):g}"}
    elif measure.trained_by:
        text += " Most often that is too short, in batches that are too large, or at a wrong rate."
        changes = {} if first.max_epochs is None else {"trainer.max_epochs": LONGER * first.max_epochs}
        if "trainer.batch_size" in measure.trained_by and batch is not None and batch > SMALLEST_BATCH:
            changes["trainer.batch_size"] = max(SMALLEST_BATCH, batch // SMALLER)
    else:
        text += f" {measure.remedy}"
    changes = {key: value for key, value in changes.items() if key not in set(fixed)}
    if not changes:
        return text
    kept = [word for word in words if word.partition("=")[0] not in changes]
    return f"{text} Try `{command(*kept, *(f'{key}={value}' for key, value in changes.items()))}`"


def _arms(plan: SweepPlan) -> list[dict[str, Any]]:
    return list((plan.definition.get("arms") or {}).values())
