import hashlib
import pickle

import numpy as np
import pytest
from support import Payload

from sextant.data import cifar10
from sextant.data.cifar10 import CIFAR10, CIFAR100
from sextant.data.source import MissingDataError
from sextant.errors import UserError


@pytest.fixture
def publish(tmp_path, monkeypatch):
    """Writes a batch as if it were the published one."""
    folder = tmp_path / "cifar-10-batches-py"
    folder.mkdir()

    def write(name, batch):
        content = pickle.dumps(batch, protocol=4)
        (folder / name).write_bytes(content)
        monkeypatch.setitem(cifar10.MD5, name, hashlib.md5(content).hexdigest())
        return folder / name

    return write


def a_batch(seed, count=4):
    pixels = np.random.default_rng(seed).integers(256, size=(count, 3, 32, 32)).astype(np.uint8)
    return {b"data": pixels.reshape(count, -1), b"labels": list(range(seed, seed + count))}, pixels


def test_rows_are_planes_of_red_green_and_blue(publish, tmp_path):
    batch, pixels = a_batch(1)
    publish("test_batch", batch)
    data = CIFAR10([tmp_path]).read("test")
    assert np.array_equal(data.images, pixels)
    assert data.labels.tolist() == [1, 2, 3, 4]


def test_training_batches_are_joined_in_order(publish, tmp_path):
    for number in (1, 2, 3):
        publish(f"data_batch_{number}", a_batch(number)[0])
    data = CIFAR10([tmp_path], train_batches=2).read("train")
    assert np.array_equal(data.images, np.concatenate([a_batch(1)[1], a_batch(2)[1]]))
    assert data.labels.tolist() == [1, 2, 3, 4, 2, 3, 4, 5]


def test_the_payload_of_these_tests_is_live(tmp_path):
    pickle.loads(pickle.dumps(Payload(tmp_path / "executed")))
    assert (tmp_path / "executed").exists()


def test_a_pickle_that_poses_as_a_batch_is_refused_before_it_is_opened(tmp_path):
    path = tmp_path / "cifar-10-batches-py" / "test_batch"
    path.parent.mkdir()
    path.write_bytes(pickle.dumps(Payload(tmp_path / "executed")))
    with pytest.raises(UserError, match=f"{path} is damaged or not the published file"):
        CIFAR10([tmp_path]).read("test")
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize("place", ["batch", b"data", b"labels"])
def test_even_with_the_published_hash_a_pickle_can_call_nothing_but_numpys_array(publish, tmp_path, place):
    payload = Payload(tmp_path / "executed")
    publish("test_batch", payload if place == "batch" else {**a_batch(1)[0], place: payload})
    with pytest.raises(pickle.UnpicklingError, match="is not allowed in a batch of CIFAR"):
        CIFAR10([tmp_path]).read("test")
    assert not (tmp_path / "executed").exists()


def test_missing_batches_are_named_with_every_folder_and_the_dataset_that_needs_none(publish, tmp_path):
    publish("data_batch_1", a_batch(1)[0])
    with pytest.raises(MissingDataError) as caught:
        CIFAR10([tmp_path, tmp_path / "other"], train_batches=3).read("train")
    message = str(caught.value)
    assert "data_batch_2, data_batch_3 not found" in message
    for part in (tmp_path / "cifar-10-batches-py", tmp_path / "other" / "cifar-10-batches-py", "dataset=digits"):
        assert str(part) in message


def test_missing_batches_are_fetched_into_the_last_folder_if_asked_for(publish, tmp_path, monkeypatch):
    path = publish("test_batch", a_batch(1)[0])

    def fetch(name, root, train):
        assert (name, root, train) == ("CIFAR10", tmp_path / "last", False)
        root.mkdir()
        path.parent.rename(root / path.parent.name)

    monkeypatch.setattr(cifar10, "torchvision_download", fetch)
    source = CIFAR10([tmp_path / "first", tmp_path / "last"], download=True)
    assert np.array_equal(source.read("test").images, a_batch(1)[1])


def test_a_copy_with_the_test_batch_alone_has_a_fingerprint_of_its_own(publish, tmp_path):
    source = CIFAR10([tmp_path], train_batches=1)
    publish("test_batch", a_batch(1)[0])
    test_alone = source.fingerprint()
    publish("data_batch_1", a_batch(2)[0])
    assert source.fingerprint() != test_alone


def test_cifar100_has_fine_labels_and_calls_nothing_either(tmp_path, monkeypatch):
    (tmp_path / "cifar-100-python").mkdir()

    def publish(content):
        (tmp_path / "cifar-100-python" / "test").write_bytes(content := pickle.dumps(content, protocol=4))
        monkeypatch.setitem(cifar10.MD5_100, "test", hashlib.md5(content).hexdigest())

    batch, pixels = a_batch(1)
    del batch[b"labels"]
    publish(whole := {**batch, b"fine_labels": [0, 99, 3, 4], b"coarse_labels": [1, 1, 1, 1]})
    source = CIFAR100([tmp_path])
    data = source.read("test")
    assert np.array_equal(data.images, pixels)
    assert [source.spec().classes[label] for label in data.labels[:2]] == ["apple", "worm"]
    assert len(set(source.spec().classes)) == 100
    publish({**whole, b"fine_labels": Payload(tmp_path / "executed")})
    with pytest.raises(pickle.UnpicklingError):
        source.read("test")
    assert not (tmp_path / "executed").exists()
    (tmp_path / "cifar-100-python" / "test").write_bytes(b"another")
    with pytest.raises(UserError, match="is damaged or not the published file"):
        source.read("test")


@pytest.mark.real_data
def test_the_published_test_batch_is_read_without_the_training_batches(real_data):
    source = CIFAR10([real_data], train_batches=5)
    data = source.read("test")
    assert data.images.shape == (10_000, 3, 32, 32)
    assert np.bincount(data.labels).tolist() == [1000] * 10
    assert [source.spec().classes[label] for label in data.labels[:4]] == ["cat", "ship", "ship", "airplane"]
    assert len(source.fingerprint()) == 64


@pytest.mark.real_data
def test_the_first_published_training_batch_has_its_known_colours(real_data):
    images = CIFAR10([real_data], train_batches=1).read("train").images
    assert images.shape == (10_000, 3, 32, 32)
    assert images.mean((0, 2, 3)) == pytest.approx([125.3, 123.0, 113.9], abs=1)
