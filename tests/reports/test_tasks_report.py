"""The report of a sweep over tasks, and of classifiers' confidence, with figures worked out by hand."""

import csv

import numpy as np
import pytest
from made_up_sweep import predictions

from sextant.atomic_files import write_json
from sextant.chapters.cosfire.measure import recognised
from sextant.chapters.localization.measure import localized
from sextant.evaluation.headline import Headline, relative_loss
from sextant.kit.measure import classified
from sextant.lifecycle.results import sweep_results
from sextant.reports.confidence_report import confidence_section
from sextant.reports.page.report_page import write_report_page
from sextant.reports.sweep_report import write_report
from sextant.reports.tasks_report import loss_table, of_several_tasks, overview_table, task_rows
from sextant.runs.directory import RunDirectory
from sextant.runs.sweep_directory import Cell, SweepPlan

ACCURACY = Headline("accuracy", "%", "higher", {"clean": 0.8, "fog/1": 0.6, "fog/3": 0.2, "contrast/3": 0.8})
BEARING = Headline("bearing error (deg)", "", "lower", {"clean": 4.0, "fog/3": 12.0, "contrast/3": 4.0})
SUCCESS = Headline("success", "%", "higher", {"clean": 0.0, "fog/3": 0.0, "contrast/3": 0.0})


def made_up(folder, runs):
    """A sweep with one run for each (arm, task, seed) and its headline; None is a run that has not been made."""
    cells = []
    for number, (arm, task, seed, headline) in enumerate(runs):
        directory = RunDirectory(folder / "runs" / task / f"{number:08x}-s{seed}")
        cells.append(Cell({}, arm, seed, seed, arm, directory.path.relative_to(folder).as_posix()))
        if headline is None:
            continue
        directory.path.mkdir(parents=True)
        arrays = {"success/day": np.ones(4)} if task == "localization" else predictions({"clean": 2})
        if task == "calibration":
            names = ("bearing_deg", "tilt_deg", "roll_deg", "vfov_deg", "k1", "k1_hat", "undistortion_px")
            arrays = {f"{name}/network": np.ones(4) for name in names}
        np.savez_compressed(directory.arrays, **arrays)
        facts = headline.facts(test="clean, cifar10_c", image_size=[24, 32])
        told = {"outcome": "finished", "metrics": headline.metrics(), "parameters": 1, "timing": {"fit_s": 1.0}}
        write_json(directory.metrics, told | facts)
    plan = SweepPlan("all", {"question": "What is lost?"}, ["sweep=all"], cells)
    return sweep_results(plan.write(folder))


@pytest.fixture
def sweep(tmp_path):
    better = Headline("accuracy", "%", "higher", {"clean": 1.0, "fog/1": 0.5, "fog/3": 0.5, "contrast/3": 1.0})
    runs = [("digits", "classification", 0, ACCURACY), ("digits", "classification", 1, better)]
    runs += [("camera", "calibration", seed, BEARING) for seed in (0, 1)]
    runs += [("robot", "localization", 0, SUCCESS), ("robot", "localization", 1, None)]
    return made_up(tmp_path, runs)


def test_each_task_has_a_row_with_its_own_figure_and_what_it_loses(sweep):
    assert of_several_tasks(sweep)
    digits, camera, robot = task_rows(sweep)
    assert (digits.title, camera.title) == ("accuracy, %", "bearing error (deg)")
    assert digits.values["fog"] == pytest.approx([0.4, 0.5])  # the mean over severities
    assert digits.losses("fog") == pytest.approx([50, 50])
    assert digits.losses("corrupted") == pytest.approx([25, 25])
    assert camera.losses("fog") == pytest.approx([200, 200])  # an error may grow by more than itself
    assert robot.losses("fog") == []  # of nothing, nothing can be lost
    rows = {row[0]: row for row in overview_table([digits, camera, robot]).rows}
    assert rows["digits"][2:5] == ["32x24", "2 of 2", "90.00 [-37.06, 217.06]"]
    assert rows["camera"][-1] == "fog (200 %)"
    assert rows["robot"][3] == "1 of 2"
    assert loss_table([digits, camera]).rows[-1] == ["**mean**", "**25.0**", "**100.0**"]


def test_the_report_has_a_table_files_and_a_heat_map(sweep):
    paths = {path.name: path for path in write_report(sweep)}
    assert {"report.md", "tasks.csv", "task_seeds.csv", "tasks.tex", "task_corruption_loss.png"} <= set(paths)
    text = paths["report.md"].read_text()
    assert "5 finished, 0 diverged, 0 failed, 1 missing" in text
    assert "| digits | accuracy, % | 32x24 | 2 of 2 |" in text
    page = write_report_page(sweep, sweep.directory / "page").read_text()
    assert "data:image/png;base64" in page
    assert "bearing error (deg)" in page
    rows = list(csv.DictReader(paths["tasks.csv"].open()))
    (fog,) = [row for row in rows if (row["task"], row["corruption"]) == ("camera", "fog")]
    assert (float(fog["mean"]), float(fog["loss"])) == pytest.approx((12.0, 200.0))


