"""Drives are cut to where there is a map."""

import math

import numpy as np
import pytest

from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.localization.data.office_drives import along_map, longest_along_map
from sextant.errors import UserError

MAPPED = Drive.of("map", "summer", np.column_stack([np.arange(0, 10.0), np.zeros(10), np.zeros(10)]))


def drive(x, y=0.0, heading=0.0):
    x = np.asarray(x, float)
    poses = np.column_stack([x, np.full(len(x), y), np.full(len(x), heading)])
    motion = np.vstack([np.zeros(3), np.column_stack([np.diff(x), np.zeros((len(x) - 1, 2))])])
    return Drive.of("run", "summer", poses, motion=motion)


def test_frames_are_along_the_map_by_distance_and_heading():
    assert along_map(drive([-2, 0.4, 5, 9.4, 12]), MAPPED, 0.5).tolist() == [False, True, True, True, False]
    assert not along_map(drive([0.0, 5.0], y=0.6), MAPPED, 0.5).any()
    for degrees, along in ((44, True), (-44, True), (46, False), (180, False), (-316 - 360, True)):
        assert along_map(drive([3.0], heading=math.radians(degrees)), MAPPED, 0.5).item() is along


def test_the_longest_stretch_is_a_drive_of_its_own():
    x = [0, 1, 50, 51, 2, 3, 4, 5, 60, 8]
    cut = longest_along_map(drive(x), MAPPED, 0.5)
    assert cut.poses[:, 0].tolist() == [2, 3, 4, 5]
    assert cut.frames.tolist() == [0, 1, 2, 3]
    assert cut.motion[:, 0].tolist() == [0, 1, 1, 1]  # how it came to the first no longer matters


@pytest.mark.parametrize("x", [[40, 50], [0, 40, 1, 40]])
def test_a_drive_that_never_follows_the_map_is_told(x):
    with pytest.raises(UserError, match=r"near_map=0\.5: drive run"):
        longest_along_map(drive(x), MAPPED, 0.5)
