"""Run directories of a classification sweep with a given number of wrong predictions under each condition."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sextant.atomic_files import write_json
from sextant.lifecycle.results import sweep_results
from sextant.reports.results import SweepResults
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan

IMAGES = 20
PROTOCOL = {"set": "cifar10_c", "title": "CIFAR-10-C", "mode": "faithful", "rounding": "8 bits", "seed": 0}


@dataclass(frozen=True)
class MadeUpRun:
    """One run: how many of its predictions are wrong, by condition, and what its ``metrics.json`` says."""

    wrong: Mapping[str, int]
    outcome: str = "finished"
    protocol: Mapping[str, object] | None = field(default_factory=lambda: PROTOCOL)
    cost: Mapping[str, object] | None = None
    seconds: float = 10.0
    setting: str = "net"


def predictions(wrong: Mapping[str, int], images: int = IMAGES) -> dict[str, np.ndarray]:
    """Arrays of a run; the first images are the wrong ones."""
    labels = np.arange(images) % 10
    arrays = {key: np.where(np.arange(images) < count, (labels + 1) % 10, labels) for key, count in wrong.items()}
    return {"labels": labels, **{key: array.astype(np.uint8) for key, array in arrays.items()}}


def made_up_sweep(folder: Path, arms: Mapping[str, list[MadeUpRun]], **definition: object) -> SweepResults:
    """The results of a sweep of ``arms``, run i of each being pair i."""
    cells = []
    for arm, runs in arms.items():
        for pair, run in enumerate(runs):
            directory = RunDirectory(folder / "runs" / "classification" / f"{run.setting}-{arm}-{pair}")
            path = directory.path.relative_to(folder).as_posix()
            cells.append(Cell({"model": run.setting}, arm, pair, pair, arm, path))
            directory.path.mkdir(parents=True)
            np.savez_compressed(directory.arrays, **predictions(run.wrong))
            found = {"outcome": run.outcome, "metrics": {}, "parameters": 1234, "timing": {"fit_s": run.seconds}}
            found |= {} if run.protocol is None else {"protocol": run.protocol}
            write_json(directory.metrics, found | ({} if run.cost is None else {"cost": run.cost}))
    return sweep_results(SweepPlan("made_up", definition, [], cells).write(folder))
