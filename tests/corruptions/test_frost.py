import cv2
import numpy as np
import pytest
import torch

from sextant.corruptions.pixels import luma
from sextant.corruptions.textures import HEIGHT, KINDS, WIDTH, frost_texture
from sextant.corruptions.weather import Frost

FROST = Frost(((1, 0.2), (0.75, 0.45)), "frost", levels=(1, 2), shrink=0.2)


@pytest.mark.parametrize("kind", range(len(KINDS)))
def test_textures_are_bluish_white_ice_with_relief(kind):
    texture = frost_texture(kind)
    assert texture.shape == (HEIGHT, WIDTH, 3)
    assert texture.min() >= 0
    assert texture.max() <= 1
    red, green, blue = texture.mean((0, 1))
    assert 0.35 < red < green < blue < 0.8
    assert texture.std() > 0.12
    # crystals: neighbours differ far more than in a haze, at full size and at a fifth
    for factor in (1, 0.2):
        grey = cv2.resize(texture, (0, 0), fx=factor, fy=factor).mean(-1)
        assert np.abs(np.diff(grey, axis=1)).mean() > 0.02


def test_textures_are_five_different_ones_that_cannot_be_written_to():
    textures = np.stack([frost_texture(kind)[::8, ::8].ravel() for kind in range(len(KINDS))])
    assert len(KINDS) == 5
    assert np.corrcoef(textures)[np.triu_indices(5, 1)].max() < 0.3
    with pytest.raises(ValueError, match="read-only"):
        frost_texture(0)[0, 0] = 0


def test_a_texture_is_drawn_alike_every_time():
    assert np.array_equal(frost_texture(1), frost_texture.__wrapped__(1))


def test_frost_is_a_cut_out_of_a_texture_laid_over_the_image():
    clean = torch.rand(6, 3, 32, 32)
    draw = FROST.draw(2, torch.arange(6), (3, 32, 32), 0)
    result = FROST.apply(clean, 2, draw)
    for i, (kind, top, left) in enumerate(zip(*draw, strict=True)):
        whole = cv2.resize(frost_texture(int(kind)), (round(WIDTH * 0.2), round(HEIGHT * 0.2)))
        ice = torch.from_numpy(whole[top : top + 32, left : left + 32]).permute(2, 0, 1)
        torch.testing.assert_close(result[i], (0.75 * clean[i] + 0.45 * ice).clamp(0, 1))
    grey = FROST.apply(clean[:, :1], 2, draw)
    expected = 0.75 * clean[5:, :1] + 0.45 * luma(ice[None])
    torch.testing.assert_close(grey[5:], expected.clamp(0, 1))


def test_every_texture_and_place_is_drawn():
    draw = FROST.draw(1, torch.arange(600), (3, 32, 32), 0)
    assert draw.kinds.bincount(minlength=5).min() > 600 / 5 * 0.7
    for offsets, limit in ((draw.tops, round(HEIGHT * 0.2) - 32), (draw.lefts, round(WIDTH * 0.2) - 32)):
        assert offsets.min() >= 0
        assert limit * 0.95 < offsets.max() < limit


@pytest.mark.parametrize("size", [(900, 40), (40, 1500), (768, 1024)])
def test_images_larger_than_the_textures_get_enlarged_ones(size):
    frost = Frost(((0.6, 0.75),), "frost", levels=(1,))
    result = frost(torch.zeros(1, 1, *size), 1, torch.arange(1), 0)
    assert result.shape == (1, 1, *size)
    assert result.std() > 0.05
