"""Loggers of Lightning beside MLflow: TensorBoard, CSV and Weights & Biases, all in the run directory."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Literal

from sextant.errors import UserError, how_to_install
from sextant.runs.directory import RunDirectory

if TYPE_CHECKING:
    from pytorch_lightning.loggers import Logger

# else Weights & Biases sends its own errors, even offline; it reads this when it is imported, as timm does too
os.environ.setdefault("WANDB_ERROR_REPORTING", "false")

Also = Literal["tensorboard", "csv", "wandb"]
#: packages of which one is needed; CSV needs none
NEEDED: dict[str, tuple[str, ...]] = {"tensorboard": ("tensorboard", "tensorboardX"), "wandb": ("wandb",), "csv": ()}


def require_loggers(also: Sequence[Also]) -> None:
    """Raise a ``UserError`` if the package of a logger is not installed."""
    for name in also:
        if (needed := NEEDED[name]) and not any(map(find_spec, needed)):
            raise UserError(f"tracking.also=[{name}] needs {needed[0]}, which is not installed", how_to_install(name))


@contextmanager
def closing(loggers: "Sequence[Logger]") -> Iterator[None]:
    """End the runs of Weights & Biases, of which a process can have one at a time, whatever ends the block."""
    try:
        yield
    finally:
        if any(type(logger).__name__ == "WandbLogger" for logger in loggers):
            import_module("wandb").finish()


def further_loggers(also: Sequence[Also], directory: RunDirectory) -> "list[Logger]":
    """The loggers by these names, which write ``tensorboard/``, ``csv/`` and ``wandb/`` into a run directory.

    Weights & Biases is offline: ``wandb sync <run directory>/wandb/offline-run-*`` uploads it later.

    Raises:
        UserError: as :func:`require_loggers`.
    """
    require_loggers(also)
    found: list[Logger] = []
    for name in dict.fromkeys(also):
        if name == "csv":
            from sextant.tracking.logger import CSVLogger

            found.append(CSVLogger(directory.path / "csv" / "metrics.csv"))
        elif name == "tensorboard":
            from pytorch_lightning.loggers import TensorBoardLogger

            found.append(TensorBoardLogger(directory.path, "tensorboard", ""))
        else:
            from pytorch_lightning.loggers import WandbLogger

            task = directory.path.parent.name
            found.append(WandbLogger(directory.path.name, directory.path, offline=True, project=f"sextant-{task}"))
    return found
