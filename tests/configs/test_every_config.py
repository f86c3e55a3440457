"""Every YAML file composes, is legal, and what it describes can be built."""

import pytest

from sextant.cli.assemble import build, build_dataset
from sextant.cli.compose import compose, conf_dir, groups, to_plain
from sextant.config import validate

NEEDED = {
    "dataset=image_folder": ["dataset.folder=/nowhere"],
    "tracking=server": ["tracking.uri=http://127.0.0.1:1"],
}
NOT_BUILT = {"trainer", "tracking", "paths", "task", "experiment", "sweep"}
CHOICES = [(group, option) for group, options in groups().items() for option in options]


def test_there_are_configs():
    assert len(CHOICES) > 25
    assert {group for group, _ in CHOICES} >= {"task", "dataset", "corruption", "backbone", "inhibition", "sweep"}


@pytest.mark.parametrize(("group", "option"), CHOICES)
def test_composes_validates_and_builds(group, option):
    choice = f"{group}={option}"
    raw = to_plain(compose([choice, *NEEDED.get(choice, [])]))
    config = validate(raw)
    if group == "dataset":
        assert build_dataset(raw, config).name == option
    elif group == "backbone":
        assert build(raw, group, in_channels=1, image_size=(28, 28), num_classes=10) is not None
    elif group not in NOT_BUILT:
        assert build(raw, group) is not None


@pytest.mark.parametrize(("group", "option"), CHOICES)
def test_says_in_its_first_lines_what_it_is(group, option):
    if group == "paths":
        return
    head = (conf_dir() / group / f"{option}.yaml").read_text().splitlines()[:2]
    assert any(line.startswith("# ") and "@package" not in line for line in head)


def test_the_command_line_wins_over_task_experiment_and_sweep():
    raw = to_plain(compose(["task=classification", "experiment=lenet_mnist", "dataset=digits", "trainer.max_epochs=3"]))
    assert raw["dataset"]["_target_"] == "sextant.data.digits.Digits"
    assert raw["trainer"]["max_epochs"] == 3


def test_the_experiment_wins_over_the_task():
    raw = to_plain(compose(["experiment=lenet_mnist"]))
    assert raw["dataset"]["_target_"] == "sextant.data.mnist.MNIST"
    assert raw["optimizer"]["lr"] == 0.1
    assert raw["trainer"] | {"max_epochs": 12, "batch_size": 128} == raw["trainer"]


def test_a_sweep_brings_its_experiment():
    raw = to_plain(compose(["sweep=pushpull_lenet"]))
    assert raw["dataset"]["_target_"] == "sextant.data.mnist.MNIST"
    assert validate(raw).sweep.seeds == list(range(10))
