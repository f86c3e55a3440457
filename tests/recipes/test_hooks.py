"""What a chapter says of its runs: what identifies one, what it measures, whose answers it keeps."""

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from sextant.chapters.calibration.measure import CALIBRATION, CALIBRATION_ERRORS
from sextant.chapters.cosfire.measure import RECOGNITION
from sextant.chapters.localization.measure import SUCCESS
from sextant.chapters.places.measure import RECALL
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.kit.measure import ACCURACY
from sextant.registry import CHAPTERS, chapter_of

RIGHT = np.array([1.0, 1.0, 0.0, 1.0])
LABELS = np.array([0, 1, 2, 3])
ANSWERS = np.where(RIGHT == 1, LABELS, 9)
#: arrays of a run, what its chapter counts, and of which conditions
RUNS = {
    "classification": ({"labels": LABELS, "clean": ANSWERS, "fog/3": LABELS}, ACCURACY, {"clean": 75, "fog/3": 100}),
    "calibration": (
        {f"{key}/{by}": RIGHT + k for k, key in enumerate(CALIBRATION_ERRORS) for by in ("network", "constant")},
        CALIBRATION,
        {title: 1 + k for k, title in enumerate(CALIBRATION_ERRORS.values())},
    ),
    "place_recognition": (
        {"R@1_pm1f_a_to_b/network": RIGHT, "R@1_sequence_pm1f_a_to_b/network": RIGHT, "R@1_pm1f_a_to_b/grey": RIGHT},
        RECALL,
        {"R@1_pm1f_a_to_b": 75},
    ),
    "localization": ({"success/day": RIGHT, "converged/day": RIGHT}, SUCCESS, {"day": 75}),
    "cosfire": ({"labels": LABELS, "answer/nearest": ANSWERS, "answer/network": LABELS}, RECOGNITION,
                {"nearest": 75, "network": 100}),
}  # fmt: skip


def config_of(*overrides):
    return validate(to_plain(compose(overrides)))


@pytest.mark.parametrize("task", CHAPTERS)
def test_a_recipe_counts_what_its_task_is_about(task):
    arrays, measure, expected = RUNS[task]
    found = chapter_of(task).measured(arrays)
    assert found.measure is measure
    assert {name: measure.of(values) for name, values in found.by_condition.items()} == expected


def test_the_method_that_is_read_is_counted_by_condition():
    arrays = RUNS["cosfire"][0] | {"condition/night": LABELS > 1, "condition/day": LABELS < 2}
    found = chapter_of("cosfire").measured(arrays, reads="nearest")
    assert {name: values.mean() for name, values in found.by_condition.items()} == {"night": 50, "day": 100}


@pytest.mark.parametrize("task", CHAPTERS)
def test_only_runs_of_several_methods_keep_answers_apart(task):
    config = config_of(f"task={task}")
    answers = chapter_of(task).answers(config)
    assert bool(answers) == (task in ("cosfire", "calibration"))
    if task == "calibration":
        lean = chapter_of(task).answers(config_of("task=calibration", "task.geometric_baselines=false"))
        assert lean == ["network", "constant", "prior"] == answers[:3] != answers
    elif answers:
        assert set(chapter_of(task).answers(config_of("task=cosfire", "task.novel_classes=2"))) == {*answers} - {
            "network"
        }


@pytest.mark.parametrize("task", ["localization", "cosfire"])
def test_a_run_is_identified_by_what_its_files_hold(task, tmp_path):
    def identity(folder, value):
        (tmp_path / folder).mkdir(exist_ok=True)
        np.save(tmp_path / folder / "drive.npy", np.full((3, 2), value, np.float32))
        config = config_of(f"task={task}", "descriptor=files", f"descriptor.folder={tmp_path / folder}")
        return chapter_of(task).identity(config)

    first, moved, other = identity("a", 1), identity("b", 1), identity("a", 2)
    assert first == moved != other
    assert str(tmp_path) not in str(first["descriptor"])


@pytest.mark.parametrize("task", CHAPTERS)
def test_a_search_looks_at_what_chooses_the_checkpoints(task):
    folder = Path(import_module(CHAPTERS[task]).__file__).parent
    chosen = re.findall(
        r'monitor, monitor_mode = "(.+)", "(.+)"', "".join(path.read_text() for path in folder.glob("*.py"))
    )
    assert set(chosen) == {chapter_of(task).monitor}
