"""Worker processes of a sweep."""

import multiprocessing
import os
import threading
import time
from functools import cache

POLL_S = 1.0
CONTROLLER = "SEXTANT_CONTROLLER"


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
