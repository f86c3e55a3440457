"""Corrupted images from files: the same as those drawn, and files that do not belong to the test are refused."""

import numpy as np
import pytest
import torch

from sextant.corruptions import BenchmarkSuite, Condition, StoredSuite, cifar10_c
from sextant.corruptions import making as m
from sextant.corruptions.stored_suite import folder_identity
from sextant.errors import ArgumentError, UserError

IMAGES = np.random.default_rng(0).integers(0, 256, (10, 16, 16, 3), dtype=np.uint8)
LABELS = np.arange(10) % 3
NAMES = ["fog", "gaussian_noise"]
CLEAN = torch.from_numpy(IMAGES).permute(0, 3, 1, 2).float() / 255


def make(folder, images=IMAGES, severities=None):
    folder.mkdir()
    chosen = cifar10_c(NAMES, severities)
    recipe = m.Recipe("cifar10_c", "faithful", 3, m.images_digest(images), "1")
    m.begin(folder, recipe, chosen)
    for name, corruption in chosen.items():
        m.write_corruption(folder / f"{name}.npy", corruption, images, recipe)
    m.write_labels(folder, LABELS, 5)
    return folder


@pytest.fixture
def folder(tmp_path):
    return make(tmp_path / "stored")


def test_stored_images_are_those_the_suite_draws(folder):
    stored, drawn = StoredSuite(folder, names=NAMES), BenchmarkSuite(names=NAMES, seed=3)
    assert stored.conditions() == drawn.conditions()
    indices = torch.tensor([7, 2, 9])
    for condition in drawn.conditions():
        assert torch.equal(
            stored.corrupt(CLEAN[indices], indices, condition), drawn.corrupt(CLEAN[indices], indices, condition)
        )
    assert stored.protocol.mode == "faithful"
    assert stored.protocol.severities == drawn.protocol.severities


def test_grey_images_have_one_channel(tmp_path):
    folder = make(tmp_path / "grey", IMAGES[..., 0])
    found = StoredSuite(folder, names="fog").corrupt(CLEAN[:2, :1], torch.arange(2), Condition("fog", 2))
    assert found.shape == (2, 1, 16, 16)


def test_files_of_the_authors_have_no_record(folder):
    (folder / m.RECORD).unlink()
    suite = StoredSuite(folder, names=NAMES, severities=[2, 5])
    assert suite.protocol.mode == "published"
    found = suite.corrupt(CLEAN[:1], torch.zeros(1, dtype=torch.int64), Condition("fog", 5))
    assert np.array_equal(found[0].permute(1, 2, 0).numpy() * 255, np.load(folder / "fog.npy")[40])


def test_some_severities_made(tmp_path):
    folder = make(tmp_path / "two", severities=[2, 5])
    found = StoredSuite(folder, names="fog", severities=[5])
    assert np.array_equal(
        found.corrupt(CLEAN[:1], torch.zeros(1, dtype=torch.int64), Condition("fog", 5))[0].permute(1, 2, 0) * 255,
        np.load(folder / "fog.npy")[10],
    )
    with pytest.raises(UserError, match=r"has no severity 1.*\n.*It has 2, 5"):
        StoredSuite(folder, names="fog", severities=[1, 2])


def test_all_severities_are_those_in_the_files(tmp_path):
    folder = make(tmp_path / "two", severities=[2, 5])
    drawn = BenchmarkSuite(names=NAMES, severities=[2, 5], seed=3)
    stored = StoredSuite(folder, names=NAMES)
    assert [condition.key for condition in stored.conditions()] == [
        "clean", "gaussian_noise/2", "gaussian_noise/5", "fog/2", "fog/5",
    ]  # fmt: skip
    assert stored.protocol.severities == drawn.protocol.severities
    condition = Condition("fog", 5)
    assert torch.equal(stored.corrupt(CLEAN, range(10), condition), drawn.corrupt(CLEAN, range(10), condition))


def test_labels_of_another_dataset_are_noticed(folder):
    suite = StoredSuite(folder, names=NAMES)
    suite.check_labels(torch.from_numpy(LABELS[4:8]), torch.arange(4, 8))
    with pytest.raises(UserError, match="other labels"):
        suite.check_labels(torch.from_numpy(LABELS[3:7]), torch.arange(4, 8))
    with pytest.raises(UserError, match="other labels"):
        suite.check_labels(torch.zeros(1), torch.tensor([50]))


def test_images_that_do_not_fit_the_dataset(folder):
    suite = StoredSuite(folder, names=NAMES)
    with pytest.raises(UserError, match="holds images of 3x16x16, the dataset 3x32x32"):
        suite.corrupt(torch.zeros(1, 3, 32, 32), torch.tensor([0]), Condition("fog", 1))
    with pytest.raises(UserError, match="10 images per severity"):
        suite.corrupt(CLEAN[:1], torch.tensor([10]), Condition("fog", 1))


@pytest.mark.parametrize(
    ("condition", "said"),
    [
        (Condition("frost", 1), "(?s)corruption=frost is not in the suite.*There are: gaussian_noise, fog"),
        (Condition("fog", 6), "(?s)level=6 of fog is not in its file.*There are: 1, 2, 3, 4, 5"),
        (Condition("fog"), "level=None of fog"),
    ],
)
def test_a_condition_that_is_not_stored_is_refused(folder, condition, said):
    with pytest.raises(ArgumentError, match=said):
        StoredSuite(folder, names=NAMES).corrupt(CLEAN[:1], [0], condition)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda f: (f / "fog.npy").unlink(), "has no fog.npy"),
        (lambda f: (f / "labels.npy").unlink(), "has no labels.npy"),
        (lambda f: (f / "fog.npy").write_bytes(b"nonsense"), "cannot be read"),
        (lambda f: np.save(f / "fog.npy", np.zeros((50, 16, 16, 3))), "holds float64"),
        (lambda f: np.save(f / "fog.npy", IMAGES[:7]), r"shape \(7, 16, 16, 3\)"),
        (lambda f: np.save(f / "fog.npy", np.array([{}], dtype=object), allow_pickle=True), "cannot be read"),
    ],
)
def test_damaged_folders(folder, spoil, said):
    spoil(folder)
    with pytest.raises(UserError, match=said):
        StoredSuite(folder, names=NAMES)


def test_the_command_to_make_a_missing_file_names_the_set(folder):
    (folder / m.RECORD).unlink()
    with pytest.raises(UserError, match=r"has no frost.npy\n.*set=imagenet_c "):
        StoredSuite(folder, "imagenet_c", names="frost")


def test_of_another_set(folder):
    with pytest.raises(UserError, match=r"holds corruptions of cifar10_c.*\n.*set=cifar10_c"):
        StoredSuite(folder, "imagenet_c", names="fog")


def test_other_files_have_another_identity(folder):
    before = folder_identity(folder)
    assert folder_identity(folder) == before
    np.save(folder / "fog.npy", IMAGES)
    assert folder_identity(folder) != before
