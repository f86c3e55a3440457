"""The time that a sweep spends on a cell that is already finished."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
QUICK = ["trainer.max_epochs=1", "tracking=none", "corruption=none", "trainer.batch_size=256"]


def run() -> list[tuple[str, str, str, str, str]]:
    with tempfile.TemporaryDirectory() as outputs:
        environment = {**os.environ, "SEXTANT_OUTPUTS": outputs}

        def seconds(seeds: int) -> float:
            command = [sys.executable, "train.py", "-m", *QUICK, f"seed={','.join(map(str, range(seeds)))}"]
            began = time.time()
            subprocess.run(
                [*command, "backbone=lenet_a,lenet_b"], cwd=ROOT, env=environment, capture_output=True, check=True
            )
            return time.time() - began

        seconds(8)  # runs all 16
        few, many = seconds(1), seconds(8)
    each, whole = (many - few) / 14, many / 16
    return [
        ("a finished sweep cell", f"{1000 * each:.0f} ms", "", "", "< 200 ms"),
        ("16 finished cells, start-up included", f"{many:.2f} s", f"{1000 * whole:.0f} ms per cell", "", ""),
    ]
