"""What ``make gpu-claims`` lists, refuses and interrupts."""

import sys
import threading
import time

import psutil
import pytest
import torch

from benchmarks import gpu_claims, machine
from benchmarks.machine import run_for
from sextant.errors import UserError
from sextant.lifecycle.sweep_plan import read_design, sweep_words


@pytest.mark.slow
def test_blocks_take_at_most_eight_minutes_and_cover_their_designs_once():
    found = gpu_claims.blocks()
    assert {block.name for block in found} >= {"push_pull_clean, push_pull_robustness", "pushpull_placement"}
    for block in found:
        design = read_design(sweep_words(block.arguments))
        number, count = map(int, design.block.split("/"))
        assert 0 < block.minutes * 60 <= gpu_claims.LIMIT_S
        assert len(design.seeds) >= count
        alike = [other for other in found if other.name == block.name]
        assert (len(alike), alike.index(block) + 1) == (count, number)


def test_the_list_names_each_command(capsys):
    gpu_claims.main([])
    told = capsys.readouterr().out
    assert told.count("sextant train -m") == len(gpu_claims.blocks())
    assert "trainer.accelerator=gpu" in told


@pytest.mark.parametrize("number", ["0", "99", "-1", "one", "1.5"])
def test_a_block_that_there_is_not_is_refused(number):
    with pytest.raises(UserError, match=f"BLOCK={number} must be a number from 1 to"):
        gpu_claims.main([number])


def test_without_a_gpu_nothing_runs(monkeypatch, capsys):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(gpu_claims, "run", None)
    with pytest.raises(SystemExit) as end:
        gpu_claims.main(["1"])
    assert end.value.code == 2
    assert "no CUDA device was found" in capsys.readouterr().err


def test_a_block_is_interrupted_when_its_time_is_up(capsys, monkeypatch):
    monkeypatch.setattr(machine, "GRACE_S", 1)
    assert gpu_claims.run([sys.executable, "-c", "raise SystemExit(3)"]) == 3
    assert gpu_claims.run([sys.executable, "-c", "import threading; threading.Event().wait()"], seconds=0.2) == 124
    assert "the same command resumes it" in capsys.readouterr().err


@pytest.mark.slow
def test_what_an_interrupted_block_started_ends_with_it(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "GRACE_S", 1)
    child = "import os, signal, threading; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    child += "print(os.getpid(), flush=True); threading.Event().wait()"
    starts = (
        f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {child!r}], stdout=open('pid', 'w')).wait()"
    )
    assert run_for(5, [sys.executable, "-c", starts], tmp_path) == 124
    left = int((tmp_path / "pid").read_text())
    gone = time.monotonic() + 20
    while psutil.pid_exists(left) and psutil.Process(left).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < gone
        threading.Event().wait(0.05)
