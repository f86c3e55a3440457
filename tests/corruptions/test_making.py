"""Files of corrupted images: layout, resuming, memory, and what is refused."""

import errno
import json

import numpy as np
import pytest
import torch

from sextant.corruptions import cifar10_c, to_bytes
from sextant.corruptions import making as m
from sextant.errors import UserError

RECIPE = m.Recipe("cifar10_c", "faithful", 3, "digest", "1")
IMAGES = np.random.default_rng(0).integers(0, 256, (10, 16, 16, 3), dtype=np.uint8)
CHOSEN = cifar10_c(names=["fog", "brightness"], severities=(1, 4))


@pytest.mark.parametrize("shape", [(10, 16, 16, 3), (10, 16, 16, 1), (10, 16, 16)])
def test_a_file_holds_every_severity_of_all_images_in_order(tmp_path, shape, monkeypatch):
    monkeypatch.setattr(m, "BLOCK_IMAGES", 3)
    images = IMAGES[..., : shape[3] if len(shape) == 4 else 1].reshape(shape)
    done = []
    m.write_corruption(tmp_path / "fog.npy", CHOSEN["fog"], images, RECIPE, advance=done.append)
    stored = np.load(tmp_path / "fog.npy", allow_pickle=False)
    assert stored.dtype == np.uint8
    assert stored.shape == (20, *shape[1:])
    assert done == [3, 3, 3, 1] * 2
    values = torch.from_numpy(images.reshape(10, 16, 16, -1)).permute(0, 3, 1, 2).float() / 255
    for block, level in zip(np.split(stored, 2), (1, 4), strict=True):
        expected = to_bytes(CHOSEN["fog"](values, level, torch.arange(10), 3), "faithful")
        assert np.array_equal(block.reshape(10, 16, 16, -1), expected.permute(0, 2, 3, 1).numpy())


def test_a_memory_map_is_read_block_by_block(tmp_path):
    np.save(tmp_path / "images.npy", IMAGES)
    mapped = np.load(tmp_path / "images.npy", mmap_mode="r")
    m.write_corruption(tmp_path / "a.npy", CHOSEN["brightness"], mapped, RECIPE)
    m.write_corruption(tmp_path / "b.npy", CHOSEN["brightness"], IMAGES, RECIPE)
    assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()
    assert m.images_digest(mapped) == m.images_digest(IMAGES)


def test_the_digest_knows_shape_and_every_value(monkeypatch):
    whole = m.images_digest(IMAGES)
    changed = IMAGES.copy()
    changed[-1, -1, -1, -1] ^= 1
    assert len({whole, m.images_digest(changed), m.images_digest(IMAGES.reshape(10, 8, 32, 3))}) == 3
    monkeypatch.setattr(m, "BLOCK_IMAGES", 4)
    assert m.images_digest(IMAGES) == whole


def test_an_interrupted_file_leaves_nothing_and_the_others_stay(tmp_path):
    m.begin(tmp_path, RECIPE, CHOSEN)
    m.write_corruption(tmp_path / "brightness.npy", CHOSEN["brightness"], IMAGES, RECIPE)

    def interrupt(images):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        m.write_corruption(tmp_path / "fog.npy", CHOSEN["fog"], IMAGES, RECIPE, advance=interrupt)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["brightness.npy", m.RECORD]
    m.begin(tmp_path, RECIPE, CHOSEN)
    assert m.missing(tmp_path, CHOSEN, IMAGES) == {"fog": 2 * IMAGES.size}


def test_what_a_killed_process_left_half_written_is_removed(tmp_path):
    m.begin(tmp_path, RECIPE, CHOSEN)
    (tmp_path / ".fog.npy.123.tmp").write_bytes(b"half")
    m.begin(tmp_path, RECIPE, CHOSEN)
    assert [path.name for path in tmp_path.iterdir()] == [m.RECORD]


def test_a_cut_or_foreign_file_is_not_whole(tmp_path):
    path, shape = tmp_path / "fog.npy", (20, 16, 16, 3)
    assert not m.is_whole(path, shape)
    np.save(path, np.zeros(shape, np.uint8))
    assert m.is_whole(path, shape)
    assert not m.is_whole(path, (20, 16, 16))
    path.write_bytes(path.read_bytes()[:-1])
    assert not m.is_whole(path, shape)
    for other in (np.zeros(shape, np.float32), np.array([{"a": 1}], dtype=object)):
        np.save(path, other, allow_pickle=True)
        assert not m.is_whole(path, shape)
    path.write_bytes(b"")
    assert not m.is_whole(path, shape)


