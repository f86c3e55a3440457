import numpy as np
import pytest
import torch
from PIL import Image
from support import as_published, torchs_settings_unchanged
from torch import nn

from sextant.applications import FailedPhoto, FailedPhotosError, ImageClassifier
from sextant.data.source import ImageSpec
from sextant.errors import ArgumentError, UserError
from sextant.models import ResNetCifar


class Brightness(nn.Module):
    """Logits of dark and of bright."""

    def __init__(self):
        super().__init__()
        self.gain = nn.Parameter(torch.tensor(10.0))

    def forward(self, images):
        bright = self.gain * (images.mean((1, 2, 3)) - 0.5)
        return torch.stack([-bright, bright], 1)


@pytest.fixture
def classifier():
    return ImageClassifier(Brightness(), ImageSpec(3, 16, 16, ("dark", "bright")))


@pytest.mark.parametrize(("value", "label"), [(0, "dark"), (255, "bright")])
def test_files_and_arrays_are_classified_alike(classifier, value, label, tmp_path):
    array = np.full((16, 16, 3), value, np.uint8)
    Image.fromarray(np.full((40, 60, 3), value, np.uint8)).save(tmp_path / "photo.png")
    by_array, by_file = classifier.classify_many([array, tmp_path / "photo.png"])
    assert by_array == by_file
    assert by_array.label == label
    assert by_array.probability == pytest.approx(1 / (1 + np.exp(-10)))
    assert sum(by_array.probabilities.values()) == pytest.approx(1)


def test_files_are_scaled_and_cropped_to_images_of_any_shape(tmp_path):
    classifier = ImageClassifier(Brightness(), ImageSpec(3, 8, 16, ("dark", "bright")))
    photo = np.zeros((60, 40, 3), np.uint8)
    photo[20:40] = 255  # the middle third, which 8x16 pixels show alone
    Image.fromarray(photo).save(tmp_path / "photo.png")
    middle = classifier.classify(np.full((8, 16, 3), 255, np.uint8))
    assert classifier.classify(tmp_path / "photo.png").probability == pytest.approx(middle.probability, rel=1e-2)


def test_a_pillow_image_is_classified_as_its_file(tmp_path):
    classifier = ImageClassifier(Brightness(), ImageSpec(1, 8, 16, ("dark", "bright")))
    pixels = np.random.default_rng(0).integers(0, 256, (60, 40, 4), np.uint8)
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(pixels).save(tmp_path / "photo.png", exif=exif)
    with Image.open(tmp_path / "photo.png") as picture:
        assert classifier.classify(picture) == classifier.classify(tmp_path / "photo.png")
    own = pixels[:8, :16, 0]
    assert classifier.classify(Image.fromarray(own)) == classifier.classify(own)
    (tmp_path / "half.png").write_bytes((tmp_path / "photo.png").read_bytes()[:400])
    with Image.open(tmp_path / "half.png") as half, pytest.raises(UserError, match="the image cannot be used"):
        classifier.classify(half)


@pytest.mark.parametrize("given", [np.ndarray.tolist, lambda bytes: bytes.astype(np.int64), torch.from_numpy])
def test_arrays_of_whole_numbers_of_any_kind_are_images(classifier, given):
    pixels = np.random.default_rng(0).integers(0, 256, (16, 16, 3), np.uint8)
    assert classifier.classify(given(pixels)) == classifier.classify(pixels)


def test_many_images_are_classified_as_each_alone(classifier):
    images = list(np.random.default_rng(0).integers(0, 256, (600, 16, 16, 3), np.uint8))
    together = classifier.classify_many(images)
    assert len(together) == 600
    for i in (0, 255, 256, 599):
        assert together[i].probabilities["dark"] == pytest.approx(classifier.classify(images[i]).probabilities["dark"])


