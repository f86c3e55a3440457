"""The requirements of runs, and whether this machine meets them."""

import os
import shutil
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from sextant.addresses import read_only
from sextant.errors import command
from sextant.runs.directory import RunDirectory, all_runs
from sextant.runs.outputs_folder import other_than_default
from sextant.runs.provenance import provenance

State = Literal["good", "note", "bad"]

#: folders of SEXTANT_DATA and what they are for; all other data is rendered here
DATA = {
    "MNIST/raw": "chapters 6 and 7",
    "cifar-10-batches-py": "chapter 7",
    "nordland": "chapters 3 to 5 on a railway",
    "cold": "chapter 4 with a real robot's wheels",
    "panoramas": "chapter 2 on real panoramas",
    "butterflies": "chapter 6 on photographs",
}
#: room for a rendered city and a few hundred runs
ENOUGH_DISK_GIB = 10.0
OPTIONAL = ("embreex", "timm", "matplotlib", "mlflow", "joblib")


@dataclass(frozen=True)
class MachineFact:
    """One fact about the machine: ``bad`` prevents something from working, a ``note`` may surprise."""

    topic: str
    name: str
    found: str
    state: State = "good"


def machine_facts(outputs: Path, data: str | None) -> Iterator[MachineFact]:
    """Check versions, data, stores, threads, disk and accelerators, without changing anything.

    Args:
        outputs: folder of runs.
        data: folder that is searched for datasets; None if it is not set.
    """
    origin = provenance()
    for name, found in origin["versions"].items():
        yield MachineFact("versions", name, str(found))
    for name in OPTIONAL:
        if name not in origin["versions"]:
            yield _package(name)
    yield from _data(data)
    yield from _outputs(outputs)
    yield from _hardware(origin["hardware"], outputs)


def _package(name: str) -> MachineFact:
    try:
        return MachineFact("versions", name, version(name))
    except PackageNotFoundError:
        return MachineFact("versions", name, "not installed", "note")


def _data(data: str | None) -> Iterator[MachineFact]:
    if data is None:
        yield MachineFact("data", "SEXTANT_DATA", "not set: only rendered data and digit scans can be used", "note")
        return
    root = Path(data).expanduser()
    if not root.is_dir():
        yield MachineFact("data", "SEXTANT_DATA", f"{data} is not a folder", "bad")
        return
    for name, purpose in DATA.items():
        there = (root / name).is_dir()
        yield MachineFact("data", name, f"found, for {purpose}" if there else f"missing, for {purpose}", _note(there))


def _outputs(outputs: Path) -> Iterator[MachineFact]:
    if not outputs.is_dir():
        yield MachineFact("runs", "outputs", f"{outputs} is made by the first run", "note")
        return
    runs = all_runs(outputs)
    finished = sum(run.results() is not None for run in runs)
    writable = os.access(outputs, os.W_OK)
    yield MachineFact("runs", "outputs", f"{outputs}{'' if writable else ' cannot be written to'}", _bad(writable))
    yield MachineFact("runs", "finished", f"{finished} of {len(runs)}")
    database = outputs / "mlflow.db"
    if database.is_file():
        what = _integrity(database)
        yield MachineFact("runs", "mlflow.db", "sound" if what == "ok" else what, _bad(what == "ok"))
    fill = command("dashboard", outputs=other_than_default(outputs))
    yield _tracked([run for run in runs if run.results() is not None], fill)


def _tracked(finished: list[RunDirectory], fill: str) -> MachineFact:
    """Whether every finished run is in a store; runs with ``tracking=none`` that were never sent are in none."""
    states = [run.state() for run in finished]
    unsent = sum((state.get("tracking") or {}).get("sent") is False for state in states)
    nowhere = sum(not state.get("tracking") and not state.get("mlflow_runs") for state in states)
    lacks = [f"{unsent} {_runs(unsent)} not there: {fill} sends them"] if unsent else []
    if nowhere:
        lacks.append(f"{nowhere} {_runs(nowhere)} in no store; {fill} adds them to one")
    return MachineFact("runs", "tracking store", "; ".join(lacks) or "has every finished run", _note(not lacks))


def _runs(count: int) -> str:
    return "run is" if count == 1 else "runs are"


def _integrity(database: Path) -> str:
    try:
        with read_only(database) as connection:
            return str(connection.execute("PRAGMA quick_check").fetchone()[0])
    except sqlite3.Error as error:
        return f"damaged ({error}): move it away, and sextant dashboard makes a new one"


def _hardware(hardware: dict[str, object], outputs: Path) -> Iterator[MachineFact]:
    import torch

    for name in ("processor", "cores", "memory_gib"):
        yield MachineFact("machine", name.replace("_gib", ", GiB"), str(hardware[name]))
    gpus = hardware["gpus"] or "none: everything runs on the CPU"
    yield MachineFact("machine", "GPU", str(gpus), _note(bool(hardware["gpus"])))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    threads = torch.get_num_threads()
    told = f"{threads} of PyTorch on {cores} cores that this process may use"
    yield MachineFact("machine", "threads", told, _note(threads <= cores))
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        if name in os.environ:
            yield MachineFact("machine", name, os.environ[name])
    folder = next(path for path in (outputs, *outputs.parents) if path.is_dir())
    free = shutil.disk_usage(folder).free / 2**30
    yield MachineFact("machine", "free disk, GiB", f"{free:.1f}", _note(free >= ENOUGH_DISK_GIB))


def _note(fine: bool) -> State:
    return "good" if fine else "note"


def _bad(fine: bool) -> State:
    return "good" if fine else "bad"
