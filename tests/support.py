"""What several tests need."""

import errno
import importlib
import signal
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import torch

from sextant.composing.compose import compose, to_plain
from sextant.console.console import reporting_mistakes
from sextant.lifecycle.checks import preflight
from sextant.lifecycle.evaluation import evaluate_run
from sextant.lifecycle.execute import execute
from sextant.lifecycle.run_reporter import RunReporter
from sextant.runs.directory import RunDirectory

#: A run of a second or two: two epochs of the digit scans, three test conditions.
QUICK = (
    "trainer.max_epochs=2",
    "trainer.batch_size=64",
    "trainer.progress=false",
    "corruption.corruptions.gaussian.levels=[0.1]",
    "corruption.corruptions.contrast_poisson.levels=[0.5]",
    "tracking.system_metrics=false",
)

CHECKPOINT = "runs/*/*/checkpoints/last.ckpt"


def quick_config(outputs: Path, *overrides: str) -> dict[str, Any]:
    """The plain config of a quick run that writes to ``outputs``."""
    return to_plain(compose([*QUICK, f"paths.outputs={outputs}", *overrides]))


def traces(outputs, pattern):
    """The files of a pattern, each with when it was written."""
    return {(path, path.stat().st_mtime_ns) for path in outputs.glob(pattern)}


def wait_for(outputs, pattern, ended):
    """Wait until a file of the pattern is written anew, or all has ended."""
    before = traces(outputs, pattern)
    while traces(outputs, pattern) <= before and not ended():
        time.sleep(0.01)


def told_before_training(task, words, monkeypatch, capsys):
    """What ``train.py`` says of a mistake, which it finds without a step of training."""

    def forbidden(self, batch, batch_idx):
        raise AssertionError("it was trained")

    with monkeypatch.context() as patch:
        patch.setattr(task, "training_step", forbidden)
        with pytest.raises(SystemExit) as caught, reporting_mistakes():
            execute(preflight(words))
    said = capsys.readouterr().err
    assert caught.value.code == 2
    assert said.count("Error: ") == 1
    assert said.startswith("Error: ")
    assert "Traceback" not in said
    return said


def fill_disk(monkeypatch, name):
    """The disk is full when a file of this name is to be written."""
    replace = Path.replace

    def refusing(path, target):
        if target.name == name:
            raise OSError(errno.ENOSPC, "No space left on device")
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", refusing)


class Hears(RunReporter):
    """Keeps what is said."""

    def __init__(self):
        self.said = []

    def say(self, text):
        self.said.append(text)


class Payload:
    """Unpickling it creates a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def evaluated(outputs, run, *overrides):
    """The directory of a test of a run."""
    outcome = evaluate_run(str(run.path), [*overrides, f"paths.outputs={outputs}", "tracking=none"])
    return RunDirectory(outcome.directory)


@contextmanager
def torchs_settings_unchanged(kind=torch.float32):
    """Within the block torch's default type is ``kind``; the block changes neither it nor torch's random state."""
    torch.set_default_dtype(kind)
    try:
        before = torch.random.get_rng_state()
        yield
        assert torch.get_default_dtype() == kind
        assert torch.equal(torch.random.get_rng_state(), before)
    finally:
        torch.set_default_dtype(torch.float32)


@contextmanager
def imported_anew(*blocked):
    """Within the block Sextant is imported as in a new process in which these packages cannot be imported.

    Other libraries stay as they are, which saves the seconds that a new process takes.
    """
    before = dict(sys.modules)

    def anew():
        return [name for name in sys.modules if name.partition(".")[0] in ("sextant", *blocked) or name in blocked]

    for name in {*anew(), *blocked}:
        if name.partition(".")[0] == "sextant":
            del sys.modules[name]
        else:
            sys.modules[name] = None
    try:
        yield importlib.import_module("sextant")
    finally:
        for name in anew():
            del sys.modules[name]
        sys.modules.update(before)


def heeds_signals() -> None:
    """For ``preexec_fn`` of a child that is to be interrupted: a suite started by ``nohup`` or in the background of a
    script ignores SIGHUP or SIGINT, and children would inherit that.
    """
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def as_published(network, path, push_pull=(), prefix="", **changes):
    """Write ``network`` as the authors' script did: renamed keys, a legacy pickle."""
    state = {}
    for name, tensor in network.state_dict().items():
        module, _, last = name.rpartition(".")
        state[prefix + (f"{module}.push.{last}" if module in push_pull else name)] = tensor
    torch.save(
        {"epoch": 7, "state_dict": state, "best_prec1": 91.71, **changes}, path, _use_new_zipfile_serialization=False
    )
    return path
