"""Aligned rides: splits by frame that share no place; the real frames, if they are there."""

import numpy as np
import pytest
from data.places.place_pictures import picture, write_pictures
from PIL import Image

from sextant.chapters.places.data import ConditionSplit, ConditionSplitSource, FrameRanges, Nordland, PlaceTolerance
from sextant.data.source import MissingDataError
from sextant.errors import UserError

RANGES = {"train": (0, 5), "val": (5, 7), "test": (7, None)}
SMALL = {"frames": RANGES, "height": 16, "width": 24}
NAMES = [f"images-{10 * k:05d}.png" for k in range(1, 11)]


@pytest.fixture
def root(tmp_path):
    for k, season in enumerate(("autumn", "summer", "winter")):
        write_pictures(tmp_path / "nordland" / season, NAMES, first=100 * k)
    return tmp_path


def test_splits_are_ranges_of_frames(root):
    source = Nordland(("summer", "winter"), roots=[root], **SMALL)
    frames = {split: source.read(split).frame for split in ("train", "val", "test")}
    assert {split: sorted(set(found.tolist())) for split, found in frames.items()} == {
        "train": [0, 1, 2, 3, 4], "val": [5, 6], "test": [7, 8, 9]
    }  # fmt: skip
    assert all(len(found) == 2 * len(set(found)) for found in frames.values())
    images = source.read("test")
    assert images.names[0] == "summer/images-00080.png"
    assert np.array_equal(images.images[3], picture(207))
    assert not source.read("val").flat.any()


def test_conditions_come_in_the_order_asked_for(root):
    images = Nordland(("winter", "autumn", "summer"), roots=[root], **SMALL).read("val")
    assert images.conditions == ("winter", "autumn", "summer")
    assert np.array_equal(images.images[images.rows_of("autumn")][0], picture(5))
    assert Nordland(("winter", "summer"), roots=[root], channels=1, **SMALL).read("val").images.shape == (4, 16, 24, 1)


def test_a_missing_season_or_folder_is_told(root, tmp_path):
    with pytest.raises(MissingDataError, match=r"has no folder spring; it has autumn, summer, winter"):
        Nordland(("summer", "spring"), roots=[root], **SMALL).files("test")
    with pytest.raises(MissingDataError, match="Looked for"):
        Nordland(roots=[tmp_path / "nothing"], **SMALL).files("test")
    with pytest.raises(UserError, match="each once"):
        Nordland(("summer", "summer"), roots=[root])


def test_a_missing_partner_is_named_or_counted(root):
    (root / "nordland" / "winter" / NAMES[8]).unlink()
    with pytest.raises(UserError, match=r"1 frame lacks a partner(.|\n)*winter/images-00090"):
        Nordland(roots=[root], **SMALL).files("train")
    images = Nordland(roots=[root], skip_bad=True, **SMALL).read("test")
    assert images.frame.tolist() == [7, 8, 9, 7, 9]
    assert images.skipped == ("winter/images-00090 is missing",)
    assert Nordland(roots=[root], skip_bad=True, **SMALL).read("train").skipped == ()
    matrix = images.positives(images.rows_of("summer"), images.rows_of("winter"), PlaceTolerance("frames", 0, 2))
    assert (np.diff(matrix.indptr) == 0).tolist() == [False, True, False]


def test_splits_of_deeper_frames_have_one_white_level(root):
    for season in ("summer", "winter"):
        for k, name in enumerate(NAMES):
            deep = np.full((16, 24), 4000 if k < 5 else 900, np.uint16)
            Image.fromarray(deep).save(root / "nordland" / season / name)
    source = Nordland(roots=[root], channels=1, **SMALL)
    assert [source.read(split).images[0].max() for split in ("train", "test")] == [4000 >> 4, 900 >> 4]


def test_the_fingerprint_follows_the_split(root):
    first = Nordland(roots=[root], **SMALL).fingerprint()
    assert Nordland(roots=[root], **SMALL).fingerprint() == first
    other = SMALL | {"frames": {**RANGES, "train": (0, 4)}}
    assert Nordland(roots=[root], **other).fingerprint() != first


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"val": (4, 7)}, r"frames.val=\[4, 7\] and frames.train share frames"),
        ({"val": (5, None)}, "share frames"),
        ({"train": (3, 3)}, r"frames.train=\[3, 3\]"),
        ({"train": (-1, 3)}, "0 or more"),
        ({"train": (0, 3, 4)}, "two numbers"),
    ],
)
def test_ranges_that_overlap_or_are_empty_are_refused(changes, told):
    with pytest.raises(UserError, match=told):
        FrameRanges.of({**RANGES, **changes})


def test_ranges_beyond_the_last_frame_are_refused(root):
    for frames in ({**RANGES, "test": (7, 11)}, {**RANGES, "test": (10, None)}):
        with pytest.raises(UserError, match="there are 10 frames"):
            Nordland(roots=[root], frames=frames).files("test")


# -- conditions --------------------------------------------------------------------------------------------------------


def test_splits_by_condition_share_what_is_named_alone(root):
    source = Nordland(("summer", "winter", "autumn"), roots=[root], **SMALL)
    split = ConditionSplitSource(source, ConditionSplit(("summer", "autumn"), ("summer", "winter"), shared=("summer",)))
    assert split.read("train").conditions == split.read("val").conditions == ("summer", "autumn")
    test = split.read("test")
    assert test.conditions == ("summer", "winter")
    assert np.array_equal(test.images[test.rows_of("winter")][0], picture(207))
    assert ConditionSplitSource(source, ConditionSplit()).read("test").conditions == ("summer", "winter", "autumn")
    with pytest.raises(
        UserError,
        match=r"train_conditions=\['fog'\]: the train split of dataset=nordland has no fog; it has summer",
    ):
        ConditionSplitSource(source, ConditionSplit(train=("fog",))).read("train")
    with pytest.raises(UserError, match="share summer"):
        ConditionSplit(("summer", "autumn"), ("summer", "winter"))
    with pytest.raises(UserError, match="must name conditions"):
        ConditionSplit(train=())


# -- the real frames ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.real_data
def test_real_frames_are_aligned_by_name(real_data, tmp_path):
    source = Nordland(roots=[real_data, tmp_path])
    assert source.rides.count == 2400
    assert source.rides.missing == ()
    counts = {split: len(source.files(split)) for split in ("train", "val", "test")}
    assert counts == {"train": 3200, "val": 100, "test": 1500}
    images = source.read("test")
    assert images.images.shape == (1500, 32, 64, 3)
    summer, winter = images.rows_of("summer"), images.rows_of("winter")
    assert [images.names[i].split("/")[1] for i in summer] == [images.names[i].split("/")[1] for i in winter]
    matrix = images.positives(winter, summer, PlaceTolerance("frames", 1, 10))
    assert matrix.nnz == 3 * 750 - 2

    def standardised(rows):
        pixels = images.images[rows].mean(-1).reshape(len(rows), -1)
        pixels = (pixels - pixels.mean(0)) / pixels.std(0)
        return pixels / np.linalg.norm(pixels, axis=1, keepdims=True)

    found = (standardised(winter) @ standardised(summer).T).argmax(1)  # far above the chance of 0.4 %: the same places
    assert (np.abs(found - np.arange(750)) <= 1).mean() > 0.15
    train = source.read("train")
    assert 60 <= train.flat[train.rows_of("summer")].sum() <= 70
    assert 0.1 < train.still.mean() < 0.25
