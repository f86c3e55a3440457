"""What every weather and shape corruption has in common: range, determinism, independence from the batch."""

import pytest
import torch

from sextant.corruptions import cifar10_c, imagenet_c, mnist_c

NAMES = {
    "cifar10_c": (cifar10_c, ("snow", "frost", "fog", "spatter")),
    "imagenet_c": (imagenet_c, ("snow", "frost", "fog", "spatter")),
    "mnist_c": (
        mnist_c,
        ("shear", "scale", "rotate", "translate", "stripe", "fog", "spatter", "dotted_line", "zigzag", "canny_edges"),
    ),
}
FAMILIES = [(key, name) for key, (_, names) in NAMES.items() for name in names]
RANDOM = [pair for pair in FAMILIES if pair[1] not in ("scale", "stripe", "canny_edges")]


def corruption(key, name, mode="faithful"):
    return NAMES[key][0](names=[name], severities=(1, 2, 3, 4, 5), mode=mode)[name]


def images(shape, count=6):
    return torch.rand(count, *shape, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize(("key", "name"), FAMILIES)
@pytest.mark.parametrize("mode", ["faithful", "corrected"])
@pytest.mark.parametrize("shape", [(3, 32, 32), (1, 28, 28), (3, 40, 24)])
def test_any_size_and_channels_stay_in_range_with_their_type(key, name, mode, shape):
    family = corruption(key, name, mode)
    for dtype in (torch.float32, torch.float64):
        clean = images(shape, 2).to(dtype)
        for level in family.levels:
            result = family(clean, level, torch.arange(2), 0)
            assert result.shape == clean.shape
            assert result.dtype == dtype
            assert bool(((result >= 0) & (result <= 1)).all())  # nan is neither
            assert not torch.equal(result, clean)


@pytest.mark.parametrize(("key", "name"), FAMILIES)
def test_an_image_depends_on_its_seed_and_index_alone(key, name):
    family, shape = corruption(key, name), (1, 28, 28) if key == "mnist_c" else (3, 32, 32)
    clean, level = images(shape), family.levels[-1]
    together = family(clean, level, torch.arange(6), 3)
    torch.rand(5)
    assert torch.equal(together, family(clean, level, torch.arange(6), 3))
    alone = torch.cat([family(clean[i : i + 1], level, torch.tensor([i]), 3) for i in (4, 1)])
    torch.testing.assert_close(alone, together[[4, 1]], rtol=0, atol=1e-6)
    shuffled = torch.tensor([5, 0, 3])
    torch.testing.assert_close(family(clean[shuffled], level, shuffled, 3), together[shuffled], rtol=0, atol=1e-6)


@pytest.mark.parametrize(("key", "name"), RANDOM)
def test_other_seeds_indices_and_severities_draw_anew(key, name):
    family, shape = corruption(key, name), (3, 32, 32)
    count = 40  # of 40 random signs some differ

    def draw(level, first, seed):
        params = family.draw(level, torch.arange(count) + first, shape, seed)
        parts = params if isinstance(params, tuple) else (params,)
        return torch.cat([part.double().flatten() for part in parts])

    level = family.levels[0]
    reference = draw(level, 0, 0)
    assert torch.equal(reference, draw(level, 0, 0))
    assert not torch.equal(reference, draw(level, 0, 1))
    assert not torch.equal(reference, draw(level, count, 0))
    if len(family.levels) > 1:
        assert not torch.equal(reference.sign(), draw(family.levels[1], 0, 0).sign()) or name == "frost"


@pytest.mark.parametrize(("key", "name"), FAMILIES)
def test_clean_images_are_not_written_to(key, name):
    family = corruption(key, name)
    clean = images((3, 32, 32), 2)
    before = clean.clone()
    family(clean, family.levels[0], torch.arange(2), 0)
    assert torch.equal(clean, before)


@pytest.mark.parametrize(("key", "name"), FAMILIES)
def test_an_unknown_severity_is_refused(key, name):
    family = corruption(key, name)
    with pytest.raises(ValueError, match="severities 1 to"):
        family(images((3, 32, 32), 1), 6, torch.arange(1), 0)


@pytest.mark.gpu
@pytest.mark.parametrize(("key", "name"), FAMILIES)
def test_devices_agree(key, name):
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    family = corruption(key, name)
    clean = images((3, 32, 32))
    for level in family.levels:
        here = family(clean, level, torch.arange(6), 0)
        there = family(clean.cuda(), level, torch.arange(6), 0)
        assert there.is_cuda
        # an 8-bit step of the flakes or of the liquid may fall the other way
        assert ((there.cpu() - here).abs() > 2e-5).double().mean() < 2e-3
