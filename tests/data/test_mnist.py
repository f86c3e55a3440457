import gzip
import hashlib
import struct
from pathlib import Path

import numpy as np
import pytest

from sextant.data import mnist
from sextant.data.mnist import MNIST, FashionMNIST, read_idx
from sextant.data.source import MissingDataError
from sextant.errors import UserError

IMAGES, LABELS = "t10k-images-idx3-ubyte", "t10k-labels-idx1-ubyte"
COUNT = 5


def idx(array):
    return b"\x00\x00\x08" + struct.pack(f">B{array.ndim}I", array.ndim, *array.shape) + array.tobytes()


@pytest.fixture
def clothes(tmp_path, monkeypatch):
    """A Fashion-MNIST test split of five images: unlike MNIST's, its unpacked files have no published hash."""
    monkeypatch.setitem(mnist.COUNT, "test", COUNT)
    folder = tmp_path / "FashionMNIST" / "raw"
    folder.mkdir(parents=True)
    images = np.arange(COUNT * 28 * 28).astype(np.uint8).reshape(COUNT, 28, 28)
    labels = np.array([3, 1, 4, 1, 5], np.uint8)
    (folder / IMAGES).write_bytes(idx(images))
    (folder / LABELS).write_bytes(idx(labels))
    return FashionMNIST([tmp_path]), folder, images, labels


def test_images_and_labels_are_those_of_the_files(clothes):
    source, _, images, labels = clothes
    data = source.read("test")
    assert np.array_equal(data.images, images[:, None])
    assert np.array_equal(data.labels, labels)
    assert data.images.flags.writeable  # torch warns of arrays that are not


def test_another_number_of_images_is_refused(clothes, monkeypatch):
    source, *_ = clothes
    monkeypatch.setitem(mnist.COUNT, "test", COUNT + 1)
    with pytest.raises(UserError, match=r"test images have shape \(5, 28, 28\)"):
        source.read("test")


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda content: content[:-1], "is truncated"),
        (lambda content: content + b"\x00", "is truncated"),
        (lambda content: content[:10], "is not an idx file"),
        (lambda content: b"", "is not an idx file"),
        (lambda content: b"\x00\x00\x09" + content[3:], "is not an idx file"),
        (lambda content: b"<html>" + content, "is not an idx file"),
    ],
)
def test_a_damaged_file_is_named(clothes, damage, complaint):
    source, folder, *_ = clothes
    path = folder / IMAGES
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(UserError, match=f"{path} {complaint}"):
        source.read("test")


def test_an_altered_file_of_mnist_is_named(clothes, tmp_path):
    _, folder, *_ = clothes
    folder.rename(tmp_path / "raw")
    (tmp_path / "MNIST").mkdir()
    (tmp_path / "raw").rename(tmp_path / "MNIST" / "raw")
    with pytest.raises(UserError, match=f"{IMAGES} is damaged or not the published file: 3,936 bytes, sha256"):
        MNIST([tmp_path]).read("test")


def test_a_packed_file_beside_the_unpacked_one_is_checked(clothes):
    source, folder, images, _ = clothes
    packed = folder / f"{IMAGES}.gz"
    packed.write_bytes(gzip.compress(idx(images)))
    with pytest.raises(UserError, match=f"{packed} is damaged or not the published file"):
        source.read("test")


def test_a_packed_file_beside_the_unpacked_one_is_the_one_that_is_read(clothes, monkeypatch):
    source, folder, images, _ = clothes
    packed = gzip.compress(idx(255 - images))
    (folder / f"{IMAGES}.gz").write_bytes(packed)
    monkeypatch.setitem(FashionMNIST.gz_md5, f"{IMAGES}.gz", hashlib.md5(packed).hexdigest())
    assert np.array_equal(source.read("test").images, 255 - images[:, None])


@pytest.mark.parametrize("position", [0, 40, -1])
def test_a_damaged_packed_file_is_named(tmp_path, position):
    content = bytearray(gzip.compress(idx(np.random.default_rng(0).integers(4, size=4096).astype(np.uint8))))
    content[position] ^= 0xFF
    path = tmp_path / "labels.gz"
    path.write_bytes(content)
    with pytest.raises(UserError, match=f"{path} cannot be read"):
        read_idx(path)


def test_a_packed_file_that_ends_early_is_named(tmp_path):
    path = tmp_path / "labels.gz"
    path.write_bytes(gzip.compress(idx(np.zeros(100, np.uint8)))[:-9])
    with pytest.raises(UserError, match=f"{path} cannot be read"):
        read_idx(path)


def test_missing_files_are_named_with_every_folder_and_the_dataset_that_needs_none(tmp_path):
    roots = [tmp_path / "first", tmp_path / "second"]
    with pytest.raises(MissingDataError) as caught:
        MNIST(roots).read("test")
    message = str(caught.value)
    for part in (IMAGES, LABELS, *(str(root / "MNIST" / "raw") for root in roots), "dataset=digits"):
        assert part in message


def test_missing_files_are_fetched_into_the_last_folder_if_asked_for(clothes, tmp_path, monkeypatch):
    _, folder, images, _ = clothes

    def fetch(name, root, train):
        assert (name, root, train) == ("FashionMNIST", tmp_path / "last", False)
        (root / "FashionMNIST").mkdir(parents=True)
        folder.rename(root / "FashionMNIST" / "raw")

    monkeypatch.setattr(mnist, "torchvision_download", fetch)
    source = FashionMNIST([tmp_path / "first", tmp_path / "last"], download=True)
    assert np.array_equal(source.read("test").images, images[:, None])


@pytest.mark.parametrize("kind", [MNIST, FashionMNIST])
def test_the_spec_names_ten_classes_of_grey_images(kind):
    spec = kind([Path()]).spec()
    assert (spec.channels, spec.height, spec.width, len(set(spec.classes))) == (1, 28, 28, 10)


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("split", "counts"),
    [
        ("train", [5923, 6742, 5958, 6131, 5842, 5421, 5918, 6265, 5851, 5949]),
        ("test", [980, 1135, 1032, 1010, 982, 892, 958, 1028, 974, 1009]),
    ],
)
def test_the_published_mnist_has_its_known_class_counts(real_data, split, counts):
    data = MNIST([real_data]).read(split)
    assert data.images.shape == (sum(counts), 1, 28, 28)
    assert np.bincount(data.labels).tolist() == counts


@pytest.mark.real_data
def test_the_published_mnist_has_its_known_mean_and_spread(real_data):
    images = MNIST([real_data]).read("train").images
    assert images.mean() / 255 == pytest.approx(0.1307, abs=5e-5)
    assert images.std() / 255 == pytest.approx(0.3081, abs=5e-5)
