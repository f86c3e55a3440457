"""``make gpu-check``: the tests that need a GPU and timings on it, written to ``docs/benchmarks_gpu.md``.

Takes at most eight minutes, whatever it is done with by then. Without a CUDA device it says so and exits with 2.
"""

import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import torch

from benchmarks import gpu
from benchmarks.machine import describe_machine

LIMIT_S, TESTS_S = 480, 300
ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "benchmarks_gpu.md"


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


def run_tests() -> list[tuple[str, str, str]]:
    """Name, outcome and seconds of each test that needs a GPU; those that time did not suffice for are missing."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "tests.xml"
        command = [sys.executable, "-m", "pytest", "-n", "4", "-m", "gpu", f"--junitxml={report}", "--timeout=240"]
        process = subprocess.Popen(command, cwd=ROOT)
        try:
            process.wait(TESTS_S)
        except subprocess.TimeoutExpired:
            process.terminate()  # pytest writes its report of what has run
            process.wait(30)
        return read_report(report.read_text()) if report.is_file() else []


def read_report(text: str) -> list[tuple[str, str, str]]:
    """The tests of a report in JUnit's format."""
    found = []
    for case in ElementTree.fromstring(text).iter("testcase"):
        kinds = {child.tag for child in case}
        outcome = "failed" if kinds & {"failure", "error"} else "skipped" if "skipped" in kinds else "passed"
        found.append((f"{case.get('classname')}::{case.get('name')}", outcome, case.get("time", "")))
    return found


def device() -> str:
    """The GPU and what drives it."""
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
