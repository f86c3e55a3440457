"""A dataset rendered in parts by an array of SLURM."""

import os
import shlex
import sys
from pathlib import Path

import pytest
from loopback_slurm import running_slurm
from rendered_toy import ToyPlan

from sextant import cli
from sextant.data.rendered import open_store, verify_store

ROOT = Path(__file__).parents[2]
RENDER = ["render", "dataset=digits", "dataset._target_=rendered_toy.ToyWorld", "dataset.size=22", "shards=3"]


@pytest.mark.cluster
@pytest.mark.slow
def test_an_array_of_three_renders_what_one_process_does(tmp_path, monkeypatch):
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "src"), str(ROOT / "tests")]))
    program = [sys.executable, "-c", "from sextant.cli import main; main()", "data", *RENDER]
    with running_slurm(tmp_path / "slurm") as slurm:
        command = f"{shlex.join(program)} shard=$SLURM_ARRAY_TASK_ID"
        slurm.ask("sbatch", "--wait", "--array=0-2", f"--output={tmp_path}/%a.log", "--wrap", command)
    cli.run("data", RENDER)
    open_store(ToyPlan(), tmp_path / "whole").fill()
    merged, whole = (next((tmp_path / folder).glob("toy-*")) for folder in ("data", "whole"))
    assert verify_store(merged).sound
    assert (merged / "image.npy").read_bytes() == (whole / "image.npy").read_bytes()
