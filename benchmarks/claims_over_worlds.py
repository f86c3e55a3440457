"""Claims whose replicates are worlds, from runs that ``sextant claims plan claim=<name>`` names.

``python -m benchmarks.claims_over_worlds claim=places_trained [outputs= output=]``

Every world counts with the one run that finished in it. Each claim writes ``recorded.csv``, ``replicates.csv`` and
``dates.csv``, of which ``sextant claims`` makes its verdict.

``places_trained``: recall@1 of the network in a town, less that of the best descriptor that learns nothing, and less
that of the better linear map that learns from pairs.

``localization_any_pose``: median error of ``filter=bayes_restart`` in a map thinned to a tenth, less the median
distance of the drive from the nearest pose of such a map.

``calibration_four_parameters``: median error of the network in each parameter, in per cent of a constant camera's.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from benchmarks.replicates import Row, over_worlds, store
from sextant.chapters.localization.data.datamodule import LocalizationDataModule
from sextant.chapters.localization.data.faults import ThinnedMap
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.config.override_words import override
from sextant.console.arguments import parse_arguments
from sextant.errors import UserError
from sextant.registry import chapter_of
from sextant.runs.directory import RunDirectory, all_runs
from sextant.tables import TextTable

USAGE = "python -m benchmarks.claims_over_worlds claim=places_trained [outputs=<folder>] [output=<folder>]"
KEYS = {
    "claim": "places_trained, localization_any_pose or calibration_four_parameters",
    "outputs": "folder of the runs (default: outputs)",
    "output": "folder for the tables (default: where the claim has them)",
}
STORED = {
    "places_trained": "results/places/trained_worlds",
    "localization_any_pose": "results/localization/recovery_worlds",
    "calibration_four_parameters": "results/calibration/worlds",
}
TASKS = {
    "places_trained": "place_recognition",
    "localization_any_pose": "localization",
    "calibration_four_parameters": "calibration",
}
UNLEARNED = ("pixels", "patch-normalised", "HOG", "untrained network")
LINEAR = ("LDA", "CCA")
CONDITIONS = ("autumn_rain", "winter_noon", "winter_dusk", "night_clear")
#: maps drawn anew, of which the distance to the nearest pose is the mean
MAPS = 50
#: names of the four parameters in the claim, and their metrics
PARAMETERS = {"tilt": "tilt_deg", "roll": "roll_deg", "vfov": "vfov_deg", "distortion": "k1_hat"}


def main(arguments: Sequence[str]) -> None:
    given = parse_arguments(arguments, KEYS, USAGE)
    claim = given.get("claim", "")
    if claim not in STORED:
        raise UserError(f"claim={claim} must be one of {', '.join(STORED)}", f"For example claim={next(iter(STORED))}")
    outputs = Path(given.get("outputs", "outputs"))
    runs = list(finished(outputs, TASKS[claim]))
    if claim == "localization_any_pose":
        replicates, rows = any_pose(runs, outputs)
    else:
        replicates, rows = trained(runs) if claim == "places_trained" else four_parameters(runs)
    times = [float(run.state()[key]) for run in runs for key in ("started", "ended")]
    first, last = (datetime.fromtimestamp(time, UTC).isoformat(timespec="seconds") for time in (min(times), max(times)))
    store(Path(given.get("output", STORED[claim])), replicates, rows, first, last)


def finished(outputs: Path, task: str) -> Iterator[RunDirectory]:
    """The finished runs of a task of seed 0 that have a world, one each; of localization, those of ``bayes_restart``.

    Raises:
        UserError: there are none, or several in one world.
    """
    seen = dict[int, Path]()
    for run in all_runs(outputs):
        state = run.state()
        params = state.get("params", {})
        if state.get("task") != task or params.get("dataset.world") is None or run.results() is None:
            continue
        if state["seed"] != 0 or (task == "localization" and not _restarts(params)):
            continue
        if other := seen.get(world_of(run)):
            raise UserError(f"{other} and {run.path} are of one world", "Leave only the one that counts there.")
        seen[world_of(run)] = run.path
        yield run
    if not seen:
        raise UserError(
            f"{outputs} has no finished run of {task} with dataset.world", "Run what the claim's plan says."
        )


def _restarts(params: Mapping[str, Any]) -> bool:
    restarts = str(params.get("recovery._target_", "")).endswith("BayesRestart")
    return restarts and params.get("filter.best") is None  # else a baseline without a filter


def world_of(run: RunDirectory) -> int:
    """The seed of the layout that a run was tested in."""
    return int(run.state()["params"]["dataset.world"])


# -- places ------------------------------------------------------------------------------------------------------------


def trained(runs: Sequence[RunDirectory]) -> tuple[TextTable, list[Row]]:
    """Recall@1 in per cent by world, condition and method, and the gains that the claim rests on."""
    table, gains = [], dict[str, list[float]]()
    methods = ("network", *UNLEARNED, "whitened PCA", *LINEAR)
    for run in sorted(runs, key=world_of):
        with np.load(run.arrays) as arrays:
            for condition in CONDITIONS:
                keys = (key for key in arrays if key.startswith("R@1_") and f"_{condition}_to_" in key)
                name = {key.split("/")[1]: key for key in keys if "sequence" not in key and "reranked" not in key}
                recall = {method: 100 * float(arrays[name[method]].mean()) for method in methods}
                table.append([str(world_of(run)), condition, *(f"{recall[method]:.3f}" for method in methods)])
                for kind, others in (("trained", UNLEARNED), ("trained_linear", LINEAR)):
                    gain = recall["network"] - max(recall[other] for other in others)
                    gains.setdefault(f"{kind}/{condition}", []).append(gain)
    source = "replicates.csv: network less the best of " + ", ".join(UNLEARNED)
    linear = "replicates.csv: network less the better of " + " and ".join(LINEAR)
    rows = [over_worlds(name, values, linear if "linear" in name else source) for name, values in gains.items()]
    return TextTable(["world", "condition", *methods], table), rows


# -- calibration -------------------------------------------------------------------------------------------------------


def four_parameters(runs: Sequence[RunDirectory]) -> tuple[TextTable, list[Row]]:
    """Median errors by world and parameter, of the network and of a constant camera, and the first in per cent."""
    table, shares = [], dict[str, list[float]]()
    for run in sorted(runs, key=world_of):
        results = run.results()
        assert results is not None
        for name, metric in PARAMETERS.items():
            network, constant = (float(results["metrics"][f"test/{metric}/{by}"]) for by in ("network", "constant"))
            table.append([str(world_of(run)), name, f"{network:.5g}", f"{constant:.5g}"])
            shares.setdefault(f"four_parameters/{name}", []).append(100 * network / constant)
    source = "replicates.csv: network of constant"
    rows = [over_worlds(name, values, source, against=100) for name, values in shares.items()]
    return TextTable(["world", "parameter", "network", "constant"], table), rows


# -- localization ------------------------------------------------------------------------------------------------------


def any_pose(runs: Sequence[RunDirectory], outputs: Path) -> tuple[TextTable, list[Row]]:
    """Errors and distances from the map in metres by world and drive, and their differences."""
    table, apart = [], dict[str, list[float]]()
    for run in sorted(runs, key=world_of):
        results = run.results()
        assert results is not None
        for drive, distance in distances(world_of(run), outputs).items():
            end = f"/{drive}/thinned_map"
            error = next(
                float(value)
                for name, value in results["metrics"].items()
                if name.startswith("test/position_error_median") and name.endswith(end)
            )
            table.append([str(world_of(run)), drive, f"{error:.4f}", f"{distance:.4f}"])
            apart.setdefault(f"any_pose/{drive}", []).append(error - distance)
    rows = [over_worlds(name, values, "replicates.csv: error - nearest", 3) for name, values in apart.items()]
    return TextTable(["world", "drive", "error", "nearest"], table), rows


def distances(world: int, outputs: Path) -> dict[str, float]:
    """The median distance in metres of each test drive's frames from the nearest pose of a map thinned to a tenth."""
    raw = to_plain(compose(["task=localization", f"dataset.world={world}", f"paths.outputs={override(outputs)}"]))
    chapter, config = chapter_of("localization"), validate(raw)
    data = chapter.data(config, chapter.source(config))
    assert isinstance(data, LocalizationDataModule)
    fault, draws = ThinnedMap(keep=0.1), np.random.default_rng(0)
    poses = data.drives.map.poses
    trees = [KDTree(poses[fault.rows(len(poses), draws), :2]) for _ in range(MAPS)]
    return {
        drive.condition: float(np.mean([np.median(tree.query(drive.poses[:, :2])[0]) for tree in trees]))
        for drive in data.drives.test
    }


if __name__ == "__main__":
    main(sys.argv[1:])
