"""The logged metrics of a run as JSON lines."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from sextant.atomic_files import write_atomically


class History:
    """Appends metrics to a file, each pair of step and name once.

    A run that was killed and resumed from an earlier checkpoint repeats some steps with the same values; these are
    recognised and left out. A last line that was cut off by a crash is dropped.
    """

    def __init__(self, path: Path):
        self.path = path
        self._seen: set[tuple[int, str]] = set()
        lines = list(read_history(path))
        if path.exists():
            text = "".join(json.dumps(line) + "\n" for line in lines)
            write_atomically(path, lambda file: file.write(text.encode()))
        for line in lines:
            self._seen.update((line["step"], name) for name in line["metrics"])

    def add(self, step: int, time_ms: int, metrics: Mapping[str, float]) -> dict[str, float]:
        """Append the new entries of ``metrics`` and return them."""
        new = {name: value for name, value in metrics.items() if (step, name) not in self._seen}
        if new:
            self._seen.update((step, name) for name in new)
            with self.path.open("a") as file:
                file.write(json.dumps({"step": step, "time_ms": time_ms, "metrics": new}) + "\n")
        return new


def read_history(path: Path) -> Iterator[dict]:  # type: ignore[type-arg]
    """The lines of a history: ``{"step": .., "time_ms": .., "metrics": {..}}``."""
    if not path.exists():
        return
    for line in path.read_text().splitlines():
        try:
            yield json.loads(line)
        except ValueError:
            return
