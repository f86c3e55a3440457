import math

import pytest
import torch

from sextant.geometry import CameraParameters
from sextant.geometry.canvas import of_picture, on_canvas, picture_size
from sextant.models.canvas import low_pass_sigma, pictures_of_canvas, pictures_on_canvas

ASPECTS = torch.tensor([16 / 9, 4 / 3, 1.0, 9 / 16])


def test_what_lies_around_a_picture_changes_nothing_and_is_grey():
    images = torch.rand(4, 3, 48, 48, generator=torch.Generator().manual_seed(0))
    seen = pictures_on_canvas(images, ASPECTS, 40)
    outside = seen == 0
    changed = torch.where(outside, 7.0, images)
    torch.testing.assert_close(pictures_on_canvas(changed, ASPECTS, 40), seen)
    for shown, aspect in zip(outside, ASPECTS.tolist(), strict=True):
        columns, rows = picture_size(48, aspect)
        assert (~shown[0]).sum() == columns * rows


def test_a_plain_picture_stays_plain_up_to_its_border():
    seen = pictures_on_canvas(torch.full((4, 3, 48, 48), 0.7), ASPECTS, 20)
    assert sorted(seen.unique().round(decimals=4).unique().tolist()) == pytest.approx([0, 0.7], abs=1e-4)


def test_a_tenth_of_the_finest_wave_is_left():
    period = 8  # pixels: 24 lines of 96
    wave = torch.cos(2 * math.pi * torch.arange(96) / period).expand(1, 1, 96, 96)
    seen = pictures_on_canvas(wave, torch.ones(1), 24)[0, 0, 48, 24:-24]
    assert float(seen.max()) == pytest.approx(0.1, abs=0.01)
    assert low_pass_sigma(96, 24) == pytest.approx(4 * low_pass_sigma(96, 96))


def test_pictures_are_cut_out_of_their_squares():
    images = torch.rand(4, 3, 48, 48, generator=torch.Generator().manual_seed(0))
    shapes = [tuple(picture.shape[2:]) for picture in pictures_of_canvas(images, ASPECTS, 40)]
    assert shapes == [(26, 48), (36, 48), (48, 48), (48, 26)]


def test_a_camera_of_a_picture_is_on_the_canvas_what_its_longer_side_sees():
    zero = torch.zeros(4)
    camera = CameraParameters(zero + 0.1, zero, 0.9 * ASPECTS.clamp(min=1), zero - 0.2)  # 0.9 longer sides
    square = on_canvas(camera, ASPECTS)
    torch.testing.assert_close(square.focal, torch.full((4,), 0.9))
    for found, expected in zip(of_picture(square, ASPECTS), camera, strict=True):
        torch.testing.assert_close(found, expected)
