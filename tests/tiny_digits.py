"""Quick runs of recognition by COSFIRE filters on the digit scans."""

from pathlib import Path
from typing import Any

import numpy as np

from sextant.composing.compose import compose, to_plain
from sextant.lifecycle.execute import execute
from sextant.runs.directory import RunDirectory

#: ten seconds or so
QUICK = (
    "task=cosfire", "task.images=200", "task.filters_per_class=2", "task.test_every=4", "task.prices=[1,10]",
    "trainer.max_epochs=8", "trainer.batch_size=16", "optimizer=adam", "optimizer.lr=0.003", "schedule=constant",
    "trainer.progress=false", "tracking=none",
)  # fmt: skip
#: filters on the image, which need no network
PLAIN = (
    "bank=gabor", "strategy=circles", "~backbone", "trainer.max_epochs=1", "task.images=60",
    "task.filters_per_class=1", "task.test_every=8",
)  # fmt: skip
_finished: list[RunDirectory] = []


def digits_config(outputs: Path, *overrides: str) -> dict[str, Any]:
    """The plain config of a run; ``overrides`` take the place of what is usual."""
    given = {override.partition("=")[0] for override in overrides}
    usual = [each for each in QUICK if each.partition("=")[0] not in given]
    return to_plain(compose([*usual, f"paths.outputs={outputs}", f"paths.cache={outputs}", *overrides]))


def digits_run(outputs: Path, *overrides: str) -> RunDirectory:
    """The directory of a finished run."""
    return RunDirectory(execute(digits_config(outputs, *overrides)).directory)


def usual_run(tmp_path_factory) -> RunDirectory:
    """Made when it is first asked for; a fixture is not shared by modules that import it."""
    if not _finished:
        _finished.append(digits_run(tmp_path_factory.mktemp("digits")))
    return _finished[0]


def arrays(directory: RunDirectory) -> dict[str, np.ndarray]:
    """What a run keeps of its test."""
    with np.load(directory.arrays, allow_pickle=False) as found:
        return dict(found)
