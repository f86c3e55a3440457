"""Time from the command to the first training step, relative to importing Lightning and MLflow."""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
REPEATS = 3
BARE = "import pytorch_lightning, mlflow"
FIRST_STEP = """
import os, sys, time
sys.argv = ["train.py", "trainer.progress=false"]
from sextant.cli import run_script

def stop(self, batch, batch_idx):
    print("FIRST STEP", time.time(), flush=True)
    os._exit(0)

import builtins
real = builtins.__import__
def patched(name, *args, **kwargs):
    module = real(name, *args, **kwargs)
    if name == "sextant.chapters.classification.task":
        sys.modules[name].Classification.training_step = stop
    return module
builtins.__import__ = patched
run_script("train")
"""


def run() -> list[tuple[str, str, str, str, str]]:
    bare = statistics.median(_seconds([sys.executable, "-c", BARE]) for _ in range(REPEATS))
    rows = []
    first, warm = [], []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as outputs:
            first.append(_to_first_step(outputs))
            warm.append(_to_first_step(outputs))
    for name, values, aim in (("no store yet", first, "<= 1.5"), ("warm store", warm, "<= 1.3")):
        value = statistics.median(values)
        rows.append(
            (
                f"first step, {name}",
                f"{value:.1f} s",
                f"import Lightning, MLflow {bare:.1f} s",
                f"{value / bare:.2f}",
                aim,
            )
        )
    for name, arguments in (("--cfg job", ["--cfg", "job"]), ("--help", ["--help"]), ("config error", ["lr=1"])):
        value = statistics.median(_seconds([sys.executable, "train.py", *arguments]) for _ in range(REPEATS))
        rows.append((name, f"{value:.2f} s", "", "", "< 1 s"))
    return rows


def _seconds(command: list[str]) -> float:
    began = time.time()
    subprocess.run(command, cwd=ROOT, capture_output=True, check=False)
    return time.time() - began


def _to_first_step(outputs: str) -> float:
    began = time.time()
    environment = {**os.environ, "SEXTANT_OUTPUTS": outputs}
    done = subprocess.run(
        [sys.executable, "-c", FIRST_STEP], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("FIRST STEP")]
    return float(line.split()[-1]) - began
