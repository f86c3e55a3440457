"""The time of planning 10,000 cells and of skipping 1,000 finished ones; in this process, without start-up."""

import tempfile
import time
from pathlib import Path

from sextant.atomic_files import write_json
from sextant.lifecycle.execute import run_key
from sextant.lifecycle.sweep import run_sweep
from sextant.lifecycle.sweep_plan import make_plan
from sextant.registry import chapter_of
from sextant.runs.directory import RunDirectory


def _sweep(outputs: Path, rates: int, seeds: int) -> list[str]:
    lists = {"optimizer.lr": [f"0.{number:04d}" for number in range(1, rates + 1)], "seed": map(str, range(seeds))}
    given = [f"{key}={','.join(values)}" for key, values in lists.items()]
    return ["tracking=none", f"paths.outputs={outputs}", "inhibition=none,push_pull", *given]


def run() -> list[tuple[str, str, str, str, str]]:
    with tempfile.TemporaryDirectory() as folder:
        outputs = Path(folder)
        began = time.perf_counter()
        _, planned, config = make_plan(_sweep(outputs, 500, 10))
        planning = time.perf_counter() - began
        assert len(planned) == 10_000
        key = run_key(config, chapter_of(config.task.name).source(config))
        fewer = _sweep(outputs, 50, 10)
        for entry in make_plan(fewer)[1]:
            directory = RunDirectory(outputs / entry.cell.run)
            state = {"digest": entry.cell.digest, "seed": entry.cell.seed, "code": key.code, "data": key.data}
            directory.update_state(state)
            write_json(directory.metrics, {"outcome": "finished", "metrics": {}})
        began = time.perf_counter()
        found = run_sweep(fewer)
        skipping = time.perf_counter() - began
    assert found.count("finished") == 1000
    return [
        ("10,000 cells planned, 1,000 configs composed", f"{planning:.1f} s", "", "", "< 60 s"),
        ("1,000 finished cells passed over", f"{skipping:.1f} s", "", "", "a few seconds"),
    ]
