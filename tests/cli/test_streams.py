"""Standard streams that are closed, full or read by nobody: no traceback, and the status says what happened.

The boundaries: which of the two streams; closed before the start, a full disk, a reader that has gone; whether the
command succeeds, fails by a mistake, prints before anything is imported, or prints more than a pipe holds.
"""

import os
import sys
import traceback

import pytest

from sextant import cli
from sextant.console.console import console, errors
from sextant.errors import UserError

STATES = ("fine", "closed", "full", "gone")


def put(state, number, written):
    """Make a descriptor what it is at the start of a process in this state."""
    if state == "closed":
        os.close(number)
    else:
        path = "/dev/full" if state == "full" else written
        reading, target = os.pipe() if state == "gone" else (None, os.open(path, os.O_WRONLY))
        os.dup2(target, number)
        for each in (reading, target):
            if each is not None:
                os.close(each)
    name = {1: "stdout", 2: "stderr"}[number]
    stream = None if state == "closed" else open(number, "w", closefd=False, buffering=1 if number == 2 else -1)  # noqa: SIM115
    setattr(sys, name, stream)
    setattr(sys, f"__{name}__", stream)


def run_in(folder, arguments, stdout="fine", stderr="fine"):
    """Status, output and error output of a command in a process forked from this one, with these standard streams."""
    said = [folder / "stdout", folder / "stderr"]
    for path in said:
        path.touch()
    if (child := os.fork()) == 0:
        status = 70  # of a traceback
        try:
            console.file = errors.file = None  # a fixture may have captured them
            put(stderr, 2, said[1])
            put(stdout, 1, said[0])
            cli.run(arguments[0], arguments[1:])
            status = 0
        except SystemExit as end:
            status = end.code or 0
        except BaseException:
            (folder / "traceback").write_text(traceback.format_exc())
        finally:
            for stream in (sys.stdout, sys.stderr):  # as Python does when it ends
                try:
                    stream.flush()
                except Exception:
                    status = 120
            os._exit(status)
    _, ended = os.waitpid(child, 0)
    assert not (folder / "traceback").exists(), (folder / "traceback").read_text()
    return os.waitstatus_to_exitcode(ended), *(path.read_text() for path in said)


def printing(lines, problem=None):
    def command(verb, arguments):
        if lines:
            console.print("[bold]a line[/]")
        for number in range(lines):
            print(f"line {number} of {'many' * 100}")
        if problem:
            raise UserError(problem, "Do it otherwise.")

    return command


@pytest.mark.parametrize("stderr", STATES)
@pytest.mark.parametrize("stdout", STATES)
@pytest.mark.parametrize("lines", [0, 500])
@pytest.mark.parametrize("problem", [None, "no such thing"])
def test_a_command_ends_cleanly(stdout, stderr, lines, problem, tmp_path, monkeypatch):
    monkeypatch.setattr(cli, "_run", printing(lines, problem))
    status, _, errors = run_in(tmp_path, ["inspect"], stdout, stderr)
    lost = "Error: the output could not be written: No space left on device\n" * (stdout == "full" and lines > 0)
    if stdout == "gone" and lines:
        assert status == 141
    elif problem is None:
        assert status == (1 if lost else 0)
    else:
        assert status in ((2, 141) if stderr == "gone" else (2,))
    if stderr == "fine" and not (stdout == "gone" and lines):
        assert errors == ("" if problem is None else "Error: no such thing\nDo it otherwise.\n") + lost


@pytest.mark.parametrize("stdout", STATES)
@pytest.mark.parametrize("arguments", [["--version"], ["--help"], ["inspect", "--help"], ["runs", "--help"], ["-sc"]])
def test_what_only_prints_ends_cleanly(arguments, stdout, tmp_path):
    status, said, errors = run_in(tmp_path, arguments, stdout)
    assert status == {"fine": 0, "closed": 0, "full": 1, "gone": 141}[stdout]
    assert errors == ("Error: the output could not be written: No space left on device\n" if stdout == "full" else "")
    assert bool(said) == (stdout == "fine")


@pytest.mark.slow
@pytest.mark.parametrize("stdout", STATES)
def test_inspect_ends_cleanly(stdout, tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "notes.txt").write_text("nothing")
    status, _, errors = run_in(tmp_path, ["inspect", str(tmp_path / "photos")], stdout)
    assert "Traceback" not in errors
    assert status in {"fine": (0, 2), "closed": (0, 2), "full": (1, 2), "gone": (141, 2)}[stdout]


def test_a_closed_descriptor_is_not_given_to_a_file(tmp_path, monkeypatch):
    """Otherwise what is printed would be written into the first file that a command opens."""

    def opens(verb, arguments):
        with open(tmp_path / "data", "w") as file:
            assert file.fileno() > 2
            os.write(1, b"printed by a library in C")

    monkeypatch.setattr(cli, "_run", opens)
    assert run_in(tmp_path, ["train"], "closed", "closed")[0] == 0
    assert (tmp_path / "data").read_text() == ""
