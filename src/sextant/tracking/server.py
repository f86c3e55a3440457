"""MLflow's server, which ends when the process that started it ends, however that happens.

A guard process runs between the two; signals to the terminal or the process group do not reach it. It reads from a
pipe of which only the starter holds the other end. The system closes the pipe when the starter ends, and the guard then
ends everything that it started. A signal at the parent's death (``PR_SET_PDEATHSIG``) would reach only the server and
none of its workers.
"""

import ctypes
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

import psutil

from sextant.errors import UserError

PR_SET_CHILD_SUBREAPER = 36
PATIENCE_S = 5.0
#: how lines begin that MLflow's server writes to standard error whenever it starts
EXPECTED = b"[MLflow] Security middleware enabled"
#: Turns off jobs for language models, which take three more processes and are not needed.
WITHOUT_JOBS = {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}


def server_command(host: str, port: int, database: str, artifacts: str) -> list[str]:
    """The command that serves an MLflow database and a folder of artifacts, both given as addresses."""
    return [
        *(sys.executable, "-m", "sextant.tracking.training_view", "server", "--app-name", "sextant"),
        *("--host", host, "--port", str(port), "--workers", "1"),
        *("--backend-store-uri", database, "--artifacts-destination", artifacts),
        *("--uvicorn-opts", "--log-level error --no-access-log"),
    ]


def free_port(host: str, first: int) -> int:
    """The first free port from ``first`` on.

    Raises:
        UserError: a hundred ports in a row are taken.
    """
    for port in range(first, min(first + 100, 65536)):
        with socket.socket() as probe:
            if probe.connect_ex((host, port)) != 0:
                return port
    raise UserError(f"no free port from {first} on")


@contextmanager
def guarded(command: Sequence[str]) -> Iterator["subprocess.Popen[bytes]"]:
    """Run a command while the block runs; the command and its children end when the block or this process ends.

    Its standard output is dropped: MLflow's server writes only its settings there, and errors to standard error.

    Yields:
        The guard process, which ends with the command and has its exit status.
    """
    guard = subprocess.Popen(
        [sys.executable, "-m", __name__, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        env={**WITHOUT_JOBS, "PYTHONWARNINGS": "ignore", **os.environ},
    )
    assert guard.stdin is not None
    try:
        yield guard
    finally:
        guard.stdin.close()
        guard.wait()


def main(command: Sequence[str]) -> int:
    """Guard a command until it ends or standard input is closed."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)  # adopts orphaned descendants, so that they are found below
    child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE)

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 1):
            pass
        _end_all()

    def pass_on() -> None:
        for line in child.stderr or ():
            if not line.startswith(EXPECTED):
                with suppress(OSError):  # reading continues, so that the server never blocks
                    os.write(sys.stderr.fileno(), line)

    passing = threading.Thread(target=pass_on, daemon=True)
    for thread in (threading.Thread(target=watch, daemon=True), passing):
        thread.start()
    status = child.wait()
    _end_all()
    passing.join(PATIENCE_S)
    return status


def _end_all() -> None:
    """Terminate every descendant of this process, and kill those that do not end."""
    while descendants := psutil.Process().children(recursive=True):
        for send in ("terminate", "kill"):
            for process in descendants:
                with suppress(psutil.NoSuchProcess):
                    getattr(process, send)()
            descendants = psutil.wait_procs(descendants, PATIENCE_S)[1]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
