"""The map of an office that comes with the package: a robot of that office is found in it, and a command takes it."""

import csv

import numpy as np
import pytest
from PIL import Image

from sextant import Localizer, cli
from sextant.chapters.localization.data.drive import motions_along
from sextant.config import validate
from sextant.kit.assemble import build_dataset
from sextant.zoo import model_file, read_card

FRAMES = 24
NIGHT = 2  # of the drives: the map's, then each of two by day, by night and with furniture moved


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Pictures of a stretch by night, and the poses they were taken at."""
    config = read_card(model_file("zoo:office"))["model"]["config"]
    folder = str(tmp_path_factory.mktemp("office"))
    plan = build_dataset(validate({**config, "paths": {**config["paths"], "cache": folder}})).plan()
    start = int((plan.columns["run"] == NIGHT).argmax())
    return plan.render(start, start + FRAMES)["images"], plan.shots.pose[start : start + FRAMES][:, [0, 1, 3]]


def test_a_robot_is_found_by_night(drive):
    pictures, poses = drive
    localizer = Localizer.load("zoo:office", start="appearance", particles=500)
    assert localizer.image_size == pictures.shape[1:]
    for picture, motion in zip(pictures, motions_along(poses), strict=True):
        found = localizer.step(motion, picture)
    assert np.hypot(*(found.pose[:2] - poses[-1, :2])) < 0.5
    assert not found.lost


def test_a_command_takes_it_for_a_run(drive, tmp_path):
    for number, picture in enumerate(drive[0][:4]):
        Image.fromarray(picture).save(tmp_path / f"{number}.png")
    cli.run("predict", ["run=zoo:office", f"input={tmp_path}", f"output={tmp_path / 'found'}", "start=appearance"])
    assert len(list(csv.DictReader((tmp_path / "found" / "poses.csv").open()))) == 4
