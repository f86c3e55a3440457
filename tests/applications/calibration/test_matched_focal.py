"""The focal length by matches between photos of one camera, as evidence beside their lines and the network."""

from dataclasses import replace
from typing import get_args, get_type_hints

import numpy as np
import pytest
from cli.photo_calibration.fakes import Fake

pytest.importorskip("poselib")
from correspondence.test_shared_focal import around, photos, points

import sextant.correspondence
from sextant.applications import PhotoCalibrator
from sextant.chapters.calibration.matched_focal import WHY
from sextant.correspondence import Pinhole, SharedFocalLength

FOCAL = 520.0
UNSURE = (0.02, 0.01, 0.15, 0.05)


class MadeUp:
    """Local features of a scene by the number that a picture is painted with, instead of those of its pixels."""

    name, side, model = "made up", None, "made up"

    def __init__(self, found):
        self.found, self.asked = found, []

    def detect(self, images):
        self.asked += [int(image[0, 0, 0]) for image in images]
        return [self.found[number] for number in self.asked[-len(images) :]]


def scene(count, cameras=(FOCAL, FOCAL)):
    """Features of a scene by a camera of each focal length, one group after the other."""
    rng = np.random.default_rng(0)
    world, unit = points(rng), np.linalg.qr(rng.normal(size=(400, 400)))[0]
    found = []
    for focal in cameras:
        camera = Pinhole.centred(640, 480, focal)
        found += photos(rng, around(count // len(cameras)), world, camera, descriptors=unit)
    return found


@pytest.fixture
def by(monkeypatch):
    """The camera of pictures without lines, with the features of a scene."""

    def one_camera(found, network=None, method="joint"):
        extractor = MadeUp(found)
        monkeypatch.setattr(sextant.correspondence, "XFeatures", lambda *_: extractor)
        pictures = [np.full((480, 640, 3), number, np.uint8) for number in range(100, 100 + len(found))]
        extractor.found = dict(enumerate(found, 100))
        return PhotoCalibrator(network or Fake(scale=UNSURE, tilt=0.0, roll=0.0, k1_hat=0.0), method).one_camera(
            pictures
        )

    return one_camera


@pytest.mark.parametrize("method", [pytest.param("joint", marks=pytest.mark.slow), "network"])
def test_matches_tell_the_focal_length_that_pictures_do_not(by, method):
    alone, found = by(scene(4), method=method), by(scene(6), method=method)
    assert "it takes six different photos" in alone.matches
    assert "6 photos match: focal length" in found.matches
    near, wide = (one.cameras[0].interval_68.focal_px for one in (found, alone))
    assert near[1] - near[0] < (wide[1] - wide[0]) / 5
    assert found.cameras[0].focal_px == pytest.approx(FOCAL, rel=0.03)
    low, high = found.cameras[0].interval_95.focal_px
    assert low < FOCAL < high
    assert found.row()["matches"] == found.matches


@pytest.mark.slow
def test_a_zoom_between_the_photos_is_told_and_its_focal_length_not_used(by):
    found = by(scene(6, cameras=(FOCAL, 1.4 * FOCAL)))
    assert found.matches.startswith("the camera zoomed, or a scene misleads: matches give")
    assert found.matches in found.doubts
    assert any("zoomed" in reason for reason in found.cameras[0].reasons)
    low, high = found.cameras[0].interval_68.focal_px
    assert high > 1.1 * low


def test_one_group_alone_is_not_used(by):
    others = [
        photos(np.random.default_rng(seed), around(1), points(np.random.default_rng(seed)))[0] for seed in (1, 2, 3)
    ]
    found = by([*scene(3, cameras=(FOCAL,)), *others])
    assert "only one group of photos determines it, and none confirms it; too few agree" in found.matches
    assert found.doubts == ()


def test_a_camera_that_does_not_move_tells_nothing_and_zooms_nowhere(by):
    rng, (view, *_) = np.random.default_rng(0), scene(4)
    views = [
        replace(view, points=view.points + rng.normal(0, 0.2, (len(view), 2)).astype(np.float32)) for _ in range(8)
    ]
    found = by(views)
    assert "it takes six different photos" in found.matches
    assert found.doubts == ()


def test_pictures_that_are_sure_of_another_focal_length_are_not_overruled(by):
    found = by(scene(6), network=Fake(scale=(0.002,) * 4, tilt=0.0, roll=0.0, k1_hat=0.0))
    assert any("standard errors: it was not used" in doubt for doubt in found.doubts)
    assert found.cameras[0].focal_px < 0.97 * FOCAL  # the network says 485


def test_without_the_extra_one_line_says_so(by, monkeypatch):
    import sextant.correspondence.local_features as local

    monkeypatch.setattr(local, "find_spec", lambda package: None)
    pictures = [np.full((48, 64, 3), number, np.uint8) for number in range(100, 106)]
    found = PhotoCalibrator(Fake(), "joint").one_camera(pictures)
    assert found.matches.startswith("matches between the photos were not used: local features need kornia")
    assert found.doubts == ()


def test_features_are_found_only_where_they_are_used(by):
    from sextant.chapters.calibration.matched_focal import PhotoMatches

    extractor = MadeUp(dict.fromkeys(range(40), scene(2)[0]))
    matches = PhotoMatches(40, extractor)
    for number in range(40):
        matches.see(str(number), np.full((480, 640, 3), number, np.uint8))
    assert extractor.asked == [*range(5), *range(17, 22), *range(35, 40)]


def test_each_verdict_without_an_answer_has_its_reason():
    assert {*WHY, "known"} == {*get_args(get_type_hints(SharedFocalLength)["verdict"])}
