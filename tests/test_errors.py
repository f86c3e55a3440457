import pickle

import numpy as np
import pytest

from sextant.config.building import build, naming_groups
from sextant.data.source import MissingDataError
from sextant.errors import ArgumentError, UserError, one_line, shown
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.observation import LocalGP
from sextant.localization.pose_kernel import PoseKernel


def test_a_mistake_survives_the_way_back_from_a_worker_process():
    error = pickle.loads(pickle.dumps(MissingDataError("no such folder", "make one")))
    assert isinstance(error, MissingDataError)
    assert (error.problem, error.fix, str(error)) == ("no such folder", "make one", "no such folder\nmake one")


def test_a_wrong_argument_survives_it_too_and_keeps_its_part():
    error = pickle.loads(pickle.dumps(ArgumentError("top=0 must be at least 1", "top=1", of="TopKInjection")))
    assert (error.problem, error.fix, error.of) == ("top=0 must be at least 1", "top=1", "TopKInjection")


def test_the_parts_of_a_message_are_apart_on_one_line():
    assert one_line("a.jpg is empty (0 bytes)\nCopy it again.") == "a.jpg is empty (0 bytes). Copy it again."
    listed = "b.csv: 2 rows cannot be used\n  line 4: x=nan\n  line 9: y=nan"
    assert one_line(listed) == "b.csv: 2 rows cannot be used: line 4: x=nan; line 9: y=nan"
    assert one_line("one\n\n") == "one"
    assert one_line("") == ""
    assert one_line("a is steep\nName the axis\nof the pose.") == "a is steep. Name the axis of the pose."


@pytest.mark.parametrize(
    ("value", "said"),
    [((1, 0, "a"), "(1, 0, 'a')"), (np.zeros(2), "[0. 0.]"), (np.zeros((2, 4)), "an array of the shape (2, 4)")],
)
def test_a_large_array_is_shown_by_its_shape(value, said):
    assert shown(value) == said


def test_arguments_become_keys_of_their_group_and_nothing_else_does():
    error = ArgumentError("top=0 must be at least 1 (stop=0, a.top=3)", "For example top=10").within(
        "recovery", ["top"]
    )
    assert type(error) is UserError
    assert error.problem == "recovery.top=0 must be at least 1 (stop=0, a.top=3)"
    assert error.fix == "For example recovery.top=10"


def test_what_is_built_of_a_config_is_refused_in_its_terms():
    raw = {"loss": {"_target_": "sextant.losses.ContrastiveLoss", "margin": -1.0}}
    with pytest.raises(UserError, match=r"^loss\.margin=-1\.0 must be above 0\nFor example loss\.margin=0\.5$"):
        build(raw, "loss")


def test_a_model_that_does_not_fit_its_map_is_refused_in_its_terms():
    import torch

    poses = torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], dtype=torch.float64)
    small = DescriptorMap.of(poses, torch.eye(2))
    raw = {"seed": 0, "observation": {"_target_": "sextant.localization.observation.LocalGP", "neighbours": 3}}
    with pytest.raises(UserError, match=r"^observation\.neighbours=3 must be in \[1, 2\]"), naming_groups(raw):
        LocalGP(3).fit(small, PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.1))


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (
            ArgumentError("folder: no such folder", "folder=/path"),
            "dataset.folder: no such folder\ndataset.folder=/path",
        ),
        (ArgumentError("frames.val=[4, 3] is empty"), "dataset.frames.val=[4, 3] is empty"),
        (ArgumentError("folder.day-left: no images"), "dataset.folder.day-left: no images"),
        (ArgumentError("frames.val is null"), "dataset.frames.val is null"),
        (MissingDataError("a folder holds no frames"), "a folder holds no frames"),
        (ArgumentError("near_map=3: no frames", of="DriveSettings"), "task.near_map=3: no frames"),
    ],
)
def test_what_no_part_is_named_for_is_of_the_dataset_and_settings_are_of_the_task(error, said):
    raw = {"dataset": {"_target_": "a.Folder", "folder": "x", "frames": {}}, "task": {"name": "t", "near_map": 3}}
    with pytest.raises(UserError) as caught, naming_groups(raw):
        raise error
    assert str(caught.value) == said


def test_a_part_without_keys_names_none():
    assert ArgumentError("top=0 is too small", "top=1").named({}).problem == "top=0 is too small"
