"""The finished cells of a sweep as a small folder that can be committed, and joined with those of other blocks.

``block.json`` holds the plan with the digest of each cell's config, the measure, the set of corruptions, and one config
per setting and arm; ``cells.csv`` what each run was and found; ``values.npz`` the values of its test images. A report
made from such folders is that of the runs themselves.
"""

import csv
import io
import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sextant.atomic_files import read_json, write_atomically, write_json
from sextant.errors import UserError
from sextant.evaluation import CorruptionErrors
from sextant.kit.measure import Measure, SharedSet
from sextant.reports.results import CellResult, SweepResults, Training
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan

PLAN, CELLS, VALUES = "block.json", "cells.csv", "values.npz"
#: columns of ``cells.csv``; ``found`` is JSON
COLUMNS = ("setting", "arm", "pair", "seed", "digest", "code", "data", "outcome", "seconds", "parameters", "found")
#: keys of a config that say where a run was computed, and of what it is a replicate
HERE = ("seed", "paths", "tracking", "sweep", "launcher", "hydra")


def write_cells(results: SweepResults, folder: Path) -> Path:
    """Write the tested cells of a sweep into a folder; what an earlier call left there is replaced."""
    outputs, rows = results.directory.parents[1], []
    values: dict[str, np.ndarray] = {}
    configs: dict[str, Mapping[str, Any]] = {**results.configs}
    for number, result in enumerate(results.cells):
        if result.outcome in ("missing", "failed"):
            continue
        cell, run = result.cell, RunDirectory(outputs / result.cell.run)
        found = {
            "cost": result.cost,
            "metrics": result.metrics,
            "errors": result.errors and asdict(result.errors),
            "started": None if math.isnan(result.started) else result.started,
            "headline": result.headline,
            "training": result.training and asdict(result.training),
        }
        identity = [cell.setting, cell.arm, cell.pair, cell.seed, cell.digest, result.code, result.data]
        rows.append([*identity, result.outcome, result.seconds, result.parameters, json.dumps(found)])
        values |= {f"{number}/{condition}": images for condition, images in result.values.items()}
        if run.config.is_file() and (key := f"{cell.setting}: {cell.arm}") not in configs:
            configs[key] = {k: v for k, v in yaml.safe_load(run.config.read_text()).items() if k not in HERE}
    cells = [replace(cell, message="") for cell in results.plan.cells]
    plan = asdict(replace(results.plan, cells=cells, mlflow_runs=[], tracking={}, here=""))
    shared = None if results.shared is None else asdict(results.shared)
    content = {"plan": plan, "measure": asdict(results.measure), "shared": shared, "configs": configs}
    write_json(folder / PLAN, content)
    text, packed = io.StringIO(), io.BytesIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    np.savez_compressed(packed, **values)  # type: ignore[arg-type]  # its own options are no conditions
    write_atomically(folder / CELLS, lambda file: file.write(text.getvalue().encode()))
    write_atomically(folder / VALUES, lambda file: file.write(packed.getvalue()))
    return folder


def is_stored(folder: Path) -> bool:
    """Whether a folder holds the cells of a sweep."""
    return (folder / PLAN).is_file()


def join_cells(folders: Sequence[Path], outputs: Path) -> SweepResults:
    """The results of one sweep from the cells of its blocks; cells in no block are missing.

    Args:
        folders: folders of :func:`write_cells`.
        outputs: output folder, in which the report of the sweep belongs.

    Raises:
        UserError: a folder is damaged, the folders are of different sweeps, or two of them contradict each other.
    """
    blocks = [_read(folder) for folder in folders]
    first = blocks[0]
    for folder, block in zip(folders[1:], blocks[1:], strict=True):
        if block.plan.digest != first.plan.digest or (block.measure, block.shared) != (first.measure, first.shared):
            raise UserError(
                f"{folder} holds {block.plan.name}-{block.plan.digest[:8]}, another design than {folders[0]} "
                f"with {first.plan.name}-{first.plan.digest[:8]}",
                "Join blocks of one sweep, run with the same overrides and tested under the same conditions.",
            )
    cells = []
    for number, empty in enumerate(first.cells):
        there = [(folder, b.cells[number]) for folder, b in zip(folders, blocks, strict=True) if b.cells[number].values]
        for folder, other in there[1:]:
            if any(not np.array_equal(other.values[key], images) for key, images in there[0][1].values.items()):
                raise UserError(
                    f"{there[0][0]} and {folder} have different results of {empty.cell.setting} {empty.cell.arm} seed "
                    f"{empty.cell.seed}",
                    "Join only one of them.",
                )
        held = [block.cells[number] for block in blocks if block.cells[number].outcome != "missing"]
        cells.append(held[0] if held else empty)
    configs = {key: config for block in reversed(blocks) for key, config in block.configs.items()}
    return SweepResults(first.plan, first.plan.directory(outputs), cells, first.shared, configs)


