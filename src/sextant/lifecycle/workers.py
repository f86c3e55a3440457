"""The processes in which the cells of a sweep run."""

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from sextant.composing.compose import compose, to_plain
from sextant.lifecycle.execute import execute_cell

#: runs cells, each given by its overrides, and returns what ``execute_cell`` says of each
Launch = Callable[[Sequence[Sequence[str]]], list[Any]]
POLL_S = 1.0
CONTROLLER = "SEXTANT_CONTROLLER"


def in_process(workers: int = 1) -> Launch:
    """A launcher that runs cells one after another in this process, or, of several ``workers``, in others."""

    def launch(cells: Sequence[Sequence[str]]) -> list[dict[str, Any]]:
        configs = [to_plain(compose(cell)) for cell in cells]
        if workers == 1:
            return [execute_cell(raw) for raw in configs]
        from joblib import Parallel, delayed

        return list(Parallel(n_jobs=workers)(delayed(_in_worker)(raw) for raw in configs))

    return launch


def _in_worker(raw: dict[str, Any]) -> dict[str, Any]:
    from sextant.tracking.environment import quiet_libraries

    quiet_libraries()
    end_with_controller()
    return execute_cell(raw)


def announce_controller() -> None:
    """In the controller of a sweep: tell the workers that inherit this environment who starts them."""
    os.environ[CONTROLLER] = str(os.getpid())


@cache
def end_with_controller() -> None:
    """In a worker of the joblib launcher, end this process when the controller has died; elsewhere do nothing.

    Workers would otherwise finish their run and then wait for ever for another. A run that is ended so is resumed by
    the same sweep. Called at a worker's first run: one whose controller dies before has nothing of ours to end it.
    """
    if not multiprocessing.current_process().name.startswith("LokyProcess") or CONTROLLER not in os.environ:
        return
    controller = int(os.environ[CONTROLLER])

    def watch() -> None:
        while os.getppid() == controller:
            time.sleep(POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
