"""Several processes on this machine."""

import multiprocessing
import os
import threading
import time
from collections.abc import Sequence
from functools import cache
from typing import Any

from sextant.lifecycle.launchers.cells import Cells, Outcomes, run_words
from sextant.lifecycle.run_reporter import RunReporter

POLL_S = 1.0
CONTROLLER = "SEXTANT_CONTROLLER"


def run_in_processes(cells: Cells, workers: int | None, runs: RunReporter) -> Outcomes:
    """Run cells in as many processes at a time, None for one on each core."""
    from joblib import Parallel, delayed

    os.environ[CONTROLLER] = str(os.getpid())  # inherited by the workers
    return list(Parallel(n_jobs=workers or -1)(delayed(_in_worker)(cell.words, runs) for cell in cells))


def _in_worker(words: Sequence[str], runs: RunReporter) -> dict[str, Any]:
    _end_with_controller()
    return run_words(words, runs)


@cache
def _end_with_controller() -> None:
    """In a worker of joblib, end this process when the controller has died; elsewhere do nothing.

    Workers would otherwise finish their run and then wait for ever for another. A run that is ended so is resumed by
    the same sweep. Called at a worker's first run: one whose controller dies before has nothing of ours to end it.
    """
    if not multiprocessing.current_process().name.startswith("LokyProcess"):
        return
    controller = int(os.environ[CONTROLLER])

    def watch() -> None:
        while os.getppid() == controller:
            time.sleep(POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
