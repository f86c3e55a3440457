import os
import signal
import subprocess
import sys

import pytest

from sextant.errors import UserError
from sextant.runs.locks import run_lock

#: a process of its own: it holds the lock, says so, and waits to be killed
HOLD = """
import signal, sys
from pathlib import Path
from sextant.runs.locks import run_lock
with run_lock(Path(sys.argv[1]), "run", wait=False):
    print("held", flush=True)
    signal.pause()
"""


def test_a_second_process_is_told_who_holds_the_lock_and_a_killed_one_frees_it(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(UserError, match=f"process {other.pid} on"), run_lock(tmp_path, "run", wait=False):
            pass
        os.kill(other.pid, signal.SIGKILL)
    with run_lock(tmp_path, "run", wait=False):
        pass


def test_other_runs_are_not_in_the_way(tmp_path):
    with run_lock(tmp_path, "one", wait=False), run_lock(tmp_path, "two", wait=False):
        pass