def test_a_sweep_of_one_task_is_reported_as_ever(tmp_path):
    results = made_up(tmp_path, [("a", "classification", seed, ACCURACY) for seed in (0, 1)])
    assert not of_several_tasks(results)
    assert "cells.csv" in {path.name for path in write_report(results)}


def test_runs_without_headlines_are_told_as_such(tmp_path):
    old = Headline("accuracy", "%", "higher", {"clean": 0.5})
    results = made_up(tmp_path, [("a", "classification", 0, old), ("b", "localization", 0, SUCCESS)])
    row = task_rows(results)[0]
    assert (list(row.seeds), row.planned, row.corruptions) == ([], 1, [])
    write_report(results)


@pytest.mark.parametrize(
    ("clean", "value", "better", "loss"),
    [
        (0.8, 0.8, "higher", 0),
        (0.8, 0, "higher", 1),
        (0.5, 1, "higher", -1),
        (2, 5, "lower", 1.5),
        (2, 1, "lower", -0.5),
    ],
)
def test_the_loss_is_a_share_of_the_clean_figure(clean, value, better, loss):
    assert relative_loss(clean, value, better) == pytest.approx(loss)


def test_a_headline_needs_a_clean_figure_and_says_nothing_without_corruptions():
    with pytest.raises(ValueError, match="clean"):
        Headline("accuracy", "%", "higher", {"fog/3": 0.5})
    alone = Headline("accuracy", "%", "higher", {"clean": 0.5})
    assert (alone.metrics(), alone.facts()) == ({}, {})
    assert "test/headline/relative_loss" not in SUCCESS.metrics()  # of nothing


# -- several conditions of one task ------------------------------------------------------------------------------------


def test_corrupted_drives_and_answers_are_averaged_over_severities_then_corruptions():
    arrays = {"success/day": np.array([1.0, 1.0]), "success/run2": np.ones(2)}
    arrays |= {"corrupted/day/fog/1": np.array([1.0, 0.0]), "corrupted/day/fog/3": np.zeros(2)}
    arrays |= {"corrupted/day/contrast/3": np.ones(2), "corrupted/run2/night/fog/3": np.zeros(2)}
    found = localized(arrays).by_condition
    np.testing.assert_allclose(found["day, corrupted"], [75, 50])
    assert "run2, corrupted" not in found  # what was corrupted is run2/night
    labels = np.array([0, 1])
    answers = {"labels": labels, "answer/svm": labels, "corrupted/svm/fog/3": 1 - labels, "condition/dusk": labels > 0}
    assert recognised(answers).by_condition["svm, corrupted"].tolist() == [0, 0]
    assert recognised(answers, "svm").by_condition["dusk, corrupted"].tolist() == [0]
    assert list(recognised({"labels": labels, "answer/svm": labels}).by_condition) == ["svm"]


def test_confidences_are_no_conditions_and_are_checked_against_the_metrics():
    arrays = predictions({"clean": 5})
    arrays |= {"confidence/clean": np.full(20, 0.9, np.float32), "nll/clean": np.full(20, 0.5, np.float32)}
    found = classified(arrays)
    assert list(found.by_condition) == ["clean"]
    assert found.metrics["test/ece/clean"] == pytest.approx(0.15)
    assert found.metrics["test/nll/clean"] == pytest.approx(0.5)


def test_confidence_has_a_section_clean_and_by_corruption_and_older_runs_none(tmp_path):
    told = {"test/ece/clean": 0.02, "test/ece/fog/1": 0.1, "test/ece/fog/3": 0.3, "test/ece/contrast/3": 0.4}
    told |= {name.replace("ece", "nll"): 10 * value for name, value in told.items()}

    def run(pair, arm, metrics):
        directory = RunDirectory(tmp_path / "runs" / "classification" / f"{arm}-{pair}")
        directory.path.mkdir(parents=True)
        np.savez_compressed(directory.arrays, **predictions({"clean": 2, "fog/1": 3, "fog/3": 4, "contrast/3": 5}))
        write_json(
            directory.metrics, {"outcome": "finished", "metrics": metrics, "parameters": 1, "timing": {"fit_s": 1.0}}
        )
        return Cell({}, arm, pair, pair, arm, directory.path.relative_to(tmp_path).as_posix())

    cells = [run(0, "new", told), run(1, "new", told), run(0, "old", {}), run(1, "old", {})]
    results = sweep_results(SweepPlan("mixed", {}, [], cells).write(tmp_path))
    section = confidence_section(results)
    rows = {
        (row["corruption"], row["figure"]): row for row in csv.DictReader(section.files["confidence.csv"].splitlines())
    }
    assert {row["arm"] for row in rows.values()} == {"new"}
    assert float(rows["corrupted", "ECE"]["mean"]) == pytest.approx((0.2 + 0.4) / 2)
    assert float(rows["fog", "NLL"]["mean"]) == pytest.approx(2.0)
    assert "15 bins of equal width" in section.text
    assert "2 converged runs without these figures" in section.text
    assert "## Confidence" in next(p for p in write_report(results) if p.name == "report.md").read_text()
    only = SweepPlan("older", {}, [], cells[2:]).write(tmp_path)
    assert confidence_section(sweep_results(only)).text == ""
