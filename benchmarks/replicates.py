"""What a claim rests on, over replicates: the mean of each figure with Student's interval, and the tables stored."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy import stats

from sextant.tables import TextTable

RECORDED = ("name", "seeds", "replicate", "mean", "low", "high", "against", "source")
Row = list[str]


def now() -> str:
    """The time, for the column of the first or last run."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def over_worlds(name: str, values: Sequence[float], source: str, decimals: int = 2, against: int = 0) -> Row:
    """A row of ``recorded.csv``: the mean over worlds with its 95 % Student t interval, and what it is set against.

    Example:
        >>> over_worlds("gain", [1.0, 2.0, 3.0], "replicates.csv: gain")
        ['gain', '3', 'worlds', '2.00', '-0.48', '4.48', '0', 'replicates.csv: gain']
    """
    array = np.array(values, float)
    half = stats.t.ppf(0.975, len(array) - 1) * array.std(ddof=1) / np.sqrt(len(array))
    ends = (f"{value:.{decimals}f}" for value in (array.mean(), array.mean() - half, array.mean() + half))
    return [name, str(len(array)), "worlds", *ends, str(against), source]


def store(output: Path, replicates: TextTable, recorded: Sequence[Row], first: str, last: str) -> None:
    """Write ``replicates.csv``, ``recorded.csv`` and ``dates.csv``, of which ``sextant claims`` makes its verdict."""
    output.mkdir(parents=True, exist_ok=True)
    tables: Mapping[str, TextTable] = {
        "replicates": replicates,
        "recorded": TextTable(list(RECORDED), list(recorded)),
        "dates": TextTable(["first_run", "last_run"], [[first, last]]),
    }
    for name, table in tables.items():
        (output / f"{name}.csv").write_text(table.csv(), encoding="utf-8")
    print(tables["recorded"].markdown())
