"""Hydra's door to Sextant's sweeps; everything else is in ``sextant.cli.sweep``."""

from collections.abc import Sequence
from typing import Any

from hydra.core.plugins import Plugins
from hydra.plugins.launcher import Launcher
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig


class SextantSweeper(Sweeper):
    """Runs what is missing of factors x arms x seeds with whichever launcher was chosen."""

    def __init__(self) -> None:
        self.launcher: Launcher | None = None

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Called by Hydra once the config of the controller is composed."""
        self.launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> Any:
        """Called by Hydra with the overrides of the command line."""
        from sextant.cli.sweep import run_sweep

        launcher = self.launcher
        assert launcher is not None

        def launch(cells: Sequence[Sequence[str]]) -> list[Any]:
            return [job.return_value for job in launcher.launch([list(cell) for cell in cells], initial_job_idx=0)]

        return run_sweep(arguments, launch)
