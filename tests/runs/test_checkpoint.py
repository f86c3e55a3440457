import os
import pickle
import resource
import signal
import sys
from pathlib import Path

import pytest
import torch
from support import Payload

from sextant.errors import UserError
from sextant.runs.checkpoint import KEY, SCHEMA_VERSION, load_checkpoint
from sextant.runs.checkpoint_io import AtomicCheckpointIO
from sextant.torch_file import _Sealing

GOOD = {KEY: {"schema_version": SCHEMA_VERSION, "task": "classification"}, "state_dict": {"w": torch.ones(3)}}


def test_round_trip(tmp_path):
    AtomicCheckpointIO().save_checkpoint(GOOD, tmp_path / "last.ckpt")
    assert torch.equal(load_checkpoint(tmp_path / "last.ckpt")["state_dict"]["w"], torch.ones(3))


@pytest.mark.parametrize("save", [torch.save, lambda value, path: path.write_bytes(pickle.dumps(value))])
def test_a_pickle_posing_as_a_checkpoint_is_refused_and_not_executed(tmp_path, save):
    path, trace = tmp_path / "x.ckpt", tmp_path / "executed"
    save({**GOOD, "payload": Payload(trace)}, path)
    with pytest.raises(UserError, match="not loaded"):
        load_checkpoint(path)
    assert not trace.exists()


def test_truncated(tmp_path):
    path = tmp_path / "x.ckpt"
    torch.save({**GOOD, "more": torch.zeros(10_000)}, path)
    path.write_bytes(path.read_bytes()[:5_000])
    with pytest.raises(UserError, match=r"x\.ckpt"):
        load_checkpoint(path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"state_dict": {}}, "not a checkpoint of Sextant"),
        ({KEY: {"schema_version": 99}, "state_dict": {}}, "format 99"),
        ([1, 2], "not a checkpoint of Sextant"),
    ],
)
def test_other_files(tmp_path, content, said):
    torch.save(content, tmp_path / "x.ckpt")
    with pytest.raises(UserError, match=said):
        load_checkpoint(tmp_path / "x.ckpt")
    with pytest.raises(UserError, match="no checkpoint at"):
        load_checkpoint(tmp_path / "absent.ckpt")


def test_a_full_disk_keeps_the_previous_checkpoint(tmp_path, monkeypatch):
    path = tmp_path / "last.ckpt"
    AtomicCheckpointIO().save_checkpoint(GOOD, path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python would cut that of what is imported, without a word
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:  # the system refuses to write past this size, as it refuses on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
        with pytest.raises(UserError, match="previous checkpoint is intact"):
            AtomicCheckpointIO().save_checkpoint({**GOOD, "more": torch.zeros(1_000_000)}, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, ignored)
    assert torch.equal(load_checkpoint(path)["state_dict"]["w"], torch.ones(3))
    assert [p.name for p in tmp_path.iterdir()] == ["last.ckpt"]


@pytest.mark.slow
def test_a_kill_at_any_moment_of_saving_leaves_one_whole_checkpoint(tmp_path, monkeypatch):
    """Contents and digest are one file: between any two calls of the system the old one is there, then the new one."""
    path, newer = tmp_path / "last.ckpt", {**GOOD, "state_dict": {"w": torch.zeros(3)}}
    steps, stop_at = [], 0

    def step(call):
        def stopping(*given, **more):
            steps.append(call)
            if len(steps) == stop_at:
                os._exit(9)  # nothing is cleaned up, as with kill -9
            return call(*given, **more)

        return stopping

    monkeypatch.setattr(_Sealing, "_emit", step(_Sealing._emit))
    monkeypatch.setattr(os, "fsync", step(os.fsync))
    monkeypatch.setattr(Path, "replace", step(Path.replace))
    AtomicCheckpointIO().save_checkpoint(GOOD, path)
    found, last = [], len(steps)
    moments = [*range(1, last, last // 8), last - 1, last]  # fsync and the renaming are the last two
    for moment in [*moments, last + 1]:
        AtomicCheckpointIO().save_checkpoint(GOOD, path)
        steps.clear()
        if (child := os.fork()) == 0:
            stop_at = moment
            AtomicCheckpointIO().save_checkpoint(newer, path)
            os._exit(0)
        os.waitpid(child, 0)
        found.append(float(load_checkpoint(path)["state_dict"]["w"][0]))
    assert found == [1.0] * len(moments) + [0.0]
