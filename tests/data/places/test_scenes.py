"""Places as classes: what is training, what is test, and that no scene has images of another."""

import re
from contextlib import nullcontext

import numpy as np
import pytest
from data.places.place_pictures import aligned_places
from data.places.test_town_seasons_as_places import TOWN, painted
from hypothesis import given
from hypothesis import strategies as st

from sextant.chapters.places.data import ImageRows, Nordland, PlaceImages, PlaceTolerance, as_place_source
from sextant.chapters.places.data.scenes import Scenes
from sextant.data.source import LabelledImages
from sextant.data.worlds import TownSeasons
from sextant.data.worlds.towns import TownSeasonsPlan
from sextant.errors import UserError

EXACT = PlaceTolerance("frames", 0, 2)


class Made:
    """A source of images in memory: the same for each split."""

    name = "made"

    def __init__(self, images, place_unit="frames"):
        self.images, self.place_unit, self.digest = images, place_unit, "0"

    def conditions(self, split):
        return self.images.conditions

    def files(self, split):
        return []

    def fingerprint(self):
        return self.digest

    def read(self, split):
        return self.images


def scenes_of(source=None, *, references=("season0",), queries=("season1",), spacing=5, **options):
    source = source or Made(aligned_places(20, 3))
    return Scenes(source, references=references, queries=queries, spacing=spacing, **options)


