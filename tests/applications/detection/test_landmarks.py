"""Landmarks that somebody pointed at, as the descriptor of an image."""

from contextlib import nullcontext

import numpy as np
import pytest
from cli.cosfire_detection.drawn import drawn
from PIL import Image
from quick_runs import quick_runs  # noqa: F401
from tiny_office import office_cache, office_config
from tiny_places import tiny_checkpoint

from sextant import Localizer
from sextant.applications.pixels import as_pixels
from sextant.chapters.cosfire.landmarks import Landmarks
from sextant.chapters.places.descriptors import descriptor_identity
from sextant.data.upright import ORIENTATION
from sextant.errors import UserError
from sextant.lifecycle.execute import execute

STRIPS = 4


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """A photo of 220 x 160 pixels with a glyph in its middle."""
    return drawn(tmp_path_factory.mktemp("photo") / "example.png")


def scene(path, x, size=(220, 160)):
    return np.asarray(Image.open(drawn(path, size, glyphs=() if x is None else ((x, 80),), discs=((60, 40),))))


def landmarks(example, **given):
    return Landmarks(example, [(110, 80)], **{"beside": None, "columns": STRIPS, "reach": 0.2} | given)


def test_a_landmark_answers_in_the_strip_where_it_is_seen(example, tmp_path):
    images = np.stack([scene(tmp_path / f"{x}.png", x) for x in (40, 180, None)])
    left, right, without = landmarks(example).fit(images).describe(images)
    assert (left.argmax(), right.argmax()) == (0, 3)
    assert left.max() > 2 * without.max()
    assert right.max() == pytest.approx(1, abs=0.05)


def test_the_photo_may_be_larger_than_the_images(example, tmp_path):
    large = tmp_path / "large.png"
    Image.open(example).resize((440, 320), Image.Resampling.BICUBIC).save(large)
    images = np.stack([scene(tmp_path / "a.png", 150)])
    ours = landmarks(example).describe(images)
    theirs = Landmarks(large, [(220.5, 160.5)], None, STRIPS, 0.2).describe(images)
    np.testing.assert_allclose(theirs, ours, atol=0.1)


@pytest.mark.slow
def test_beside_an_ordinary_descriptor_they_count_as_much_as_they_are_to(example, tmp_path):
    images = np.stack([scene(tmp_path / f"{x}.png", x) for x in range(30, 200, 25)])
    for weight in (1.0, 3.0):
        both = landmarks(example, beside="hog", weight=weight).add(example, [(60, 40), (110, 80)]).fit(images)
        rows = both.describe(images)
        ordinary, mine = rows[:, : -3 * STRIPS], rows[:, -3 * STRIPS :]
        assert np.sqrt(mine.var(0).mean() / ordinary.var(0).mean()) == pytest.approx(weight, rel=1e-3)


def test_filters_may_look_at_a_network(example, tmp_path):
    checkpoint = tiny_checkpoint(tmp_path / "last.ckpt")
    images = np.asarray(Image.open(example).resize((48, 32)))[None]
    found = Landmarks(example, [(110, 80)], None, STRIPS, network=str(checkpoint)).describe(images)
    assert found.shape == (1, STRIPS)
    assert found.max() == pytest.approx(1, abs=0.05)


@pytest.mark.slow
def test_a_localizer_takes_them(example, tmp_path):
    """A wall with one thing on it; the camera goes along."""
    images = np.stack([scene(tmp_path / f"{x}.png", x) for x in range(20, 201, 5)])
    poses = [(x / 10, 0.0, 0.0) for x in range(20, 201, 5)]
    localizer = Localizer.from_images(images, poses, landmarks(example, columns=16), steps=10, particles=200)
    told = [localizer.step((0.5, 0, 0), image) for image in images[8:20]]
    assert told[-1].pose[0] == pytest.approx(poses[19][0], abs=1.0)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"points": []}, "there is no landmark"),
        ({"points": [(1,)]}, r"points=\[\(1,\)\] must be pairs of finite numbers"),
        ({"points": [(1, 2), (3,)]}, "must be pairs of finite numbers"),
        ({"points": (310, 190)}, "must be pairs of finite numbers"),
        ({"points": "x"}, "points='x' must be pairs of finite numbers"),
        ({"points": [(float("nan"), 80)]}, r"points=\[\(nan, 80\)\] must be pairs of finite numbers"),
        ({"points": [(400, 10)]}, r"points=400,10 lies outside example.png of 220x160 pixels"),
        ({"points": [(2, 150)]}, "nothing in the prototype's neighbourhood"),
        ({"reach": 0.04}, r"reach=0.04 of 160 rows is 6.4 pixels, and a filter needs at least 8"),
        ({"columns": 0}, "columns=0 must be at least 1"),
        ({"weight": 0.0}, "weight=0 must be at least"),
        ({"beside": "sift"}, "'sift' must be one of"),
    ],
)
def test_what_is_no_landmark_is_refused(example, given, says):
    with pytest.raises(UserError, match=says):
        Landmarks(**{"photo": example, "points": [(110, 80)], "beside": None} | given).fit(
            np.zeros((3, 160, 220, 3), np.uint8)
        )


def test_landmarks_come_before_the_filters(example, tmp_path):
    fitted = landmarks(example).fit(scene(tmp_path / "a.png", 150)[None])
    with pytest.raises(UserError, match="the filters are configured already"):
        fitted.add(example, [(60, 40)])


@pytest.mark.slow
def test_a_run_of_localization_by_three_clicks_in_a_rendered_office(tmp_path):
    cache, photo = office_cache(), tmp_path / "photo.png"
    size = ("dataset.width=48", "dataset.height=36", "dataset.metres=[8.0,3.0,4.0]", "dataset.conditions=[summer_noon]")
    rng = np.random.default_rng(0)
    Image.fromarray(rng.integers(0, 255, (9, 12, 3), np.uint8)).resize((96, 72), Image.Resampling.NEAREST).save(photo)
    words = ["descriptor=landmarks", f"descriptor.photo={photo}", "descriptor.points=[[48,36],[30,30],[60,40]]"]
    raw = office_config(cache, tmp_path / "outputs", *size, *words)
    outcome = execute(raw)
    assert outcome.status == "finished"
    photo.write_bytes(photo.read_bytes() + b"\0")
    assert execute(raw).directory != outcome.directory  # another photo is another run


@pytest.mark.parametrize(
    ("points", "says"),
    [
        ([[219.5, 10]], ""),
        ([[30, 30], [400, 10]], r"descriptor.points=\[\[400,10\]\] lies outside example.png, which has 220x160 pixels"),
    ],
)
def test_a_run_refuses_points_beside_the_photo_before_its_world_is_rendered(example, tmp_path, points, says):
    node = {"_target_": "sextant.chapters.cosfire.landmarks.Landmarks", "photo": str(example), "points": points}
    with pytest.raises(UserError, match=says) if says else nullcontext():
        descriptor_identity(node | {"network": None}, tmp_path)


def test_the_photo_is_looked_at_upright(tmp_path):
    turned = Image.Exif()
    turned[ORIENTATION] = 6
    Image.new("L", (220, 160)).save(tmp_path / "a.jpg", exif=turned)
    assert as_pixels(tmp_path / "a.jpg").shape == (220, 160, 3)
    assert as_pixels(Image.open(tmp_path / "a.jpg")).shape == (220, 160, 1)
