import shutil

import numpy as np
import pytest
from sklearn.datasets import load_digits

from sextant.data.digits import Digits
from sextant.errors import UserError


@pytest.fixture(scope="module")
def splits():
    """Both splits at the size of the scans, which leaves the pixels as they are."""
    source = Digits(size=8)
    return source.read("train"), source.read("test")


def rows(images, labels):
    return sorted(map(tuple, np.column_stack([images.reshape(len(images), -1), labels])))


def test_the_splits_share_out_scikit_learns_scans_without_loss_or_overlap(splits):
    scans = load_digits()
    images, labels = (np.concatenate(parts) for parts in zip(*((s.images, s.labels) for s in splits), strict=True))
    assert rows(images, labels) == rows(scans.images.astype(int) * 255 // 16, scans.target)


def test_one_fifth_is_the_test_split_and_holds_its_share_of_every_class(splits):
    train, test = splits
    assert (len(train.labels), len(test.labels)) == (1438, 359)
    share = np.bincount(test.labels) / np.bincount(np.concatenate([train.labels, test.labels]))
    assert np.all((share > 0.1) & (share < 0.3))


def test_reading_again_gives_the_same_images_in_the_same_order(splits):
    again = Digits(size=8).read("test")
    assert np.array_equal(again.images, splits[1].images)
    assert np.array_equal(again.labels, splits[1].labels)


@pytest.mark.parametrize("size", [16, 28])
def test_enlarged_images_fit_the_spec_and_keep_their_brightness(size, splits):
    source = Digits(size)
    images, spec = source.read("test").images, source.spec()
    assert images.shape[1:] == (spec.channels, spec.height, spec.width) == (1, size, size)
    assert abs(images.mean() - splits[1].images.mean()) < 2


def test_a_damaged_copy_is_named(tmp_path, monkeypatch):
    copy = shutil.copy(Digits().files("train")[0], tmp_path / "digits.csv.gz")
    content = bytearray(copy.read_bytes())
    content[1000] ^= 1
    copy.write_bytes(content)
    monkeypatch.setattr(Digits, "files", lambda self, split: [copy])
    with pytest.raises(UserError, match=f"{copy} is damaged"):
        Digits().read("train")