def told(found: LabelledImages):
    """(season, frame, label) of each image, as its pixels tell."""
    values = found.images[:, 0, 0, 0].astype(int)
    return [(value // 100, value % 100, label) for value, label in zip(values, found.labels.tolist(), strict=True)]


def placed(positions, frames=None, aligned=False, **columns):
    """Images of traverses along x, by the positions of each."""
    traverse = np.repeat(np.arange(len(positions)), [len(p) for p in positions])
    frame = np.concatenate([np.arange(len(p)) for p in positions])
    images = np.broadcast_to((traverse * 100 + frame)[:, None, None, None], (len(frame), 4, 6, 3)).astype(np.uint8)
    xy = np.stack([np.concatenate(positions), np.zeros(len(frame))], 1).astype(float)
    names = tuple(f"{t}/{f}" for t, f in zip(traverse, frame, strict=True))
    conditions = tuple(f"season{t}" for t in range(len(positions)))
    return PlaceImages(ImageRows(images), traverse, conditions, frame, names, xy, aligned=aligned, **columns)


def test_one_reference_a_scene():
    scenes = scenes_of()
    assert told(scenes.read("train")) == [(0, 0, 0), (0, 5, 1), (0, 10, 2), (0, 15, 3)]
    assert told(scenes.read("test")) == [(1, 0, 0), (1, 5, 1), (1, 10, 2), (1, 15, 3)]
    spec = scenes.spec()
    assert (spec.channels, spec.height, spec.width) == (3, 4, 6)
    assert spec.classes == ("frame_00000", "frame_00005", "frame_00010", "frame_00015")
    assert scenes.read("train").images.shape == (4, 3, 4, 6)
    assert scenes.left_out == ()


def test_many_references_a_scene_and_several_queries():
    scenes = scenes_of(references=("season2", "season0"), queries=("season1",), neighbours=1)
    assert told(scenes.read("train"))[:6] == [(2, 0, 0), (2, 1, 0), (2, 2, 0), (0, 0, 0), (0, 1, 0), (0, 2, 0)]
    assert [frame for _, frame, _ in told(scenes.read("test"))] == [1, 6, 11, 16]
    names, index = scenes.conditions("train")
    assert (names, index[:6].tolist()) == (("season2", "season0"), [0, 0, 0, 1, 1, 1])
    scenes = scenes_of(queries=("season2", "season1"))
    assert told(scenes.read("test"))[:4] == [(2, 0, 0), (1, 0, 0), (2, 5, 1), (1, 5, 1)]
    names, index = scenes.conditions("test")
    assert (names, index.tolist()) == (("season2", "season1"), [0, 1] * 4)


@given(
    frames=st.integers(8, 40),
    spacing=st.integers(1, 12),
    neighbours=st.integers(0, 3),
    positive=st.integers(0, 3),
)
def test_scenes_share_no_place_or_the_least_spacing_is_told(frames, spacing, neighbours, positive):
    scenes = scenes_of(
        Made(aligned_places(frames, 2)), spacing=spacing, neighbours=neighbours,
        tolerance=PlaceTolerance("frames", positive, positive + 1),
    )  # fmt: skip
    least = positive + neighbours + 1  # by hand: a neighbour of one scene against the place of the next
    room = frames - 2 * neighbours
    if room <= spacing:
        with pytest.raises(UserError, match="recognition needs two"):
            scenes.read("train")
        return
    if spacing < least:
        works = f"works here: spacing={least}" if room > least else "No spacing works"
        with pytest.raises(UserError, match=works):
            scenes.read("test")
        return
    train, test = told(scenes.read("train")), told(scenes.read("test"))
    for _, frame, label in test:
        assert all(abs(frame - other) > positive for _, other, of in train if of != label)
        assert sorted(f - frame for _, f, of in train if of == label) == list(range(-neighbours, neighbours + 1))
    assert len(test) == len(scenes.spec().classes) == -(-room // spacing)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"queries": ("autumn",)}, "has no autumn; it has season0, season1, season2"),
        ({"references": ("season1",)}, "share season1"),
        ({"references": ()}, "must name conditions"),
        ({"queries": ("season1", "season1")}, "each once"),
        ({"spacing": 0}, "spacing=0 must be 1 or more"),
        ({"neighbours": -1}, "neighbours=-1 0 or more"),
        ({"spacing": 20}, "1 scenes in 20 frames"),
        ({"spacing": 2, "neighbours": 1}, "spacing=3"),
    ],
)
def test_mistakes_are_told(options, says):
    with pytest.raises(UserError, match=re.escape(says)):
        scenes_of(**options).read("train")


def test_an_unknown_condition_is_told_before_anything_is_read():
    source = Made(aligned_places(20, 2))
    source.read = None
    with pytest.raises(UserError, match="has no season7"):
        scenes_of(source, queries=("season7",)).files("test")


def test_places_that_a_drive_comes_to_again_are_no_new_scenes():
    there_and_back = np.concatenate([np.arange(0, 300, 10), np.arange(298, 0, -10)])  # 60 frames
    scenes = scenes_of(Made(placed([there_and_back, there_and_back + 1], aligned=True), "m"), spacing=4)
    # 0, 40, .. 280, then back over 278 (frame 32, the place of frame 28), 238, .. 38 (frame 56, that of frame 4)
    assert [frame for _, frame, _ in told(scenes.read("train"))] == list(range(0, 32, 4))
    assert scenes.left_out[0] == "0/32 shows the same place as 0/28"
    assert scenes.left_out[-1] == "0/56 shows the same place as 0/4"
    exact = PlaceTolerance("m", 0.5, 25)
    scenes = scenes_of(Made(placed([there_and_back, there_and_back], aligned=True), "m"), spacing=4, tolerance=exact)
    assert len(scenes.spec().classes) == 15
    assert scenes.left_out == ()


def test_drives_that_are_not_aligned_are_matched_by_position_and_lacking_images_leave_a_scene_out():
    images = placed([np.arange(0, 100, 10), np.array([41.0, 0.5, 21, 19, 62])])
    scenes = scenes_of(Made(images, "m"), spacing=2)
    assert told(scenes.read("train")) == [(0, 0, 0), (0, 2, 1), (0, 4, 2), (0, 6, 3)]
    assert told(scenes.read("test")) == [(1, 1, 0), (1, 2, 1), (1, 0, 2), (1, 4, 3)]
    assert scenes.left_out == ("0/8 has no image under season1",)


def test_a_drive_without_a_partner_of_any_place_is_not_called_too_dense():
    elsewhere = placed([np.arange(0, 100, 10), np.arange(500, 600, 10)])
    with pytest.raises(UserError, match=r"0 scenes in 10 frames(.|\n)*has no image under season1"):
        scenes_of(Made(elsewhere, "m"), spacing=2).read("train")


def test_metres_that_are_too_close_name_the_least_spacing():
    images = placed([np.arange(0, 60, 2.0), np.arange(0, 60, 2.0)], aligned=True)
    with pytest.raises(UserError, match="within 5m of the next"):
        scenes_of(Made(images, "m"), spacing=2).read("train")
    with pytest.raises(UserError, match="spacing=3"):
        scenes_of(Made(images, "m"), spacing=1).read("train")
    with pytest.raises(UserError, match="spacing=5"):  # 2 neighbours of 2 m each
        scenes_of(Made(images, "m"), spacing=2, neighbours=2).read("train")


def test_the_fingerprint_tells_source_and_choice_apart():
    source = Made(aligned_places(20, 3))
    made = [scenes_of(source, **options) for options in ({}, {"spacing": 6}, {"neighbours": 1}, {"split": "val"})]
    digests = [scenes.fingerprint() for scenes in made]
    assert digests[0] == scenes_of(Made(aligned_places(20, 3))).fingerprint()
    source.digest = "1"
    assert len({*digests, made[0].fingerprint()}) == 5


def test_scenes_of_a_rendered_town(tmp_path, monkeypatch):
    monkeypatch.setattr(TownSeasonsPlan, "render", painted)
    source = as_place_source(TownSeasons(roots=[tmp_path], **TOWN))
    source.showing = lambda: nullcontext(lambda done, total: None)
    scenes = Scenes(source, references=["summer_noon"], queries=["winter_noon"], spacing=2)
    assert scenes.files("test") == []
    with pytest.raises(UserError, match="has no noon"):
        Scenes(source, references=["noon"], queries=["winter_noon"], spacing=2).files("test")
    assert not any(tmp_path.iterdir())
    train, test = scenes.read("train"), scenes.read("test")
    assert train.labels.tolist() == test.labels.tolist() == [0, 1]  # frames 0 and 2, eight metres apart
    whole = source.read("test")
    rows = [whole.rows_of(name) for name in ("summer_noon", "winter_noon")]
    assert np.array_equal(train.images[1].transpose(1, 2, 0), whole.images[rows[0]][2])
    assert np.array_equal(test.images[1].transpose(1, 2, 0), whole.images[rows[1]][2])
    assert scenes.of("train").spec().classes == ("frame_00000", "frame_00002", "frame_00004")
    with pytest.raises(UserError, match="The smallest spacing that works here: spacing=2"):  # a frame is four metres
        Scenes(source, references=["summer_noon"], queries=["winter_noon"], spacing=1).read("train")


@pytest.mark.slow
@pytest.mark.real_data
def test_scenes_of_a_railway(real_data, tmp_path):
    source = Nordland(roots=[real_data, tmp_path])
    scenes = Scenes(source, references=["summer"], queries=["winter"], spacing=10, neighbours=2)
    train, test = scenes.read("train"), scenes.read("test")
    assert (len(train.labels), len(test.labels), len(scenes.spec().classes)) == (5 * 75, 75, 75)
    whole = source.read("test")
    frame = int(scenes.spec().classes[7].removeprefix("frame_"))
    assert frame == 1650 + 2 + 70
    (row,) = np.flatnonzero((whole.frame == frame) & (whole.traverse == 1))
    assert np.array_equal(test.images[7].transpose(1, 2, 0), whole.images[row])
    assert len(scenes.of("val").read("test").labels) == 5
