"""The guard of MLflow's server."""

import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from urllib.error import HTTPError
from urllib.request import urlopen

import psutil
import pytest
from support import heeds_signals

from sextant.cli.dashboard import PAGE

STARTER = """
import sys
from sextant.tracking.server import guarded
with guarded(sys.argv[1:]) as guard:
    guard.wait()
"""
#: A process, one in a session of its own, and one that heeds no request to end.
FAMILY = "setsid sleep 1000 & sh -c 'trap \"\" TERM HUP; while :; do sleep 1000; done' & wait"


def descendants_of(process, number, still=lambda: True):
    """Wait until a process has so many descendants."""
    deadline = time.monotonic() + 120
    while len(found := psutil.Process(process.pid).children(recursive=True)) < number or not still():
        assert time.monotonic() < deadline, found
        assert process.poll() is None
        time.sleep(0.05)
    return found


SIGNALS = (signal.SIGTERM, signal.SIGKILL, signal.SIGHUP, signal.SIGINT)


@pytest.fixture(scope="module")
def families():
    """What starters had started when each was sent its signal, by signal; they are waited for together."""
    command = [sys.executable, "-c", STARTER, "sh", "-c", FAMILY]
    starters = [subprocess.Popen(command, preexec_fn=heeds_signals, stderr=subprocess.DEVNULL) for _ in SIGNALS]
    found = [descendants_of(starter, 5) for starter in starters]  # guard, shell, sleep, inner shell, its sleep
    for starter, sent in zip(starters, SIGNALS, strict=True):
        starter.send_signal(sent)
    for starter in starters:
        starter.wait(60)
    return dict(zip(SIGNALS, found, strict=True))


@pytest.mark.parametrize("sent", SIGNALS)
def test_all_that_was_started_ends_with_its_starter(families, sent):
    assert len(families[sent]) == 5
    assert psutil.wait_procs(families[sent], timeout=60)[1] == []


def test_a_server_that_ends_by_itself_is_told():
    command = [sys.executable, "-c", STARTER + "print(guard.returncode)", "sh", "-c", "exit 3"]
    assert subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=60).stdout == "3\n"


@pytest.mark.slow
def test_a_dashboard_says_its_address_alone_and_if_it_is_killed_it_leaves_no_server(tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    code = "import sys; from sextant.cli import run; run('dashboard', sys.argv[1:])"
    command = [sys.executable, "-c", code, f"outputs={tmp_path}", f"port={port}"]
    with (tmp_path / "said").open("wb") as said:
        dashboard = subprocess.Popen(command, stdout=said, stderr=said)

    def listening():
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    family = descendants_of(dashboard, 2, listening)
    with urlopen(f"http://127.0.0.1:{port}/", timeout=60) as answer:
        assert b'"mlflow.workflowType_v1": "machine_learning"' in answer.read()
    for page in ("ajax-api/2.0/mlflow/experiments/search?max_results=1", "none"):
        with suppress(HTTPError), urlopen(f"http://127.0.0.1:{port}/{page}", timeout=60) as answer:
            answer.read()
    dashboard.kill()
    dashboard.wait()
    assert psutil.wait_procs(family, timeout=60)[1] == []
    assert not listening()
    _, address = (tmp_path / "said").read_text().splitlines()
    assert address == f"http://127.0.0.1:{port}/{PAGE}  (Ctrl-C ends it)"
