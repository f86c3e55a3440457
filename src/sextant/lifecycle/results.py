"""Results of the runs of a sweep: for reports, and as a table."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.lifecycle.sweep import SweepOutcome
from sextant.registry import chapter_of
from sextant.reporter import SILENT, Reporter
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.sweep_directory import find_sweep

if TYPE_CHECKING:
    from sextant.reports.results import CellResult, SweepResults

Reference = str | Path | SweepOutcome


def sweep_results(sweep: Reference, outputs: str | Path | None = None, reporter: Reporter = SILENT) -> "SweepResults":
    """Read the results of the runs of a sweep.

    Args:
        sweep: its name (the newest of that name), its directory, its MLflow parent run, the return value of
            :func:`sextant.sweep`, or folders of the cells of its blocks, separated by commas.
        outputs: output folder; by default the default one.
        reporter: receives messages about damaged plans that are skipped in the search for the newest.

    Raises:
        UserError: the sweep does not exist, its files are damaged, or no run is finished yet.
    """
    from sextant.reports.results import read_results
    from sextant.reports.stored_cells import is_stored, join_cells

    if isinstance(sweep, SweepOutcome):
        sweep = sweep.directory
    folder = default_outputs() if outputs is None else Path(outputs).expanduser().absolute()
    blocks = [Path(name).expanduser() for name in str(sweep).split(",")]
    if any(is_stored(block) for block in blocks):
        return join_cells(blocks, folder)
    directory = find_sweep(str(sweep), folder, reporter)
    return read_results(directory, directory.parents[1], lambda task: chapter_of(task).measured)


def load_results(sweep: Reference, outputs: str | Path | None = None) -> list[dict[str, Any]]:
    """Load the results of a sweep as a table with one row per run and condition, ready for pandas.

    A row has the ``sweep``, each factor by its key and as text, the ``arm``, ``pair`` and ``seed``, the ``status`` of
    the run (``finished``, ``diverged``, ``failed``, ``missing``), its directory ``run``, the ``condition``, and the
    ``value`` of a ``quantity`` under that condition in a ``unit``. A run without a test has one row, whose condition is
    None and whose value is nan.

    Args:
        sweep, outputs: as for :func:`sweep_results`.

    Raises:
        UserError: as :func:`sweep_results`.

    Example:
        >>> import pandas as pd  # doctest: +SKIP
        >>> table = pd.DataFrame(sextant.load_results("demo"))  # doctest: +SKIP
        >>> table.groupby(["arm", "condition"])["value"].mean()  # doctest: +SKIP
    """
    results = sweep_results(sweep, outputs)
    return [row for cell in results.cells for row in _rows(cell, results)]


def _rows(result: "CellResult", results: "SweepResults") -> list[dict[str, Any]]:
    cell, measure = result.cell, results.measure
    values: Mapping[str | None, float] = {name: result.value(name) for name in result.values} or {None: float("nan")}
    return [
        {
            "sweep": results.plan.name,
            **cell.factors,
            "arm": cell.arm,
            "pair": cell.pair,
            "seed": cell.seed,
            "status": result.outcome,
            "condition": condition,
            "value": value,
            "quantity": measure.quantity,
            "unit": measure.unit,
            "run": str(results.directory.parents[1] / cell.run),
        }
        for condition, value in values.items()
    ]


def report(sweep: Reference, outputs: str | Path | None = None, *, track: bool = True) -> list[Path]:
    """Write the report of a sweep into its directory, and log it on its parent run.

    Args:
        sweep, outputs: as for :func:`sweep_results`.
        track: whether to log the report on the parent run.

    Returns:
        The files that were written.

    Raises:
        UserError: as :func:`sweep_results`; or the parent run's store does not answer, after the report is written.
    """
    from sextant.reports.sweep_report import write_report

    results = sweep_results(sweep, outputs)
    files = write_report(results)
    if track and results.plan.mlflow_runs:
        from sextant.tracking.sweep_parent import log_report

        log_report(results.directory.parents[1], results.plan, results.directory / "report")
    return files
