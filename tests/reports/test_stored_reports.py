"""The stored reports in ``results``: what their tables say follows from their files, and can be read."""

import csv
import statistics
from collections import defaultdict
from pathlib import Path

import pytest
from scipy import stats

from sextant.composing.config_files import read_config_file
from sextant.evaluation import Sample, holm, share_interval_of, stratified_difference
from sextant.reports.claim_evidence import BASELINES
from sextant.reports.stored_cells import join_cells
from sextant.reports.sweep_report import write_report
from sextant.runs.outputs_folder import conf_dir

RESULTS = Path(__file__).parents[2] / "results"
REPORTS = sorted(RESULTS.glob("*/**/report.md"))
#: reports whose intervals of shares are Korn and Graubard's; those of the others are t intervals, as they say
OF_SHARES = [path.parent for path in REPORTS if "Korn and Graubard's" in path.read_text(encoding="utf-8")]
POOLED = sorted(path.parent for path in RESULTS.glob("*/**/pooled.csv"))
#: reports of which each run's values are stored
BY_SEED = sorted(path.parent for path in RESULTS.glob("*/**/seeds.csv"))
SWEEPS = {
    "butterflies": "cosfire_butterflies",
    "ablation": "calibration_ablation",
    "ablation_long": "calibration_ablation_long",
    "city": "localization_city",
    "cifar": "pushpull_cifar",
    "cifar_60": "pushpull_cifar",
    "descriptors": "localization_descriptors",
    "descriptors_interpolated": "localization_descriptors",
    "features": "localization_features",
    "few_lines": "calibration_few_lines",
    "recovery_worlds": "recovery",
    "restarts_worlds": "recovery",
    "gp_approximation_support": "gp_approximation",
    "gp_approximation_fresh": "gp_approximation_fresh",
    "lenet_19": "pushpull_lenet_19",
    "lenet_fresh": "pushpull_lenet_fresh",
    "loss": "place_loss",
    "mining": "place_mining",
    "mnist": "cosfire_mnist",
    "mnist_full": "cosfire_mnist_full",
    "nordland": "localization_nordland",
    "placement": "pushpull_placement",
    "places": "cosfire_places",
    "push_pull": "pushpull_lenet",
    "strength": "pushpull_strength",
    "weather": "place_weather",
}


