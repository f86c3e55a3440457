"""Every YAML file composes, is legal, and what it describes can be built."""

import numpy as np
import pytest
import torch
from frozen import freeze
from needed import CHOICES, LOCALIZATION, NEEDED, PLACE_LOSSES, words

from sextant.chapters.cosfire.parts import check_parts
from sextant.chapters.localization.data.faults import Fault
from sextant.chapters.places.backbone_layer import backbone_layer
from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import groups
from sextant.config import validate
from sextant.config.building import build
from sextant.errors import UserError
from sextant.geometry import Parameterization, ParameterSpace
from sextant.kit.assemble import build_dataset
from sextant.lifecycle.search.design import read_search
from sextant.lifecycle.sweep_plan import cell_config, read_design
from sextant.runs.outputs_folder import conf_dir
from sextant.worlds.laser import LaserScanner
from sextant.worlds.occupancy import occupancy_from_scans

NAMES = {"panorama_mix": "town_panoramas+panorama_folder", "cold": "office_walk"}
NOT_BUILT = {
    "trainer",
    "local",
    "debug",
    "tracking",
    "launcher",
    "paths",
    "task",
    "experiment",
    "sweep",
    "kernel",
    "likelihood",
    "filter",
    "features",
    "filters",
}
SCANNER = LaserScanner(beams=60, field_of_view_rad=3.14, max_range_m=15.0, range_sigma_m=0.02, dropout=0.0)
GRID = occupancy_from_scans(SCANNER, np.zeros((1, 3)), np.full((1, 60), 2.0), 0.25)
CONFIGS = freeze.read("configs.json.gz")


def test_there_are_configs():
    assert len(CHOICES) > 25
    assert {group for group, _ in CHOICES} >= {"task", "dataset", "corruption", "backbone", "inhibition", "sweep"}


@pytest.mark.parametrize(("group", "option"), CHOICES)
def test_composes_validates_and_builds(group, option):
    choice = f"{group}={option}"
    raw = to_plain(compose([*words(group, option), *freeze.FOLDERS]))
    if group != "sweep" and choice in CONFIGS:
        assert freeze.kept(raw) == CONFIGS[choice]["config"], "if it is meant: python tests/frozen/freeze.py"
    config = validate(raw)
    assert config.custom_targets() == []
    if group == "dataset":
        assert build_dataset(config).name == NAMES.get(option, option)
    elif group == "backbone":
        assert build(raw, group, in_channels=3, image_size=(72, 96), num_classes=10) is not None
    elif choice in ("bank=channels", "bank=vectors"):
        assert build(raw, group, features=torch.nn.Identity(), size=4).size == 4
    elif group == "pooling":
        assert build(raw, group, channels=16, size=(8, 12)) is not None
    elif group == "loss" and option not in PLACE_LOSSES:
        low, high = torch.tensor([-0.5, -0.5, 0.5, -1.0]), torch.tensor([0.5, 0.5, 1.5, 0.0])
        assert build(raw, group, space=ParameterSpace(Parameterization(), low, high)) is not None
    elif group == "faults":
        assert all(isinstance(build(raw["faults"]["faults"], name), Fault) for name in raw["faults"]["faults"])
    elif choice in ("observation=laser_field", "observation=laser_beam"):
        assert build(raw, group, grid=GRID, scanner=SCANNER, tempering=0.5).tempering == 0.5
    elif choice == "descriptor=network":
        assert backbone_layer(raw).grid == (4, 6)
    elif choice == "motion=spacing":
        assert build(raw, group, spacing=2.0).if_unknown()[0] == 4.0
    elif choice == "corruption=files":
        with pytest.raises(UserError, match=r"has no labels\.npy"):
            build(raw, group)
    elif group not in NOT_BUILT:
        assert build(raw, group) is not None