@pytest.mark.parametrize(
    ("image", "told"),
    [
        (np.zeros((16, 16), np.uint8), "uint8 16x16x1; the network takes uint8 16x16x3"),
        (np.zeros((8, 8, 3), np.uint8), "uint8 8x8x3"),
        (np.zeros((16, 16, 3)), "float64 16x16x3"),
        (np.full((16, 16, 3), 256), "int64 16x16x3"),
        (torch.zeros(16, 16, 3, requires_grad=True), "float32 16x16x3; the network"),
        (b"\xff\xd8", r"PIL.Image.open\(io.BytesIO"),
        (None, "of type NoneType; the network takes uint8 16x16x3"),
        ("gone.jpg", "gone.jpg does not exist"),
    ],
)
def test_what_does_not_fit_is_named(classifier, image, told):
    with pytest.raises(UserError, match=told):
        classifier.classify(image)


@pytest.mark.parametrize(
    ("images", "told"),
    [
        (torch.rand(2, 3, 16, 16), "images hold torch.float32, not torch.uint8"),
        (torch.zeros(2, 1, 16, 16, dtype=torch.uint8), r"\(2, 1, 16, 16\), but must have \(b, 3, 16, 16\)"),
        (torch.zeros(2, 3, 8, 16, dtype=torch.uint8), r"\(2, 3, 8, 16\), but must"),
        (torch.zeros(3, 16, 16, dtype=torch.uint8), r"\(3, 16, 16\), but must"),
    ],
)
def test_probabilities_are_of_bytes_of_the_networks_shape(classifier, images, told):
    with pytest.raises(ArgumentError, match=told):
        classifier.probabilities(images)


def test_images_that_fail_among_many_are_named_and_the_others_are_not_lost(classifier, tmp_path):
    Image.fromarray(np.full((40, 60, 3), 255, np.uint8)).save(tmp_path / "photo.png")
    images = ["gone.jpg", tmp_path / "photo.png", np.zeros((8, 8, 3), np.uint8)]
    with pytest.raises(FailedPhotosError, match="2 of 3 photos could not be classified") as raised:
        classifier.classify_many(images)
    assert [each.name for each in raised.value.failed] == ["gone.jpg", "image 2"]
    first, found, last = classifier.classify_many(iter(images), errors="return")
    assert found.label == "bright"
    assert "does not exist" in first.error.problem
    assert "uint8 8x8x3" in last.error.problem
    assert all(isinstance(each, FailedPhoto) for each in classifier.classify_many(images[:1], errors="return"))


def test_a_folder_is_not_images(classifier, tmp_path):
    for folder in (tmp_path, str(tmp_path)):
        with pytest.raises(UserError, match="is one path; several images are expected"):
            classifier.classify_many(folder)
    with pytest.raises(UserError, match="images is of type int; several images are expected"):
        classifier.classify_many(4)
    with pytest.raises(UserError, match="errors=ignore must be one of raise, return"):
        classifier.classify_many([], errors="ignore")


def test_a_network_that_returns_nan_is_refused(classifier):
    classifier.network.gain.data.fill_(torch.nan)
    with pytest.raises(UserError, match="returns NaN"):
        classifier.classify(np.zeros((16, 16, 3), np.uint8))


def test_a_published_network_is_a_classifier(tmp_path):
    torch.manual_seed(0)
    network = ResNetCifar(3, (32, 32), 10, depth=20).eval()
    path = as_published(network, tmp_path / "checkpoint.pth.tar")
    image = np.random.default_rng(0).integers(0, 256, (32, 32, 3), np.uint8)
    with torchs_settings_unchanged(torch.float64):
        classifier = ImageClassifier.load(path, tmp_path)
        found = classifier.classify(image)
    with torch.no_grad():
        logits = network(torch.from_numpy(image.transpose(2, 0, 1)[None].copy()).float() / 255)
    expected = dict(zip(found.probabilities, logits.softmax(1)[0].tolist(), strict=True))
    assert found.probabilities == pytest.approx(expected, abs=1e-6)
    assert list(found.probabilities)[:3] == ["airplane", "automobile", "bird"]
