"""Folders of panoramas: files of every kind, whole scenes in one split, one message for all that is bad."""

import numpy as np
import pytest
from data.photos.pictures import scene
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from sextant.chapters.calibration.data import PanoramaFolder, as_panorama_source
from sextant.chapters.calibration.data.panorama_folder import UnfitImageError, decode_panorama, split_scenes
from sextant.data.source import MissingDataError
from sextant.errors import UserError

SPLITS = ("train", "val", "test")


# -- decoding ----------------------------------------------------------------------------------------------------------


def bad_files(folder):
    Image.fromarray(scene(128, 64)).save(folder / "good.jpg")
    whole = (folder / "good.jpg").read_bytes()
    (folder / "truncated.jpg").write_bytes(whole[: len(whole) // 2])
    (folder / "empty.jpg").write_bytes(b"")
    (folder / "text.png").write_text("no image")
    Image.new("RGB", (128, 96)).save(folder / "photo.jpg")
    Image.new("RGB", (1, 1)).save(folder / "dot.png")
    Image.new("RGB", (16, 8)).save(folder / "tiny.png")
    Image.fromarray(scene(128, 64)[..., 0].astype(np.float32) / 32).save(folder / "float.tif")
    (folder / "huge.ppm").write_bytes(b"P6 40000 20000 255\n" + bytes(100))
    return {
        "truncated.jpg": "cannot be decoded", "empty.jpg": "is empty", "text.png": "cannot be decoded",
        "photo.jpg": "is 128 x 96", "dot.png": "is 1 x 1", "tiny.png": "at least 32 rows", "float.tif": "floating",
        "huge.ppm": "megapixels; scale it down",
    }  # fmt: skip


def test_bad_files_say_what_is_wrong(tmp_path):
    for name, told in bad_files(tmp_path).items():
        with pytest.raises(UnfitImageError, match=told):
            decode_panorama(tmp_path / name, 64)


def test_one_percent_off_two_to_one_is_let_through(tmp_path):
    Image.new("RGB", (201, 100)).save(tmp_path / "a.png")
    assert decode_panorama(tmp_path / "a.png", 64).shape == (64, 128, 3)
    Image.new("RGB", (203, 100)).save(tmp_path / "b.png")
    with pytest.raises(UnfitImageError, match="203 x 100"):
        decode_panorama(tmp_path / "b.png", 64)


# -- the folder --------------------------------------------------------------------------------------------------------


def folder_of(tmp_path, names):
    folder = tmp_path / "own"
    for i, name in enumerate(names):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGB", (128, 64), (i, 0, 0)).save(folder / name)
    return folder


def test_all_bad_files_are_named_at_once(tmp_path):
    told = bad_files(tmp_path)
    with pytest.raises(UserError, match=f"{len(told)} of {len(told) + 1}") as caught:
        PanoramaFolder(str(tmp_path), height=64, fractions={"train": 1, "val": 0, "test": 0}).read("train")
    assert all(name in caught.value.problem for name in told)
    assert "good.jpg" not in caught.value.problem


def test_files_without_decoding_then_pixels_once(tmp_path, monkeypatch):
    names = [f"{k:02d}.png" for k in range(9)] + ["sub/x.PNG", ".hidden/y.png"]
    folder = folder_of(tmp_path, names)
    (folder / "notes.txt").write_text("not an image")
    source = PanoramaFolder("own", height=64, roots=[tmp_path, tmp_path / "cache"])
    assert as_panorama_source(source) is source
    files = {split: source.files(split) for split in SPLITS}
    assert {split: len(paths) for split, paths in files.items()} == {"train": 7, "val": 1, "test": 2}
    assert sum(path.name == "x.PNG" for paths in files.values() for path in paths) == 1
    read = source.read("train")
    assert [read[i][0, 0, 0] for i in range(7)] == [names.index(name) for name in read.names]
    before = source.fingerprint()
    with monkeypatch.context() as patch:  # the second time pixels come from the cache
        patch.setattr("sextant.chapters.calibration.data.panorama_folder.decode_panorama", None)
        again = source.read("train")
    assert np.array_equal(np.stack([again[i] for i in range(7)]), np.stack([read[i] for i in range(7)]))
    assert PanoramaFolder("own", height=64, roots=[tmp_path]).fingerprint() == before
    Image.new("RGB", (128, 64), (200, 0, 0)).save(files["train"][0])
    changed = PanoramaFolder("own", height=64, roots=[tmp_path, tmp_path / "cache"])
    assert changed.fingerprint() != before
    assert changed.read("train")[0][0, 0, 0] == 200


def test_a_damaged_cache_is_made_anew(tmp_path):
    folder_of(tmp_path, [f"{k}.png" for k in range(4)])
    source = PanoramaFolder("own", height=64, roots=[tmp_path, tmp_path / "cache"])
    first = np.asarray(source.read("train").images).copy()
    (kept,) = (tmp_path / "cache").rglob("train.npy")
    kept.write_bytes(kept.read_bytes()[:1000])
    assert np.array_equal(source.read("train").images, first)


def test_one_house_is_on_one_side(tmp_path):
    names = [f"zind__floor_{k:02d}.png" for k in range(10)] + [f"poly__{k}.png" for k in range(20)]
    for seed in range(5):
        source = PanoramaFolder(str(folder_of(tmp_path, names)), seed=seed)
        sides = [split for split in SPLITS if any(path.name.startswith("zind__") for path in source.files(split))]
        assert len(sides) == 1
        assert sum(len(source.files(split)) for split in SPLITS) == 30
        assert all(source.files(split) for split in SPLITS)


def test_scenes_by_a_pattern(tmp_path):
    names = [f"h{k % 5}_room{k}.png" for k in range(20)]
    source = PanoramaFolder(str(folder_of(tmp_path, names)), groups=r"^(h\d+)_")
    houses = [{path.name[:2] for path in source.files(split)} for split in SPLITS]
    assert sum(map(len, houses)) == len(set.union(*houses)) == 5


@given(
    st.dictionaries(st.text("abcdef", min_size=1), st.integers(1, 40), min_size=3, max_size=40),
    st.integers(0, 9),
)
def test_every_split_gets_scenes_and_about_its_share(sizes, seed):
    fractions = {"train": 0.6, "val": 0.2, "test": 0.2}
    side = split_scenes(sizes, fractions, seed)
    assert set(side) == set(sizes)
    assert set(side.values()) == set(SPLITS)
    assert side == split_scenes(dict(reversed(sizes.items())), fractions, seed)
    total, largest = sum(sizes.values()), max(sizes.values())
    for split, fraction in fractions.items():
        held = sum(size for scene, size in sizes.items() if side[scene] == split)
        assert abs(held - fraction * total) <= 2 * largest


def test_the_seed_decides_the_split():
    sizes = {f"s{k}": 1 for k in range(30)}
    fractions = {"train": 0.6, "val": 0.2, "test": 0.2}
    assert split_scenes(sizes, fractions, 0) != split_scenes(sizes, fractions, 1)


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"fractions": {"train": 1, "test": 1}}, "fractions"),
        ({"fractions": {"train": 0, "val": 0, "test": 0}}, "fractions"),
        ({"height": 8}, "height=8"),
        ({"groups": "("}, "groups"),
    ],
)
def test_keys_without_meaning_are_named(tmp_path, keys, told):
    with pytest.raises(UserError, match=told):
        PanoramaFolder(str(tmp_path), **keys)


def test_what_is_missing_is_told(tmp_path):
    with pytest.raises(MissingDataError, match="no such folder"):
        PanoramaFolder("nowhere", roots=[tmp_path]).files("train")
    folder_of(tmp_path, ["a.png", "b.png"])
    with pytest.raises(MissingDataError, match="2 images of 2 scenes"):
        PanoramaFolder("own", roots=[tmp_path]).files("train")
    (tmp_path / "none").mkdir()
    with pytest.raises(MissingDataError, match="0 images"):
        PanoramaFolder("none", roots=[tmp_path]).files("train")
    source = PanoramaFolder("own", fractions={"train": 1, "val": 1, "test": 0}, roots=[tmp_path])
    with pytest.raises(UserError, match="no test panoramas"):
        source.read("test")


@pytest.mark.real_data
def test_real_panoramas_are_split_by_house(real_data, tmp_path):
    source = PanoramaFolder("panoramas", height=64, roots=[real_data, tmp_path])
    counts = {split: len(source.read(split)) for split in SPLITS}
    assert sum(counts.values()) == 88
    assert min(counts.values()) >= 8
    for house in ("zind__", "amsterdam__"):
        assert sum(any(path.name.startswith(house) for path in source.files(split)) for split in SPLITS) == 1
