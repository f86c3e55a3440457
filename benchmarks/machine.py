"""The machine of the measurements, and runs with a time limit."""

import os
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from sextant.runs.provenance import provenance


def describe_machine() -> str:
    found = provenance()
    hardware, versions = found["hardware"], found["versions"]
    return (
        f"{hardware['processor']}, {hardware['cores']} cores, {hardware['memory_gib']} GiB; "
        f"python {versions['python']}, torch {versions['torch']}, pytorch-lightning {versions['pytorch-lightning']}"
    )


#: seconds that an interrupted command has to save its state
GRACE_S = 30


def run_for(seconds: float, words: Sequence[str], folder: Path, **environment: str) -> int:
    """Run a command for at most ``seconds``; its exit status, or 124 if time was up.

    It is interrupted as by Ctrl-C, so that it can save its state. Half a minute later it is killed, with all processes
    that it started.
    """
    process = subprocess.Popen(words, cwd=folder, env={**os.environ, **environment}, start_new_session=True)
    try:
        return process.wait(seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(GRACE_S)
        return 124
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