def rows_of(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def sweep_of(folder):
    """The config of the sweep whose results a folder holds."""
    return read_config_file(conf_dir() / "sweep" / f"{SWEEPS.get(folder.name, folder.name)}.yaml")["sweep"]


def named(paths):
    return pytest.mark.parametrize("folder", paths, ids=lambda path: path.relative_to(RESULTS).as_posix())


@named([path.parent for path in REPORTS if (path.parent / "cells.csv").exists()])
def test_no_share_leaves_its_range_and_no_table_has_too_many_columns(folder):
    text = (folder / "report.md").read_text(encoding="utf-8")
    assert max(line.count("|") - 1 for line in text.splitlines() if line.startswith("| ---")) <= 15
    if folder.parent.name != "calibration":
        ends = [float(row[end]) for row in rows_of(folder / "cells.csv") for end in ("low", "high")]
        assert all(end != end or 0 <= end <= 100 for end in ends)


@named(sorted(path.parent for path in RESULTS.glob("*/**/tasks.csv")))
def test_figures_and_losses_of_tasks_follow_from_the_values_of_each_run(folder):
    runs = defaultdict(dict)
    for row in rows_of(folder / "task_seeds.csv"):
        runs[row["task"], row["corruption"]][row["seed"]] = float(row["value"])
    rows = rows_of(folder / "tasks.csv")
    assert len(rows) == len(runs) > 0
    for row in rows:
        values, clean = runs[row["task"], row["corruption"]], runs[row["task"], "clean"]
        assert statistics.fmean(values.values()) == pytest.approx(float(row["mean"]))
        sign = 1 if row["better"] == "higher" else -1
        losses = [100 * sign * (clean[seed] - value) / clean[seed] for seed, value in values.items()]
        assert statistics.fmean(losses) == pytest.approx(float(row["loss"]), abs=1e-9)


@named(OF_SHARES)
def test_intervals_of_shares_follow_from_the_cells(folder):
    for row in rows_of(folder / "cells.csv"):
        if float(row["spread"]):
            low, high = share_interval_of(float(row["mean"]) / 100, float(row["spread"]) / 100, int(row["seeds"]))
            assert (float(row["low"]), float(row["high"])) == pytest.approx((100 * low, 100 * high), nan_ok=True)


@named(BY_SEED)
def test_cells_and_contrasts_follow_from_the_values_of_each_run(folder):
    runs = defaultdict(dict)
    for row in rows_of(folder / "seeds.csv"):
        if row["outcome"] == "finished":
            runs[row["setting"], row["arm"], row["condition"]][row["pair"]] = float(row["value"])
    for row in rows_of(folder / "cells.csv"):
        values = list(runs[row["setting"], row["arm"], row["condition"]].values())
        assert len(values) == int(row["seeds"])
        assert not values or statistics.fmean(values) == pytest.approx(float(row["mean"]), abs=1e-9)
    sweep = sweep_of(folder)
    for row in rows_of(folder / "contrasts.csv"):
        arms = sweep["contrasts"][row["contrast"]]
        treated, control = (runs[row["setting"], arms[side], row["condition"]] for side in ("treatment", "control"))
        pairs = [treated[pair] - control[pair] for pair in treated if pair in control]
        assert len(pairs) == int(row["seeds"] or 0)
        if len(pairs) > 1:
            found = statistics.fmean(pairs), statistics.stdev(pairs)
            assert found == pytest.approx((float(row["mean"]), float(row["spread"])), abs=1e-9)


@named(POOLED)
def test_pooled_controls_follow_from_the_cells(folder):
    rows = rows_of(folder / "cells.csv")
    cell = {
        (r["setting"], r["arm"], r["condition"]): Sample(int(r["seeds"]), float(r["mean"]), float(r["spread"]))
        for r in rows
    }
    sweep = sweep_of(folder)
    floor = sweep["contrasts"][sweep["noise_floor"]]
    settings = list(dict.fromkeys(row["setting"] for row in rows if row["arm"] == floor["treatment"]))
    for row in rows_of(folder / "pooled.csv"):
        within = settings if row["setting"] == "together" else [row["setting"]]
        at, treatment = row["condition"], sweep["contrasts"][row["contrast"]]["treatment"]
        control = {s: cell[s, floor["control"], at].joined(cell[s, floor["treatment"], at]) for s in within}
        found = stratified_difference([(cell[s, treatment, at], control[s]) for s in within], largest=100)
        assert (found.mean, found.low, found.high) == pytest.approx([float(row[k]) for k in ("mean", "low", "high")])
        assert found.p_value == pytest.approx(float(row["p_value"]))


def test_what_is_certain_of_19_corruptions_holds_under_holm():
    rows = [row for row in rows_of(RESULTS / "push_pull/cifar/corruption_contrasts.csv") if row["corruption"] != "mean"]
    raw = []
    for row in rows:
        difference, low, high = (float(row[key]) for key in ("difference", "low", "high"))
        pairs = int(row["pairs"])
        error = (high - low) / 2 / stats.t.ppf(0.975, pairs - 1)
        raw.append(2 * stats.t.sf(abs(difference) / error, pairs - 1))
    corrected = holm(raw)
    assert corrected == pytest.approx([float(row["p_holm"]) for row in rows])
    kept = [float(row["difference"]) for row, p in zip(rows, corrected, strict=True) if p < 0.05]
    certain = [row for row in rows if float(row["low"]) > 0 or float(row["high"]) < 0]
    assert (sum(d < 0 for d in kept), sum(d > 0 for d in kept), len(certain)) == (10, 5, 17)


def test_constants_beside_a_stored_report_are_the_means_over_its_runs():
    folder = RESULTS / "calibration/ablation_long"
    cells = [(cell.cell.setting, cell.metrics) for cell in join_cells([folder / "cells"], folder).cells]
    for row in rows_of(folder / BASELINES):
        name = row["condition"].replace(" (", "_").rstrip(")")
        values = [metrics[f"test/{name}/constant"] for setting, metrics in cells if setting == row["setting"]]
        assert len(values) == 64
        assert float(row["value"]) == pytest.approx(statistics.fmean(values), abs=1e-4)


@pytest.mark.slow
@named(sorted(path.parents[1] for path in RESULTS.glob("*/**/cells/block.json")))
def test_a_stored_report_is_made_again_from_its_cells_byte_for_byte(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("sextant.figures.style.save_figure", lambda *_, **__: [])
    report = write_report(join_cells([folder / "cells"], tmp_path))[0].parent
    for path in set(folder.glob("*.csv")) - {folder / BASELINES}:
        assert (report / path.name).read_bytes() == path.read_bytes(), path.name
    made = (report / "report.md").read_text(encoding="utf-8").replace(f" outputs={tmp_path}", "")
    assert made == (folder / "report.md").read_text(encoding="utf-8")
