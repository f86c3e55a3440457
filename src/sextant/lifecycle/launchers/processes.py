"""Several processes on this machine."""

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
IDLE_S = 300  # a process that waits for another run ends after so long
ATTEMPTS = 2  # a run whose process died is started again once: memory may have been short for others' sake
CONTROLLER = "SEXTANT_CONTROLLER"

#: processes without a run, by how many there are beside them; a search calls again and again
_idle: dict[int, list[Any]] = {}


def run_in_processes(cells: Cells, workers: int | None, runs: RunReporter) -> Outcomes:
    """Run cells in as many processes at a time, None for one on each core.

    A process that dies, as it does when memory runs out, ends no run but its own.
    """
    from joblib import cpu_count

    os.environ[CONTROLLER] = str(os.getpid())  # inherited by the workers
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
    """End the processes that wait for another run."""
    for executors in _idle.values():
        while executors:
            executors.pop().shutdown(wait=True)


class _Pool:
    """Executors of one process each, so that a dead process tells which run it had."""

    def __init__(self, size: int, runs: RunReporter):
        self.size, self.runs = size, runs
        self.idle = _idle.setdefault(size, [])
        self.busy: list[Any] = []
        self.killed = False

    def run(self, cell: CellTask) -> dict[str, Any]:
        """In a process that has nothing else to do."""
        for _ in range(ATTEMPTS):
            try:
                executor = self.idle.pop()  # another thread may take the last
            except IndexError:
                executor = self._executor()
            self.busy.append(executor)
            try:
                if self.killed:  # too late to be among those that are
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
