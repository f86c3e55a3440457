"""What every corruption of noise, blur, colour and encoding promises, with the parameters of each set."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.corruptions import BenchmarkCorruption, cifar10_c, imagenet_c, mnist_c

RANDOM = (
    "gaussian_noise", "shot_noise", "impulse_noise", "speckle_noise", "glass_blur", "motion_blur", "elastic_transform",
)  # fmt: skip
CERTAIN = (
    "defocus_blur", "zoom_blur", "brightness", "contrast", "pixelate", "jpeg_compression", "gaussian_blur", "saturate",
)  # fmt: skip
NAMES = [*RANDOM, *CERTAIN]
MNIST_NAMES = ["shot_noise", "impulse_noise", "glass_blur", "motion_blur", "brightness"]
COUNT = 5
CASES = [
    pytest.param(build([name], mode=mode)[name], id=f"{build.__name__}-{name}-{mode}")
    for build, names in ((cifar10_c, NAMES), (imagenet_c, NAMES), (mnist_c, MNIST_NAMES))
    for name in names
    for mode in ("faithful", "corrected")
]
every_corruption = pytest.mark.parametrize("corruption", CASES)
random_corruption = pytest.mark.parametrize("corruption", [c for c in CASES if c.values[0].name in RANDOM])
cifar_corruption = pytest.mark.parametrize("name", NAMES)


def some_images(shape=(3, 20, 20), dtype=torch.float32):
    images = torch.rand(COUNT, *shape, generator=torch.Generator().manual_seed(0), dtype=dtype)
    return images, torch.arange(100, 100 + COUNT)


@every_corruption
@pytest.mark.parametrize("shape", [(1, 28, 28), (3, 20, 33)], ids=str)
def test_an_image_is_corrupted_alike_alone_and_in_every_batch(corruption, shape):
    images, indices = some_images(shape)
    for level in {corruption.levels[0], corruption.levels[-1]}:
        together = corruption(images, level, indices, seed=3)
        for order in ([2], [4, 0], [1, 3, 2, 0]):
            assert torch.equal(corruption(images[order], level, indices[order], seed=3), together[order])


@every_corruption
def test_the_result_has_the_images_shape_and_stays_between_black_and_white(corruption):
    images, indices = some_images()
    before = images.clone()
    for level in corruption.levels:
        corrupted = corruption(images, level, indices, 0)
        assert corrupted.shape == images.shape
        assert corrupted.min() >= 0
        assert corrupted.max() <= 1
        assert not torch.equal(corrupted, images)
        assert torch.equal(corruption(images, level, indices, 0), corrupted)
    assert torch.equal(images, before)


@every_corruption
def test_to_draw_and_to_apply_is_to_corrupt(corruption):
    images, indices = some_images()
    level = corruption.levels[-1]
    drawn = corruption.draw(level, indices, (3, 20, 20), 3)
    assert torch.equal(corruption.apply(images, level, drawn), corruption(images, level, indices, 3))


@random_corruption
def test_another_index_or_another_seed_is_another_draw(corruption):
    images, indices = some_images()
    level = corruption.levels[-1]
    reference = corruption(images, level, indices, seed=3)
    for other in (corruption(images, level, indices + COUNT, 3), corruption(images, level, indices, 4)):
        alike = sum(torch.equal(a, b) for a, b in zip(reference, other, strict=True))
        assert alike <= (2 if corruption.name == "motion_blur" else 0)  # lines of near angles take the same pixels


@cifar_corruption
@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float32, torch.float64])
def test_the_images_keep_their_type(name, dtype):
    images, indices = some_images(dtype=dtype)
    corrupted = cifar10_c([name])[name](images, 3, indices, 0)
    assert corrupted.dtype == dtype
    full = cifar10_c([name])[name](images.double(), 3, indices, 0)
    if name != "shot_noise":  # which counts other photons from other rates
        assert (corrupted.double() - full).abs().mean() < (2e-2 if dtype == torch.bfloat16 else 1e-3)


@given(height=st.integers(3, 40), width=st.integers(3, 40), grey=st.booleans(), name=st.sampled_from(NAMES))
def test_images_may_have_any_size(height, width, grey, name):
    images, indices = some_images((1 if grey else 3, height, width))
    for build in (cifar10_c, imagenet_c):
        corrupted = build([name])[name](images, 5, indices, 0)
        assert corrupted.shape == images.shape
        assert corrupted.isfinite().all()


@cifar_corruption
def test_a_severity_that_the_table_does_not_have_is_refused(name):
    corruption = cifar10_c([name])[name]
    with pytest.raises(ValueError, match="has severities 1 to 5, not 6"):
        corruption.row(6)
    with pytest.raises(ValueError, match=r"not 1\.5"):
        corruption.row(1.5)


@cifar_corruption
def test_strided_images_are_corrupted_like_contiguous_ones(name):
    images, indices = some_images((20, 20, 3))
    strided = images.permute(0, 3, 1, 2)
    corruption = cifar10_c([name])[name]
    close = corruption(strided, 4, indices, 0) - corruption(strided.contiguous(), 4, indices, 0)
    assert close.abs().max() < (1e-6 if name != "jpeg_compression" else 1e-9)


@pytest.mark.gpu
@cifar_corruption
@pytest.mark.parametrize("mode", ["faithful", "corrected"])
def test_every_device_makes_the_same_images(name, mode):
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    images, indices = some_images((3, 32, 32))
    corruption: BenchmarkCorruption = cifar10_c([name], mode=mode)[name]
    for level in corruption.levels:
        there = corruption(images.cuda(), level, indices, 0)
        assert there.is_cuda
        difference = (there.cpu() - corruption(images, level, indices, 0)).abs()
        # a value may be rounded to the next of 256 levels
        assert (difference > 1e-4).float().mean() < 1e-3
        assert difference.max() < 1.5 / 255