@pytest.mark.slow
@pytest.mark.parametrize("option", [name for name in groups()["sweep"] if name.startswith("cosfire")])
def test_every_arm_of_a_sweep_of_filters_has_what_its_methods_need(option):
    """That each arm and each value of any sweep composes and validates, ``tests/frozen`` shows."""
    design = read_design([f"sweep={option}", *NEEDED.get(f"sweep={option}", [])])
    for arm in design.arms:
        config = cell_config(design, {key: values[0] for key, values in design.factors.items()}, arm)[1]
        check_parts(config, config.task)


@pytest.mark.parametrize("option", [name for name in groups()["sweep"] if name.startswith("search_")])
def test_a_stored_search_is_right_in_the_middle_and_at_the_ends_of_its_space(option):
    design, config = read_search([f"sweep={option}"])
    assert len(design.space) >= 2
    assert len(design.seeds) >= 3
    assert config.sweep.name == design.name == option


def test_every_chapter_has_a_search():
    searches = [name for name in groups()["sweep"] if name.startswith("search_")]
    assert {compose([f"sweep={name}"]).task.name for name in searches} == set(groups()["task"])


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


PARAMETERIZATIONS = groups()["parameterization"]
CAMERA_LOSSES = [option for option in groups()["loss"] if option not in PLACE_LOSSES]


@pytest.fixture(scope="module")
def parts():
    """What each option of a group composes to in a config of calibration, and one such config."""
    options = {"parameterization": PARAMETERIZATIONS, "loss": CAMERA_LOSSES, "sampling": groups()["sampling"]}
    found = {
        (group, option): to_plain(compose(["task=calibration", f"{group}={option}"]))
        for group, names in options.items()
        for option in names
    }
    return {choice: raw[choice[0]] for choice, raw in found.items()}, next(iter(found.values()))


@pytest.mark.parametrize("parameterization", PARAMETERIZATIONS)
@pytest.mark.parametrize("loss", CAMERA_LOSSES)
@pytest.mark.parametrize("sampling", groups()["sampling"])
def test_every_parameterization_goes_with_every_loss_and_every_sampling(parts, parameterization, loss, sampling):
    found, usual = parts
    chosen = {"parameterization": parameterization, "loss": loss, "sampling": sampling}
    raw = usual | {group: found[group, option] for group, option in chosen.items()}
    validate(raw)
    cameras = build(raw, "sampling").draw(64, 0).cameras
    space = ParameterSpace.covering(build(raw, "parameterization"), cameras)
    values = space.parameterization.encode(cameras)
    off = space.from_unit((space.to_unit(values) + 0.1).clamp(0, 1)).float()
    loss_of, aspect = build(raw, "loss", space=space), torch.full((64,), 4 / 3)
    error, least = (loss_of(said, values.float(), aspect) for said in (off, values.float()))
    assert error.isfinite().all()
    assert error.mean() > least.mean()  # not 0: learned weights give the truth a negative loss
    assert (least >= 0).all() or loss == "l2_learned"


@pytest.mark.slow
def test_groups_of_calibration_do_nothing_elsewhere():
    with pytest.raises(UserError, match="loss belongs to task=calibration"):
        validate(to_plain(compose(["task=classification", "loss=l2_range"])))
    with pytest.raises(UserError, match="augmentation belongs to task=classification"):
        validate(to_plain(compose(["task=calibration", "augmentation=standard"])))


@pytest.mark.parametrize("group", LOCALIZATION)
def test_groups_of_localization_do_nothing_elsewhere(group):
    option = groups()[group][-1]
    needed = [each for each in NEEDED.get(f"{group}={option}", []) if not each.startswith("task=")]
    with pytest.raises(UserError, match=f"{group} belongs to task=localization"):
        validate(to_plain(compose(["task=classification", f"{group}={option}", *needed])))


def test_a_test_distribution_of_its_own():
    raw = to_plain(compose(["task=calibration", "sampling@test_sampling=uniform"]))
    assert validate(raw).test_sampling is not None
    assert raw["sampling"]["name"] == "lopez_4x3"
