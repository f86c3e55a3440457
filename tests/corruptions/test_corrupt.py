"""One call for an image in hand: what comes back, and that it is what the suites and files have."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from sextant.corruptions import cifar10_c, corrupt, imagenet_c, making, mnist_c, to_bytes
from sextant.errors import UserError

PAGE = Path(__file__).parents[2] / "docs" / "corruptions.md"
PHOTOS = np.random.default_rng(0).integers(0, 256, (3, 20, 24, 3), np.uint8)


@pytest.mark.parametrize("name", list(imagenet_c()))
def test_bytes_become_what_the_benchmarks_files_would_hold(name, tmp_path):
    recipe = making.Recipe("imagenet_c", "faithful", 5, making.images_digest(PHOTOS), "0")
    making.write_corruption(tmp_path / "x.npy", imagenet_c([name], [2])[name], PHOTOS, recipe)
    expected = np.load(tmp_path / "x.npy")
    found = corrupt(PHOTOS, name, 2, seed=5)
    assert type(found) is np.ndarray
    assert found.dtype == np.uint8
    assert np.array_equal(found, expected)
    assert np.array_equal(corrupt(torch.from_numpy(PHOTOS), name, 2, 5).numpy(), expected)
    assert np.array_equal(corrupt(PHOTOS[0], name, 2, 5), expected[0])
    assert np.array_equal(np.array(corrupt(Image.fromarray(PHOTOS[0]), name, 2, 5)), expected[0])


@pytest.mark.parametrize("mode", ["faithful", "corrected"])
@pytest.mark.parametrize(("key", "build"), [("imagenet_c", imagenet_c), ("cifar10_c", cifar10_c), ("mnist_c", mnist_c)])
def test_floating_point_images_are_not_rounded(key, build, mode):
    images = torch.rand(2, 1, 28, 28, generator=torch.Generator().manual_seed(0))
    for name, corruption in build(mode=mode).items():
        severity = corruption.levels[-1]
        expected = corruption(images, severity, [0, 1], 3)
        assert torch.equal(corrupt(images, name, severity, 3, set=key, mode=mode), expected)
        assert torch.equal(corrupt(images[0], name, severity, 3, set=key, mode=mode), expected[0])
        grey = corrupt(images[0, 0].numpy(), name, severity, 3, set=key, mode=mode)
        assert np.array_equal(grey, expected[0, 0].numpy())
        levels = corrupt((images[0, 0] * 255).byte(), name, severity, 3, set=key, mode=mode)
        exact = corruption((images[:1] * 255).byte().float() / 255, severity, 0, 3)[0, 0]
        assert torch.equal(levels, to_bytes(exact, mode))


@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_a_pillow_image_stays_one(mode):
    image = Image.fromarray(PHOTOS[0]).convert(mode)
    for name in ("fog", "jpeg_compression", "frost", "spatter"):
        found = corrupt(image, name, 3)
        assert (found.mode, found.size) == (mode, (24, 20))
    assert image.tobytes() == Image.fromarray(PHOTOS[0]).convert(mode).tobytes()


@pytest.mark.parametrize("array", [PHOTOS[0, ::-1], PHOTOS[0, :, ::-1], np.asfortranarray(PHOTOS[0])])
def test_memory_may_run_backwards(array):
    assert np.array_equal(corrupt(array, "fog", 1), corrupt(array.copy(), "fog", 1))


def test_each_image_of_a_batch_has_its_own_draw_and_images_one_by_one_need_their_own_seeds():
    alike = np.stack([PHOTOS[0]] * 3)
    batch = corrupt(alike, "gaussian_noise", 3)
    assert len({image.tobytes() for image in batch}) == 3
    assert np.array_equal(corrupt(alike[1], "gaussian_noise", 3), batch[0])
    assert not np.array_equal(corrupt(alike[1], "gaussian_noise", 3, seed=1), batch[0])


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("fogg", "Did you mean fog"),
        ("Gaussian Noise", "Did you mean gaussian_noise"),
        ("motion-blur", "Did you mean motion_blur"),
        ("jpeg", "jpeg_compression"),
        ("zigzag", "It is in mnist_c: pass set='mnist_c'."),
        (3, "It has gaussian_noise, shot_noise"),
    ],
)
def test_an_unknown_name_is_told_with_those_that_are_like_it(name, hint):
    with pytest.raises(UserError, match=re.escape(f"name={name!r} is not a corruption of imagenet_c")) as told:
        corrupt(PHOTOS[0], name, 3)
    assert hint in str(told.value)


@pytest.mark.parametrize("severity", [0, 6, 2.5, "3", None, True])
def test_an_unknown_severity_is_told(severity):
    with pytest.raises(UserError, match=rf"severity={severity!r}: fog has severities 1 to 5"):
        corrupt(PHOTOS[0], "fog", severity)
    with pytest.raises(UserError, match="zigzag has severities 1 to 1, not 2"):
        corrupt(PHOTOS[0], "zigzag", 2, set="mnist_c")


def test_an_unknown_set_or_mode_is_told():
    with pytest.raises(UserError, match="set=cifar is not known"):
        corrupt(PHOTOS[0], "fog", 1, set="cifar")
    with pytest.raises(UserError, match="mode=right is not known"):
        corrupt(PHOTOS[0], "fog", 1, mode="right")


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (PHOTOS[0].transpose(2, 0, 1), "Move its channels: there they come last"),
        (PHOTOS[0] / 255, "Move its channels: there they come before height and width"),
        (PHOTOS[0].transpose(2, 0, 1) * 1.0, "Divide by 255"),
        (PHOTOS[0].astype(np.int64), "the image is a ndarray of int64"),
        (torch.zeros(3, 8, 8, dtype=torch.int64), "the image holds torch.int64"),
        (PHOTOS[:, :, :, 0], "torch.uint8 of the shape (3, 20, 24)"),
        (np.zeros((4, 4, 4), np.uint8), "with c of 1 or 3"),
        (np.zeros((0, 4, 3), np.uint8), "An image needs pixels"),
        (Image.new("RGBA", (8, 8)), "image.convert('RGB')"),
        (Image.new("P", (8, 8)), "the image is of mode P"),
        ([PHOTOS[0]], "the image is a list"),
        ("photo.jpg", "the image is a str"),
    ],
    ids=range(12),
)
def test_what_is_no_image_of_the_documented_kinds_is_refused(image, message):
    with pytest.raises(UserError, match=re.escape(message)):
        corrupt(image, "fog", 3)


def test_an_empty_batch_stays_empty():
    assert corrupt(PHOTOS[:0], "fog", 3).shape == (0, 20, 24, 3)
    assert corrupt(torch.empty(0, 1, 8, 8), "snow", 3).shape == (0, 1, 8, 8)


def test_the_examples_of_the_documentation_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(PHOTOS[0]).save("photo.jpg")
    names = {"images": torch.rand(4, 3, 32, 32)}
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert any("corrupt(" in block for block in blocks)
    for block in blocks:
        exec(block, names)
    assert names["foggy"].size == (24, 20)
