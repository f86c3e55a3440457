"""Run directories: their layout, and which directory a run belongs in."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sextant.atomic_files import read_json, write_json

Reuse = Literal["exact", "any_code"]


@dataclass(frozen=True)
class RunKey:
    """The identity of a run: the experiment, its replicate (seed), and the code and data it was computed with."""

    task: str
    digest: str
    seed: int
    code: str
    data: str

    @property
    def name(self) -> str:
        """The name of its directory, ``<digest8>-s<seed>``."""
        return f"{self.digest[:8]}-s{self.seed}"

    @property
    def identity(self) -> dict[str, Any]:
        """What its results say of it: all but the task."""
        return {"digest": self.digest, "seed": self.seed, "code": self.code, "data": self.data}


@dataclass(frozen=True)
class RunDirectory:
    """The files of one run.

    ``metrics.json`` is written last and atomically. A directory with this file holds a finished run; one without it
    holds a run that can be resumed from ``checkpoints/last.ckpt``.
    """

    path: Path

    @property
    def config(self) -> Path:
        """The resolved config."""
        return self.path / "config.yaml"

    @property
    def metrics(self) -> Path:
        """Final metrics; the file exists once the run is finished."""
        return self.path / "metrics.json"

    @property
    def history(self) -> Path:
        """Logged metrics, one JSON object per line."""
        return self.path / "history.jsonl"

    @property
    def traceback(self) -> Path:
        """The traceback of a run that an error of the program ended."""
        return self.path / "error.log"

    @property
    def arrays(self) -> Path:
        """Per-image results, as a zip of plain arrays."""
        return self.path / "predictions.npz"

    @property
    def figures(self) -> Path:
        """Folder of figures."""
        return self.path / "figures"

    @property
    def checkpoints(self) -> Path:
        """Folder of checkpoints."""
        return self.path / "checkpoints"

    @property
    def last_checkpoint(self) -> Path:
        """The checkpoint of the last finished epoch."""
        return self.checkpoints / "last.ckpt"

    @property
    def best_checkpoint(self) -> Path:
        """The checkpoint with the best validation metric."""
        return self.checkpoints / "best.ckpt"

    def state(self) -> dict[str, Any]:
        """The content of ``run.json``: key, status, provenance, MLflow ids; empty before the run has begun."""
        found = read_json(self.path / "run.json")
        return found if isinstance(found, dict) else {}

    def update_state(self, changes: Mapping[str, Any]) -> None:
        """Write ``run.json`` with ``changes`` applied."""
        write_json(self.path / "run.json", {**self.state(), **changes})

    def results(self) -> dict[str, Any] | None:
        """The content of ``metrics.json``; None before the run is finished."""
        found = read_json(self.metrics)
        return found if isinstance(found, dict) else None

    def tracking_ids(self) -> list[str]:
        """The MLflow runs that mirror or have mirrored this run, newest last."""
        return list(self.state().get("mlflow_runs", []))


@dataclass(frozen=True)
class Claim:
    """The directory that a run belongs in, and whether it holds the finished run.

    Attributes:
        directory: the run directory.
        finished: whether it holds the finished run.
        passed_over: for each finished directory of the same experiment and seed that was not taken, the reason.
    """

    directory: RunDirectory
    finished: bool
    passed_over: tuple[str, ...] = ()


def claim(outputs: Path, key: RunKey, reuse: Reuse = "exact") -> Claim:
    """Find the directory of a run: a finished run to return, an unfinished one to resume, or a new directory.

    A directory is taken if it was computed with the same data and the same code; ``reuse="any_code"`` also accepts a
    finished run of other code. Otherwise the run goes into ``<name>-2``, ``<name>-3``, ...; nothing is overwritten.
    """
    passed_over: list[str] = []
    for path in _candidates(outputs / "runs" / key.task / key.name):
        directory = RunDirectory(path)
        state, finished = directory.state(), directory.metrics.is_file()
        if not state and not finished:  # new, or killed before it wrote anything
            return Claim(directory, False, tuple(passed_over))
        changed = [name for name in ("digest", "data", "code") if state.get(name) != getattr(key, name)]
        if not changed or (finished and changed == ["code"] and reuse == "any_code"):
            return Claim(directory, finished, tuple(passed_over))
        passed_over.append(f"{path.name}: {' and '.join(changed)} changed")
    raise AssertionError("unreachable: candidates never end")


def _candidates(first: Path) -> Iterator[Path]:
    yield first
    count = 2
    while True:
        yield first.with_name(f"{first.name}-{count}")
        count += 1


def all_runs(outputs: Path) -> list[RunDirectory]:
    """Every run directory, sorted by name."""
    return [RunDirectory(path.parent) for path in sorted(outputs.glob("runs/*/*/run.json"))]
