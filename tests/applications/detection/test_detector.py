import numpy as np
import pytest
import torch
from cli.cosfire_detection.drawn import drawn
from PIL import Image
from support import as_published, imported_anew, torchs_settings_unchanged

from sextant.applications import ExampleDetector
from sextant.chapters.cosfire.images import upright_image
from sextant.errors import ArgumentError, UserError
from sextant.models import ResNetCifar

BLOCKED = ("hydra", "omegaconf", "pytorch_lightning", "lightning", "mlflow", "rich", "matplotlib")


@pytest.fixture
def example(tmp_path):
    return drawn(tmp_path / "example.png")


@pytest.fixture
def two(tmp_path):
    """A picture with the example at one place and a disc at another."""
    return drawn(tmp_path / "two.png", (320, 200), glyphs=((80, 70),), discs=((240, 120),))


def places(found):
    return [(each.x, each.y) for each in found]


@pytest.mark.slow
def test_what_the_example_shows_is_found(example, two):
    detector = ExampleDetector().add(example, point=(110, 80))
    (found,) = detector.detect(two)
    assert (found.x, found.y) == pytest.approx((80, 70), abs=2)
    assert found.score == pytest.approx(1, abs=1e-3)
    assert (found.move, found.example) == (None, 0)
    assert len(detector.detect(two, threshold=0.05)) > 1
    assert len(detector.detect(two, threshold=0.05, max_detections=1)) == 1
    assert len(detector.detect(two, threshold=0.05, min_distance=1000)) == 1


@pytest.mark.slow
def test_files_arrays_of_bytes_and_pillow_images_are_images_alike(example, two):
    colour, grey = np.asarray(Image.open(two)), np.asarray(Image.open(two).convert("L"))
    by_file = ExampleDetector().add(str(example)).detect(str(two))
    assert ExampleDetector().add(np.asarray(Image.open(example))).detect(colour) == by_file
    assert ExampleDetector().add(example).detect(grey) == by_file
    assert ExampleDetector().add(example).detect(grey[..., None]) == by_file
    assert ExampleDetector().add(Image.open(example)).detect(Image.open(two)) == by_file


@pytest.mark.slow
@pytest.mark.parametrize("moves", [{}, {"rotations": 4, "reflection": True}])
def test_each_of_several_examples_is_found_and_told_apart(example, two, tmp_path, moves):
    disc = drawn(tmp_path / "disc.png", glyphs=(), discs=((110, 80),))
    detector = ExampleDetector(**moves).add(example).add(disc, point=(110, 80))
    assert len(detector.filters) == 2 * (8 if moves else 1)
    found = sorted(detector.detect(two), key=lambda each: each.x)
    assert places(found) == [pytest.approx((80, 70), abs=2), pytest.approx((240, 120), abs=2)]
    assert [each.example for each in found] == [0, 1]
    assert [each.score for each in found] == pytest.approx([1, 1], abs=1e-3)  # each as a share of its own
    alone = ExampleDetector(**moves).add(example).detect(two)
    assert (alone[0].x, alone[0].y, alone[0].score) == (found[0].x, found[0].y, found[0].score)


def test_an_example_that_is_refused_leaves_the_detector_as_it_was(example, two):
    detector = ExampleDetector().add(example)
    before = detector.detect(two)
    for wrong, says in (
        (np.full((90, 90, 3), 7, np.uint8), "the image: .*a single colour"),
        ("gone.png", "does not exist"),
    ):
        with pytest.raises(UserError, match=says):
            detector.add(wrong)
    with pytest.raises(UserError, match="point=220,10 lies outside the prototype of 220x160 pixels"):
        detector.add(example, point=(220, 10))
    assert len(detector.examples) == 1
    assert detector.detect(two) == before


def test_nothing_is_detected_without_an_example(two):
    with pytest.raises(UserError, match="there is no example yet"):
        ExampleDetector().detect(two)


@pytest.mark.parametrize(
    ("chosen", "says"),
    [
        ({"preset": "digits"}, "preset=digits must be one of photo, bifurcation"),
        ({"rotations": 0}, "rotations=0 must be at least 1"),
        ({"rotations": 2.5}, "rotations=2.5 must be a whole number"),
        ({"scales": (0.0, 1.0)}, "must be a list, each a number above 0"),
        ({"scales": [np.nan]}, "must be a list, each a number above 0"),
        ({"scales": 0.5}, "scales=0.5 must be a list"),
        ({"reflection": "no"}, "reflection='no' must be one of True, False"),
        ({"reach": "20"}, "reach='20' must be a number above 0"),
        ({"reach": 7}, "reach=7 must be at least 8 pixels"),
        ({"features": "run"}, "features='run' must be of the class TrainedFeatures"),
        ({"longest": 0}, "longest=0 must be at least 16"),
    ],
)
def test_choices_that_have_no_meaning_are_refused(chosen, says):
    with pytest.raises(UserError, match=says):
        ExampleDetector(**chosen)


