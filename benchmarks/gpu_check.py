"""``make gpu-check``: the tests that need a GPU and timings on it, written to ``results/benchmarks_gpu.md``.

Stops after at most eight minutes, with the results so far. Without a CUDA device it exits with status 2.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import torch

from benchmarks import gpu
from benchmarks.machine import describe_machine, run_for

LIMIT_S, TESTS_S = 480, 300
ROOT = Path(__file__).parents[1]
PAGE = ROOT / "results" / "benchmarks_gpu.md"


def main() -> None:
    if not torch.cuda.is_available():
        print("no CUDA device was found on this machine: nothing was checked", file=sys.stderr)
        raise SystemExit(2)
    began = time.monotonic()
    tests = run_tests()
    timings = gpu.run(until=began + LIMIT_S - 60)
    PAGE.write_text(page(tests, timings, device(), time.monotonic() - began))
    failed = [name for name, outcome, _ in tests if outcome == "failed"]
    print(f"{PAGE.relative_to(ROOT)}: {len(tests)} tests, {len(failed)} failed; {len(timings)} timings")
    raise SystemExit(1 if failed or not tests else 0)


def run_tests(chosen: str = "gpu", seconds: float = TESTS_S) -> list[tuple[str, str, str]]:
    """Name, outcome and seconds of each test that needs a GPU, without those that time did not suffice for.

    Args:
        chosen: the marker of the tests, or a file of them.
        seconds: time limit.
    """
    which = [chosen] if chosen.endswith(".py") else ["-m", chosen]
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "tests.jsonl"
        command = [sys.executable, "-m", "pytest", "-n", "4", *which, "-p", "benchmarks.outcome_log", "--timeout=240"]
        run_for(seconds, command, ROOT, SEXTANT_TEST_LOG=str(log))
        return [tuple(json.loads(line)) for line in log.read_text().splitlines()] if log.is_file() else []


def device() -> str:
    """The GPU and its software."""
    found = torch.cuda.get_device_properties(0)
    memory = f"{found.total_memory / 2**30:.0f} GiB"
    return f"{found.name}, {memory}, CUDA {torch.version.cuda}, cuDNN {torch.backends.cudnn.version()}"


def page(
    tests: list[tuple[str, str, str]], timings: list[tuple[str, str, str, str, str]], gpu_name: str, seconds: float
) -> str:
    """The page, in Markdown."""
    heads = {"passed": 0, "failed": 0, "skipped": 0}
    for _, outcome, _ in tests:
        heads[outcome] += 1
    lines = [
        "# On a GPU",
        "",
        f"Written by `make gpu-check` in {seconds:,.0f} s on {gpu_name}; {describe_machine()}.",
        "",
        "## Tests",
        "",
        ", ".join(f"{count} {outcome}" for outcome, count in heads.items()) + ". A task on the GPU is compared with "
        "the same on the CPU: its first training loss, its metrics, and what a trained network answers.",
        "",
        *table(("test", "outcome", "seconds"), tests),
        "",
        "## Training steps",
        "",
        "Forward, loss, backward and optimiser on images that lie on the device; no data is read.",
        "",
        *table(("network", "precision", "measured", "against", "ratio"), timings),
    ]
    return "\n".join(lines) + "\n"


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """Rows as a table of Markdown."""
    return [f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *rows)]


if __name__ == "__main__":
    main()
