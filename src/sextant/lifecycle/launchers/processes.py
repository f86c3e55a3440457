"""Cells in several processes on this machine."""

import multiprocessing
import os
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from typing import Any

from sextant.lifecycle.launchers.cells import Cells, CellTask, Outcomes, failed, finished, run_words
from sextant.lifecycle.run_reporter import RunReporter

POLL_S = 1.0
IDLE_S = 300  # an idle process ends after this time
ATTEMPTS = 2  # a run whose process died is retried once: other programs may have used up the memory
CONTROLLER = "SEXTANT_CONTROLLER"

#: idle processes by the size of their pool; they are kept because a search calls repeatedly
_idle: dict[int, list[Any]] = {}


def run_in_processes(cells: Cells, workers: int | None, runs: RunReporter) -> Outcomes:
    """Run cells in this many processes at a time; None uses one per core.

    A process that dies, for example when memory runs out, ends only its own run.
    """
    from joblib import cpu_count

    os.environ[CONTROLLER] = str(os.getpid())  # the workers inherit it
    pool = _Pool(min(workers or cpu_count(), len(cells)), runs)
    with ThreadPoolExecutor(pool.size) as threads:
        waiting = [threads.submit(pool.run, cell) for cell in cells]
        try:
            return [each.result() for each in waiting]
        except BaseException:
            for each in waiting:
                each.cancel()
            pool.kill()
            raise


def end_idle() -> None:
    """End the idle processes."""
    for executors in _idle.values():
        while executors:
            executors.pop().shutdown(wait=True)


class _Pool:
    """Executors of one process each, so that the run of a dead process can be identified."""

    def __init__(self, size: int, runs: RunReporter):
        self.size, self.runs = size, runs
        self.idle = _idle.setdefault(size, [])
        self.busy: list[Any] = []
        self.killed = False

    def run(self, cell: CellTask) -> dict[str, Any]:
        """Run a cell in an idle process."""
        for _ in range(ATTEMPTS):
            try:
                executor = self.idle.pop()  # another thread may have taken the last one
            except IndexError:
                executor = self._executor()
            self.busy.append(executor)
            try:
                if self.killed:  # submitted too late to be among those killed
                    raise KeyboardInterrupt
                outcome: dict[str, Any] = executor.submit(_in_worker, cell.words, self.runs).result()
            except BrokenProcessPool as error:
                if self.killed:
                    raise
                codes = str(error).rpartition("{")[2].partition("}")[0]
            else:
                self.idle.append(executor)
                return outcome
            finally:
                self.busy.remove(executor)
        return finished(cell.run) or failed(
            cell.run, f"its process died {ATTEMPTS} times ({codes}): is there enough memory?"
        )

    def kill(self) -> None:
        self.killed = True
        for executor in list(self.busy):
            executor.shutdown(kill_workers=True)

    def _executor(self) -> Any:
        from joblib import cpu_count
        from joblib.externals.loky import ProcessPoolExecutor
        from joblib.parallel import LokyBackend

        threads = str(max(cpu_count() // self.size, 1))
        env = {name: os.environ.get(name, threads) for name in LokyBackend.MAX_NUM_THREADS_VARS}
        return ProcessPoolExecutor(1, timeout=IDLE_S, env=env)


def _in_worker(words: Sequence[str], runs: RunReporter) -> dict[str, Any]:
    _settle()
    return run_words(words, runs)


@cache
def _settle() -> None:
    """In a joblib worker, let runs start processes, and end this one once the controller has died; elsewhere nothing.

    loky makes itself the way to start processes, and cannot start those that load a run's data.

    Workers would otherwise finish their run and then wait forever for another. Repeating the sweep resumes a run that
    is ended this way. The watch starts with a worker's first run; a controller that dies earlier is not noticed.
    """
    if not multiprocessing.current_process().name.startswith("LokyProcess"):
        return
    multiprocessing.set_start_method(None, force=True)
    controller = int(os.environ[CONTROLLER])

    def watch() -> None:
        while os.getppid() == controller:
            time.sleep(POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
