"""Launchers, which run cells in this process, in several processes, or on a SLURM or Ray cluster."""

from importlib.util import find_spec
from pathlib import Path

from sextant.config import Config
from sextant.config.schema.launchers import JoblibLauncher, RayLauncher, SlurmLauncher
from sextant.errors import UserError, command, how_to_install
from sextant.lifecycle.launchers.cells import Cells, CellTask, Outcomes, run_here
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.runs.outputs_folder import other_than_default

__all__ = ["CellTask", "launch", "require_launcher", "require_store"]


def launch(
    cells: Cells,
    config: Config,
    folder: Path,
    reporter: RunReporter = SILENT_RUN,
    runs: RunReporter = SILENT_RUN,
) -> Outcomes:
    """Run cells with the launcher of a config, and return once they have ended.

    Cells that an earlier call with the same ``folder`` left in the queue of a cluster are not submitted again.

    Args:
        cells: cells to run.
        config: config that names the launcher.
        folder: the sweep's folder, on a disk that all hosts share; the launcher records there what it submitted.
        reporter: listens to the launcher.
        runs: listens to the runs, in the processes that compute them.

    Returns:
        The outcome of each cell as :func:`~sextant.lifecycle.execute.execute_cell` returns it; None for a cell that was
        submitted and not waited for (``launcher.wait=false``).

    Raises:
        UserError: the launcher cannot be used; see :func:`require_launcher`.
    """
    launcher = config.launcher
    if isinstance(launcher, SlurmLauncher):
        from sextant.lifecycle.launchers.slurm import run_on_slurm

        return run_on_slurm(cells, launcher, folder, reporter, runs)
    if isinstance(launcher, RayLauncher):
        from sextant.lifecycle.launchers.ray_cluster import run_on_ray

        return run_on_ray(cells, launcher, runs)
    if isinstance(launcher, JoblibLauncher):
        from sextant.lifecycle.launchers.processes import run_in_processes

        return run_in_processes(cells, launcher.workers, runs)
    return [run_here(cell, runs) for cell in cells]


def require_launcher(config: Config) -> None:
    """Raise a ``UserError`` unless the launcher of a config is installed here and its runs can be tracked."""
    launcher = config.launcher
    if isinstance(launcher, SlurmLauncher):
        from sextant.lifecycle.launchers.slurm_queue import require_commands

        _require_package("slurm", "submitit")
        require_commands(launcher)
    if isinstance(launcher, RayLauncher):
        _require_package("ray", "ray")
    require_store(config)


def require_store(config: Config) -> None:
    """Raise a ``UserError`` if the runs of a sweep would write to an sqlite database from several hosts."""
    launcher = config.launcher
    here = isinstance(launcher, RayLauncher) and launcher.address is None
    if launcher.kind in ("slurm", "ray") and not here and config.tracking.kind == "sqlite":
        raise UserError(
            f"launcher={launcher.kind} tracking=sqlite: hosts cannot share an sqlite database",
            "Start an MLflow server on PostgreSQL (docker compose up, or the commands in docs/clusters.md) and add "
            "tracking=server tracking.uri=http://<host>:5000; or run with tracking=none, and fill a store afterwards: "
            + command("dashboard", outputs=other_than_default(Path(config.paths.outputs))),
        )


def _require_package(launcher: str, package: str) -> None:
    if find_spec(package) is None:
        raise UserError(f"launcher={launcher} needs {package}, which is not installed", how_to_install(launcher))
