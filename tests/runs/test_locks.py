import multiprocessing
import os
import signal

import pytest

from sextant.errors import UserError
from sextant.runs.locks import run_lock


def hold(folder, ready):
    with run_lock(folder, "run", wait=False):
        ready.set()
        signal.pause()


def test_a_second_process_is_told_who_holds_the_lock_and_a_killed_one_frees_it(tmp_path):
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    other = context.Process(target=hold, args=(tmp_path, ready))
    other.start()
    assert ready.wait(60)
    with pytest.raises(UserError, match=f"process {other.pid} on"), run_lock(tmp_path, "run", wait=False):
        pass
    os.kill(other.pid, signal.SIGKILL)
    other.join()
    with run_lock(tmp_path, "run", wait=False):
        pass


def test_other_runs_are_not_in_the_way(tmp_path):
    with run_lock(tmp_path, "one", wait=False), run_lock(tmp_path, "two", wait=False):
        pass
