"""The report of a search: its trials, the importance of its keys, and the selection bias of its winner."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sextant.evaluation import mean_interval
from sextant.figures.searches import TrialPoint, importance_bars, search_history
from sextant.reports.metric import seeds_interval
from sextant.reports.results import SweepResults
from sextant.reports.search_results import SearchResults, search_results
from sextant.reports.section import head, write_files
from sextant.tables import TextTable, decimals, interval, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_search_report(results: SweepResults) -> list[Path]:
    """Write ``report/`` into the folder of a search.

    Returns:
        The files: ``report.md``, ``trials.csv``, ``winner.csv``, ``importances.csv``, and the figures of the history
        and, where there are any, of the importances.

    Raises:
        UserError: as :func:`~sextant.reports.search_results.search_results`.
    """
    found, folder = search_results(results), results.directory / "report"
    folder.mkdir(parents=True, exist_ok=True)
    trials, winner, importances = trials_table(found), winner_table(found), importances_table(found)
    texts = {
        "report.md": _markdown(results, found, trials, winner, importances),
        "trials.csv": trials.csv(),
        "winner.csv": winner.csv(),
        "importances.csv": importances.csv(),
    }
    return write_files(folder, texts, search_figures(found))


def search_figures(found: SearchResults) -> "list[tuple[str, Figure]]":
    """The history of the trials and, where there are any, the importances, each with its name."""
    points = [TrialPoint(t.number, t.mean, t.values, len(t.values) == len(found.seeds)) for t in found.trials]
    made = [("history", search_history(points, str(found.search["metric"]), maximize=found.maximize))]
    return [*made, *([("importances", importance_bars(found.importances))] if found.importances else [])]


def trials_table(found: SearchResults) -> TextTable:
    """One row per trial: its values, its number of seeds, and how it ended."""
    digits = _digits(found)
    rows = [
        [
            str(trial.number),
            *trial.setting.values(),
            number(trial.mean, digits),
            interval(*seeds_interval(str(found.search["metric"]), np.array(trial.values)), digits),
            str(len(trial.values)),
            f"{trial.state}: {trial.why}" if trial.why else trial.state,
        ]
        for trial in found.trials
    ]
    keys = list(found.search["space"])
    return TextTable(["trial", *keys, str(found.search["metric"]), "95 % over seeds", "seeds", "outcome"], rows)


def winner_table(found: SearchResults) -> TextTable:
    """Validation and test metric of the winner, at the seeds at which it was chosen and at fresh ones."""
    columns = ["seeds", "runs", str(found.search["metric"]), "95 %", found.test_metric, "95 % of the test"]
    if found.winner is None:
        return TextTable(columns, [])
    chosen = (found.winner.values, found.winner.tested)
    fresh = tuple(zip(*found.fresh, strict=True)) or ((), ())
    digits = _digits(found)
    rows = []
    for name, (validation, test) in (("chosen at", chosen), ("fresh", fresh)):
        parts: list[str] = []
        for metric, of_runs in ((str(found.search["metric"]), validation), (found.test_metric, test)):
            values = np.array(of_runs)
            parts += [number(_mean(values), digits), interval(*seeds_interval(metric, values), digits)]
        rows.append([name, str(len(validation)), *parts])
    return TextTable(columns, rows)


def importances_table(found: SearchResults) -> TextTable:
    """The importance of each key, largest first."""
    return TextTable(["key", "importance"], [[key, number(share, 3)] for key, share in found.importances.items()])


def summary(found: SearchResults) -> str:
    """The outcomes of the trials, and the runs that racing saved, in words."""
    states = [trial.state for trial in found.trials]
    counts = ", ".join(f"{states.count(s)} {s}" for s in dict.fromkeys(states))
    sound = [trial for trial in found.trials if trial.values]
    full = len(sound) * len(found.seeds)
    text = f"{len(found.trials)} of {found.search['n_trials']} trials: {counts}."
    if sound and len(found.seeds) > 1:
        text += f" They took {found.runs} runs; all seeds for each would have been {full}."
    return text


def _markdown(
    results: SweepResults, found: SearchResults, trials: TextTable, winner: TextTable, importances: TextTable
) -> str:
    search = found.search
    space = TextTable(["key", "searched"], [[key, text] for key, text in search["space"].items()])
    parts = [
        *head(results),
        f"A search by {search['method']} for the {found.extreme} of `{search['metric']}`, on "
        f"the validation split alone, at the seeds {', '.join(map(str, found.seeds))}.\n",
        space.markdown(),
        f"{summary(found)}\n",
        "## Winner\n",
        *_winner_text(found, winner),
        "## Trials\n",
        _legend(len(found.seeds)),
        trials.markdown(),
        "![history](history.png)\n",
    ]
    if found.importances:
        parts += [
            "## Importances\n",
            "The share of the variance of the metric over the space that each key accounts for by itself or together "
            "with others (functional ANOVA of a random forest fitted to the means of the trials). They are rough if "
            "there are few trials, or if these crowd around the best.\n",
            importances.markdown(),
            "![importances](importances.png)\n",
        ]
    return "\n".join(part for part in parts if part)


def _winner_text(found: SearchResults, table: TextTable) -> list[str]:
    winner = found.winner
    if winner is None:
        return ["No trial has a result at every seed it was run at, so there is none.\n"]
    words = " ".join(f"{key}={value}" for key, value in winner.setting.items())
    tested = "It has not been tested yet."
    if found.winners_tested == 1:
        tested = "It was tested once, at seeds that the search did not use."
    elif found.winners_tested:
        tested = (
            f"**{found.winners_tested} trials have been tested** in turn, as the search went on: the test split "
            "has been used before this test."
        )
    missing = f" {found.fresh_missing} fresh seeds have no result." if found.fresh_missing else ""
    return [f"Trial {winner.number}: `{words}`. {tested}{missing}\n", table.markdown(), optimism(found), _ties(found)]


def optimism(found: SearchResults) -> str:
    """The bias of the winner's metric: how much better it is on the seeds and split used to choose it."""
    assert found.winner is not None
    if not found.fresh:
        return ""
    digits, sign = _digits(found) + 1, 1 if found.maximize else -1
    fresh, tests = (np.array(values) for values in zip(*found.fresh, strict=True))
    by_seeds = sign * (found.winner.mean - fresh.mean()) + 0.0  # turns -0.0 into 0.0
    text = (
        f"At the seeds used to choose it, the winner scored better by {number(by_seeds, digits, sign=True)} than at "
        "fresh ones, on the same validation split."
    )
    metric = str(found.search["metric"])
    if not found.test_metric.startswith(metric.replace("val/", "test/", 1)):
        return f"{text} {found.test_metric} measures something else than {metric}, so the two are not compared.\n"
    by_split = sign * (fresh - tests)
    spread = interval(*mean_interval(by_split), digits, sign=True)
    return (
        f"{text} At the fresh seeds, it scored better by {number(_mean(by_split), digits, sign=True)} {spread} on the "
        "validation split than on the test split.\n"
    )


def _ties(found: SearchResults) -> str:
    """The trials that cannot be distinguished from the winner."""
    winner = found.winner
    assert winner is not None
    close = []
    for trial in found.trials:
        if trial.number != winner.number and len(trial.values) == len(winner.values) > 1:
            low, high = mean_interval(np.array(winner.values) - np.array(trial.values))
            close += [trial.number] * (low <= 0 <= high)
    if not close:
        return ""
    return f"Indistinguishable from it at these seeds (95 %, paired): trial{'s' * (len(close) > 1)} " + (
        f"{', '.join(map(str, close))}.\n"
    )


def _legend(seeds: int) -> str:
    if seeds < 2:
        return ""
    return (
        "*raced out* could no longer beat the best, by a one-sided paired interval over seeds, and got no further "
        "seed; its mean is over fewer seeds than that of others. A trial that *diverged* or *failed* at any seed has "
        "no result.\n"
    )


def _digits(found: SearchResults) -> int:
    """The number of decimals for the metric."""
    values = [value for trial in found.trials for value in trial.values]
    return min(6, decimals(max(map(abs, values), default=1.0), 4))


def _mean(values: Sequence[float] | np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else math.nan