@pytest.mark.parametrize(
    ("change", "said"), [({"seed": 4}, "seed"), ({"mode": "corrected"}, "mode"), ({"images": "other"}, "images")]
)
def test_a_folder_of_other_settings_is_refused(tmp_path, change, said):
    m.begin(tmp_path, RECIPE, CHOSEN)
    other = m.Recipe(**{**vars(RECIPE), **change})
    with pytest.raises(UserError, match=f"differ in {said}") as caught:
        m.begin(tmp_path, other, CHOSEN)
    assert "output=" in caught.value.fix


def test_other_severities_are_refused_and_more_corruptions_are_not(tmp_path):
    m.begin(tmp_path, RECIPE, CHOSEN)
    with pytest.raises(UserError, match="severities of fog"):
        m.begin(tmp_path, RECIPE, cifar10_c(names=["fog"]))
    m.begin(tmp_path, RECIPE, cifar10_c(names=["snow"]))
    assert set(json.loads((tmp_path / m.RECORD).read_text())["severities"]) == {"fog", "brightness", "snow"}


def test_files_that_nothing_is_known_of_are_not_overwritten(tmp_path):
    np.save(tmp_path / "fog.npy", IMAGES)
    with pytest.raises(UserError, match=r"fog\.npy"):
        m.begin(tmp_path, RECIPE, CHOSEN)


def test_labels_are_repeated_for_each_severity(tmp_path):
    labels = m.check_labels(np.arange(10), "labels", 10)
    m.write_labels(tmp_path, labels, 3)
    stored = np.load(tmp_path / m.LABELS)
    assert stored.dtype == np.uint8
    assert stored.tolist() == list(range(10)) * 3
    assert m.check_labels(np.arange(300), "labels", 300).dtype == np.int64


@pytest.mark.parametrize("labels", [np.arange(9), np.arange(10.0), np.zeros((10, 1), int)])
def test_labels_that_do_not_fit_are_refused(labels):
    with pytest.raises(UserError, match=r"labels=x\.npy"):
        m.check_labels(labels, "labels=x.npy", 10)


@pytest.mark.parametrize("shape", [(10,), (10, 8), (10, 8, 8, 2), (10, 3, 8, 8), (0, 8, 8), (1, 10, 8, 8, 3)])
def test_images_of_other_shapes_are_refused(shape):
    with pytest.raises(UserError, match="has the shape"):
        m.check_images(np.zeros(shape, np.uint8), "input=x.npy")


def test_images_of_other_types_are_refused():
    with pytest.raises(UserError, match="float64, not uint8"):
        m.check_images(np.zeros((2, 8, 8)), "input=x.npy")


def test_a_full_disk_is_raised_and_leaves_nothing(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(m, "_corrupted", full)
    with pytest.raises(OSError, match="No space"):
        m.write_corruption(tmp_path / "fog.npy", CHOSEN["fog"], IMAGES, RECIPE)
    assert not list(tmp_path.iterdir())


def test_what_is_no_array_of_numbers_is_refused(tmp_path):
    np.save(tmp_path / "whole.npy", IMAGES)
    assert np.array_equal(m.read_array(tmp_path / "whole.npy", "input"), IMAGES)
    (tmp_path / "cut.npy").write_bytes((tmp_path / "whole.npy").read_bytes()[:200])
    np.save(tmp_path / "pickled.npy", np.array([{}]), allow_pickle=True)
    np.savez(tmp_path / "several.npz", IMAGES)
    (tmp_path / "several.npz").rename(tmp_path / "several.npy")
    for name, said in (
        ("gone", "does not exist"),
        ("cut", "input cannot be read"),
        ("pickled", "input cannot be read"),
        ("several", r"input cannot be read: it is not a \.npy file"),
    ):
        with pytest.raises(UserError, match=said):
            m.read_array(tmp_path / f"{name}.npy", "input")
