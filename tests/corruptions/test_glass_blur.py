import numpy as np
import pytest
import torch
from scipy import ndimage

from sextant.corruptions import cifar10_c, mnist_c
from sextant.corruptions.blur import GlassBlur
from sextant.corruptions.pixels import SLACK

ROW = (0.7, 2, 2)


def slowly(image, row, moves, mode, axes=(True, True)):
    """The authors' loop over one image (h, w, c) or (h, w), with the moves given and NumPy's own views."""
    sigma, reach, passes = row
    sigmas = tuple(sigma * axis for axis in axes) + (0,) * (image.ndim - 2)
    x = ndimage.gaussian_filter(image, sigmas, mode="nearest")
    x = np.floor(x * 255 + SLACK).astype(np.uint8) if mode == "faithful" else x
    height, width = x.shape[:2]
    for turn in range(passes):
        for i, h in enumerate(range(height - reach, reach, -1)):
            for j, w in enumerate(range(width - reach, reach, -1)):
                dx, dy = moves[turn, i, j]
                if mode == "faithful":
                    x[h, w], x[h + dy, w + dx] = x[h + dy, w + dx], x[h, w]
                else:
                    x[h, w], x[h + dy, w + dx] = x[h + dy, w + dx].copy(), x[h, w].copy()
    x = x / 255 if mode == "faithful" else x
    return np.clip(ndimage.gaussian_filter(x, sigmas, mode="nearest"), 0, 1)


def moves_of(corruption, index, shape):
    _, reach, passes = corruption.row(1)
    (stream,) = corruption.streams(1, torch.tensor([index]), 0)
    return torch.randint(
        -reach, reach, (passes, shape[0] - 2 * reach, shape[1] - 2 * reach, 2), generator=stream
    ).numpy()


@pytest.mark.parametrize("mode", ["faithful", "corrected"])
@pytest.mark.parametrize("row", [ROW, (0.05, 1, 1), (0.4, 1, 2), (1.5, 4, 2)], ids=str)
@pytest.mark.parametrize("shape", [(32, 32), (17, 24)], ids=str)
def test_it_is_the_authors_loop(mode, row, shape):
    corruption = GlassBlur([row], "glass", mode=mode)
    images = np.random.default_rng(0).random((2, *shape, 3)).round(2)
    found = corruption(torch.from_numpy(images).permute(0, 3, 1, 2), 1, torch.tensor([4, 9]), 0)
    for image, index, blurred in zip(images, (4, 9), found, strict=True):
        expected = slowly(image, row, moves_of(corruption, index, shape), mode)
        np.testing.assert_allclose(blurred.permute(1, 2, 0), expected, rtol=0, atol=1e-9)


def test_colours_are_copied_in_faithful_mode_and_exchanged_in_corrected_mode():
    indices = torch.arange(3)
    faithful, corrected = (
        GlassBlur([ROW], "glass", mode=mode).draw(1, indices, (3, 32, 32), 0) for mode in ("faithful", "corrected")
    )
    for image in corrected:
        assert image.unique().numel() == 32 * 32
    for image in faithful:
        assert image.unique().numel() < 0.8 * 32 * 32


def test_one_pass_of_copies_keeps_about_seven_colours_of_ten():
    drawn = GlassBlur([(0.05, 1, 1)], "glass").draw(1, torch.arange(50), (3, 32, 32), 0)
    kept = np.mean([image.unique().numel() / 1024 for image in drawn])
    assert kept == pytest.approx(0.70, abs=0.02)  # 719 of 1024 in one published count


def test_grey_values_are_exchanged_in_either_mode():
    drawn = GlassBlur([ROW], "glass", mode="faithful").draw(1, torch.arange(3), (1, 28, 28), 0)
    for image in drawn:
        assert image.unique().numel() == 28 * 28


def test_mnist_c_lets_half_of_the_pixels_meet_and_blurs_down_the_columns():
    corruption = mnist_c(["glass_blur"])["glass_blur"]
    assert (corruption.levels, corruption.chance, corruption.down_only) == ((1,), 0.5, True)
    line = torch.zeros(1, 1, 28, 28)
    line[..., 14] = 1  # an upright line is not blurred down its length: every value is one of the line's own
    still = GlassBlur([(0.7, 1, 0)], "glass", chance=0.5, down_only=True)(line, 1, torch.arange(1), 0)
    torch.testing.assert_close(still, line)
    both = mnist_c(["glass_blur"], mode="corrected")["glass_blur"]
    softened = GlassBlur([(0.7, 1, 0)], "glass", mode="corrected", down_only=both.down_only)(
        line, 1, torch.arange(1), 0
    )
    assert softened.max() < 0.8


def test_a_chance_of_a_half_moves_fewer_pixels():
    def moved(chance):
        drawn = GlassBlur([(0.7, 1, 1)], "glass", mode="corrected", chance=chance).draw(
            1, torch.arange(40), (1, 28, 28), 0
        )
        return (drawn != torch.arange(28 * 28).view(28, 28)).double().mean().item()

    assert 0.45 < moved(0.5) / moved(1.0) < 0.85


def test_pixels_come_from_near_by():
    reach, passes = 2, 3
    drawn = GlassBlur([(0.7, reach, passes)], "glass").draw(1, torch.arange(4), (3, 40, 40), 0)
    rows = torch.arange(40).view(40, 1)
    assert (torch.div(drawn, 40, rounding_mode="floor") - rows).double().abs().mean() < 2 * reach * passes
    margin = drawn[:, 0]  # the authors' loop never visits the first rows; with copies they keep their colours
    assert torch.equal(margin, torch.arange(40).expand(4, 40))


def test_the_set_has_the_published_rows():
    assert cifar10_c(["glass_blur"])["glass_blur"].row(4) == (0.25, 1, 2)