def _read(folder: Path) -> "_Block":
    try:
        return _Block(folder)
    except (OSError, KeyError, TypeError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise UserError(
            f"{folder} does not hold the cells of a sweep, or they are damaged: {error}",
            "sextant report sweep=<name> cells=<folder> writes them again.",
        ) from None


class _Block:
    def __init__(self, folder: Path):
        told: Any = read_json(folder / PLAN)
        plan = told["plan"]
        self.plan = SweepPlan(**{**plan, "cells": [Cell(**cell) for cell in plan["cells"]]})
        self.measure = Measure(**{**told["measure"], "metrics": tuple(told["measure"]["metrics"])})
        self.shared = None if told["shared"] is None else _shared(told["shared"])
        self.configs: dict[str, dict[str, Any]] = told["configs"]
        with (folder / CELLS).open(newline="") as file:
            reader = csv.DictReader(file)
            rows = {_key(row): row for row in reader}
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise ValueError(f"{CELLS} has other columns than {', '.join(COLUMNS)}")
        with np.load(folder / VALUES, allow_pickle=False) as arrays:
            values: dict[int, dict[str, np.ndarray]] = {}
            for name in arrays:
                number, _, condition = name.partition("/")
                values.setdefault(int(number), {})[condition] = arrays[name]
        self.cells = [
            self._cell(cell, rows.get((cell.setting, cell.arm, str(cell.pair), cell.digest)), values.get(number, {}))
            for number, cell in enumerate(self.plan.cells)
        ]
        if len(rows) != sum(cell.outcome != "missing" for cell in self.cells):
            raise ValueError(f"{CELLS} has cells that are not of the plan")

    def _cell(self, cell: Cell, row: Mapping[str, str] | None, values: dict[str, np.ndarray]) -> CellResult:
        if row is None:
            return CellResult(cell, "missing", {})
        if row["outcome"] not in ("finished", "diverged"):
            raise ValueError(f"outcome {row['outcome']!r}")
        if row["outcome"] == "finished" and not values:
            raise ValueError(f"{VALUES} lacks {cell.setting} {cell.arm} seed {cell.seed}")
        found = json.loads(row["found"])
        errors = found["errors"] and CorruptionErrors(
            found["errors"]["clean"], {name: tuple(each) for name, each in found["errors"]["severities"].items()}
        )
        return CellResult(
            cell,
            row["outcome"],  # type: ignore[arg-type]
            values,
            float(row["seconds"]),
            int(row["parameters"]),
            self.measure,
            errors,
            found["cost"],
            found["metrics"],
            # cells that were stored by earlier releases lack these
            math.nan if (started := found.get("started")) is None else float(started),
            found.get("headline") or {},
            Training(**found["training"]) if found.get("training") else None,
            row["code"] or None,
            row["data"] or None,
        )


def _key(row: Mapping[str, str]) -> tuple[str, str, str, str]:
    return (row["setting"], row["arm"], row["pair"], row["digest"])


def _shared(told: Mapping[str, Any]) -> SharedSet:
    severities = {name: tuple(levels) for name, levels in told["severities"].items()}
    beside = {name: tuple(keys) for name, keys in told["beside"].items()}
    return SharedSet(tuple((key, how) for key, how in told["tested"]), severities, told["left_out"], beside)
