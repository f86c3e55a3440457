"""From the command of a sweep to the first step of its first run, with each launcher; SLURM and Ray on this machine."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
QUICK = ["trainer.max_epochs=1", "tracking=none", "corruption=none", "trainer.batch_size=64", "seed=0,1"]


def _first_step(launcher: list[str], environment: Mapping[str, str]) -> float:
    with tempfile.TemporaryDirectory() as outputs:
        began = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "train.py", "-m", *QUICK, *launcher],
            cwd=ROOT,
            env={**os.environ, **environment, "SEXTANT_OUTPUTS": outputs},
            stdout=subprocess.DEVNULL,
        )
        while not list(Path(outputs).glob("runs/*/*/history.jsonl")) and process.poll() is None:
            time.sleep(0.01)
        seconds = time.perf_counter() - began
        if process.wait():
            raise RuntimeError(f"{' '.join(launcher)} failed")
    return seconds


def run() -> list[tuple[str, str, str, str, str]]:
    sys.path.insert(0, str(ROOT / "tests"))
    from loopback_slurm import missing_programs, running_slurm

    rows = [
        ("local", _first_step(["launcher=local"], {})),
        ("joblib, 2 workers", _first_step(["launcher=joblib", "launcher.workers=2"], {})),
    ]
    if not missing_programs():
        with tempfile.TemporaryDirectory() as folder, running_slurm(folder) as slurm:
            rows.append(("slurm, 2 nodes", _first_step(["launcher=slurm"], slurm.environment)))
    from ray.cluster_utils import Cluster

    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    cluster.add_node(num_cpus=1)
    rows.append(("ray, 2 workers", _first_step(["launcher=ray", f"launcher.address={cluster.address}"], {})))
    cluster.shutdown()
    local = rows[0][1]
    return [
        (
            f"command to first step, launcher={name}",
            f"{seconds:.1f} s",
            f"local, {local:.1f} s",
            f"{seconds / local:.2f}",
            "",
        )
        for name, seconds in rows
    ]
