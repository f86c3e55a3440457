"""What the Makefile gives its commands."""

import subprocess
from pathlib import Path


def test_processes_keep_their_bytecode(monkeypatch):
    """Where a container forbids it, each process that a test starts would compile torch and all else again."""
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    command = ["make", "--silent", "--eval=what-is-given: ; @env", "what-is-given"]
    given = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=True).stdout
    assert "PATH=" in given
    assert "PYTHONDONTWRITEBYTECODE" not in given