@pytest.mark.parametrize(
    ("chosen", "says"),
    [
        ({"max_detections": -1}, "max_detections=-1 must be at least 1"),
        ({"min_distance": -3.0}, "min_distance=-3.0 must be above 0"),
        ({"min_distance": float("nan")}, "min_distance=nan must be a number above 0"),
        ({"threshold": 0.0}, "threshold=0.0 must be a share above 0"),
    ],
)
def test_options_that_have_no_meaning_are_refused(example, chosen, says):
    with pytest.raises(ArgumentError, match=says):
        ExampleDetector().add(example).detect(example, **chosen)


def test_an_example_is_detected_in_itself_at_the_largest_threshold(example):
    assert max(each.score for each in ExampleDetector().add(example).detect(example, threshold=1)) >= 1


def test_files_in_the_home_folder_are_found(example, monkeypatch):
    monkeypatch.setenv("HOME", str(example.parent))
    assert ExampleDetector().add("~/example.png").detect("~/example.png")


def test_a_pillow_image_is_read_as_its_file(two, tmp_path):
    image = Image.open(two).convert("RGBA").rotate(90, expand=True)
    image.putpixel((7, 5), (0, 0, 0, 0))
    exif = Image.Exif()
    exif[0x0112] = 6
    image.save(tmp_path / "turned.png", exif=exif)
    given, read = (upright_image(each, 64) for each in (Image.open(tmp_path / "turned.png"), tmp_path / "turned.png"))
    assert (given.width, given.height) == (read.width, read.height) == (320, 200)
    assert np.array_equal(given.picture, read.picture)
    image.convert("L").save(tmp_path / "whole.png")
    (tmp_path / "half.png").write_bytes((tmp_path / "whole.png").read_bytes()[:400])
    with Image.open(tmp_path / "half.png") as half, pytest.raises(UserError, match="the image cannot be read"):
        upright_image(half, 64)


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (np.zeros((40, 40)), "is uint8"),
        (np.zeros((3, 40, 40), np.uint8), "is uint8"),
        (np.zeros((0, 4), np.uint8), "is uint8"),
        ([[0] * 40] * 40, "is of type list; an image is a file"),
        (torch.zeros(40, 40, dtype=torch.uint8), "is of type Tensor"),
        (None, "is of type NoneType"),
        (b"GIF89a", "is of type bytes.*\nDecode the content"),
    ],
    ids=range(7),
)
def test_what_is_no_image_is_refused(example, image, says):
    with pytest.raises(UserError, match=f"the image .*{says}"):
        ExampleDetector().add(example).detect(image)


@pytest.mark.parametrize("point", [(1, 2, 3), (1,), "310,190", ("1", "2"), (1, np.nan), 5, np.zeros((2, 2))])
def test_a_point_is_two_numbers(example, point):
    with pytest.raises(ArgumentError, match=r"point=.* must be two finite numbers"):
        ExampleDetector().add(example, point=point)
    assert ExampleDetector().add(example, point=np.array([110, 80])).examples[0].point == (110, 80)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    torch.manual_seed(0)
    return as_published(ResNetCifar(3, (32, 32), 10), tmp_path_factory.mktemp("model") / "model.pth.tar")


def test_through_a_trained_network(model, example, two, tmp_path):
    with torchs_settings_unchanged():
        detector = ExampleDetector.load(model, tmp_path, layer="layer2", rotations=2).add(example)
    (best, *_) = detector.detect(two)
    assert (best.x, best.y) == pytest.approx((80, 70), abs=4)
    assert (detector.threshold, best.move.rotation_rad) == (0.8, 0)
    with pytest.raises(UserError, match="preset=digit does not go with features"):
        ExampleDetector.load(model, tmp_path, layer="layer2", preset="digit")


def test_neither_hydra_nor_lightning_nor_mlflow_need_be_there(model, example, two, capfd):
    with imported_anew(*BLOCKED) as anew:
        assert anew.ExampleDetector is not ExampleDetector
        assert len(anew.ExampleDetector().add(example).detect(two)) == 1
        assert anew.ExampleDetector.load(model, layer="layer1").add(example).detect(two)
    assert capfd.readouterr() == ("", "")
