import numpy as np
import pytest
from PIL import Image

from sextant.data import image_folder
from sextant.data.image_folder import ImageFolder, decode_square
from sextant.data.source import MissingDataError
from sextant.errors import UserError


def noise(*shape):
    return np.random.default_rng(0).integers(255, size=shape).astype(np.uint8)


def save(path, pixels, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, **options)
    return path


def fill(folder, **classes):
    """Images in ``folder/<class>``, each of one grey value of its own."""
    for number, (name, count) in enumerate(classes.items()):
        for i in range(count):
            save(folder / name / f"{i:02}.png", np.full((8, 8), 50 * number + i, np.uint8))
    return folder


@pytest.fixture
def pets(tmp_path):
    """Classes made in another order than that of their names."""
    return fill(tmp_path / "pets", fish=10, cat=20, dog=5)


def colours(data):
    return sorted(data.images[:, 0, 0, 0].tolist())


def test_classes_are_the_folders_in_the_order_of_their_names(pets):
    source = ImageFolder(str(pets), 8, 1)
    assert source.spec().classes == ("cat", "dog", "fish")
    data = source.read("train")
    assert {
        (int(label), int(grey) // 50) for label, grey in zip(data.labels, data.images[:, 0, 0, 0], strict=True)
    } == {
        (0, 1),
        (1, 2),
        (2, 0),
    }


def test_the_splits_share_out_the_images_of_every_class(pets):
    source = ImageFolder(str(pets), 8, 1, test_fraction=0.2)
    train, test = source.read("train"), source.read("test")
    assert np.bincount(test.labels).tolist() == [4, 1, 2]
    assert sorted(colours(train) + colours(test)) == sorted([*range(10), *range(50, 70), *range(100, 105)])


def test_the_split_is_the_same_for_everyone(pets):
    first, second = (ImageFolder(str(pets), 8).files("test") for _ in range(2))
    assert first == second


def test_folders_named_train_and_test_are_the_splits(tmp_path):
    fill(tmp_path / "train", cat=3, dog=4)
    fill(tmp_path / "test", cat=1, dog=2)
    source = ImageFolder(str(tmp_path), 8, 1)
    assert source.spec().classes == ("cat", "dog")
    assert colours(source.read("train")) == [0, 1, 2, 50, 51, 52, 53]
    assert colours(source.read("test")) == [0, 50, 51]


def test_other_files_and_empty_folders_are_no_classes_or_images(pets):
    (pets / "cat" / "notes.txt").write_text("striped")
    (pets / "empty").mkdir()
    source = ImageFolder(str(pets), 8)
    assert source.spec().classes == ("cat", "dog", "fish")
    assert len(source.files("train") + source.files("test")) == 35


def test_a_folder_may_be_given_relative_to_a_root(pets):
    assert ImageFolder(pets.name, 8, roots=[pets.parent]).spec().classes == ("cat", "dog", "fish")


def test_a_missing_folder_is_named_as_it_was_looked_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MissingDataError) as caught:
        ImageFolder("pets", 8, roots=[tmp_path / "data"]).read("train")
    for part in (tmp_path / "pets", tmp_path / "data" / "pets", "dataset=digits"):
        assert str(part) in str(caught.value)


def test_one_class_is_too_few(tmp_path):
    with pytest.raises(MissingDataError, match="1 folder with images"):
        ImageFolder(str(fill(tmp_path, cat=3)), 8).read("train")


def test_a_class_with_one_image_cannot_be_in_both_splits_and_is_named(tmp_path):
    with pytest.raises(UserError, match="dog"):
        ImageFolder(str(fill(tmp_path, cat=3, dog=1)), 8).read("train")


def test_a_test_folder_without_images_of_the_classes_is_named(tmp_path):
    fill(tmp_path / "train", cat=2, dog=2)
    (tmp_path / "test").mkdir()
    with pytest.raises(UserError, match=str(tmp_path)):
        ImageFolder(str(tmp_path), 8).read("test")


def test_classes_that_are_only_tested_are_named(tmp_path):
    fill(tmp_path / "train", cat=2, dog=2, fish=2)
    fill(tmp_path / "test", cat=2, Dog=2, bird=1)
    with pytest.raises(UserError, match=r"test has Dog, bird, which train lacks\n.* are cat, dog, fish"):
        ImageFolder(str(tmp_path), 8).spec()


def test_more_than_fits_into_memory_is_refused_before_reading(pets, monkeypatch):
    monkeypatch.setattr(image_folder, "LARGEST_IN_MEMORY", 28 * 3 * 8**2 - 1)
    monkeypatch.setattr(image_folder, "decode_square", None)
    with pytest.raises(UserError, match="28 images of 8x8"):
        ImageFolder(str(pets), 8).read("train")


def test_an_image_moved_to_another_class_changes_the_fingerprint(tmp_path):
    for number, name in enumerate(
        ["train/cat/a", "train/cat/b", "train/dog/c", "train/dog/d", "test/cat/e", "test/dog/f"]
    ):
        save(tmp_path / f"{name}.png", np.full((8, 8), number, np.uint8))
    source = ImageFolder(str(tmp_path), 8)
    before = source.fingerprint()
    (tmp_path / "train/dog/c.png").rename(tmp_path / "train/cat/c.png")
    assert source.fingerprint() != before


@pytest.mark.parametrize(("shape", "centre"), [((8, 20, 3), np.s_[:, 6:14]), ((20, 8, 3), np.s_[6:14])])
def test_oblong_images_are_cropped_at_their_centre(tmp_path, shape, centre):
    pixels = noise(*shape)
    assert np.array_equal(decode_square(save(tmp_path / "wide.png", pixels), 8, 3), pixels[centre])


def test_large_images_are_scaled_to_cover_the_square(tmp_path):
    halves = np.zeros((64, 128, 3), np.uint8)
    halves[:, 64:] = 255
    square = decode_square(save(tmp_path / "halves.png", halves), 16, 3)
    assert square[:, :6].max() == 0
    assert square[:, 10:].min() == 255


@pytest.mark.parametrize("keep", [0, 100, -100])
def test_an_image_that_cannot_be_decoded_is_named(pets, keep):
    path = save(pets / "cat" / "00.jpg", noise(64, 64, 3))
    path.write_bytes(path.read_bytes()[:keep])
    why = rf"cannot be decoded \({path.stat().st_size:,} bytes\)" if keep else "is empty"
    with pytest.raises(UserError, match=f"{path} {why}"):
        decode_square(path, 8, 3)


def test_a_damaged_image_stops_the_reading_of_its_split(pets):
    for path in (pets / "cat").iterdir():
        path.write_bytes(b"")
    with pytest.raises(UserError, match=f"{pets / 'cat'}/.* is empty"):
        ImageFolder(str(pets), 8).read("train")
