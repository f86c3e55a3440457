r"""The ten perturbations of CIFAR-10-P: short sequences in which an image changes a little from frame to frame.

Frame i of the image x, as published for 32x32 pixels:

=============== ================================================================================ ========
gaussian_noise  x + 0.02 n, new noise in each frame                                              1 to 30
shot_noise      Poisson(700 x) / 700, likewise                                                   1 to 30
motion_blur     radius 6, :math:`\sigma` 1.8, at an angle of 9° (i - 20)                         0 to 20
zoom_blur       mean of x and its magnifications by 1.004, 1.008, ... 1 + 0.004 i                0 to 30
snow            one snowfall, in wind from 4° i - 150°                                           0 to 30
brightness      V + 0.015 (i - 15) in HSV                                                        0 to 30
translate       by i - 7 pixels to the right                                                     0 to 15
rotate          by i - 15 degrees, clockwise                                                     0 to 30
tilt            in perspective, by 0.75° (i - 15) about both axes                                0 to 30
scale           by 0.7 + 0.02 i                                                                  0 to 30
=============== ================================================================================ ========

The sequences with noise start with x itself. What enters from outside the image is black.

Source: D. Hendrycks and T. Dietterich, "Benchmarking neural network robustness to common corruptions and
perturbations", ICLR 2019; parameters of ``make_cifar_p.py`` in hendrycks/robustness (Apache-2.0). Its libraries sample
the border differently by up to a pixel.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from sextant.corruptions.contract import Images, Positions
from sextant.corruptions.corruption import Corruption, filled, generators, image_seeds
from sextant.corruptions.filtering import bilinear, motion_blur
from sextant.corruptions.noise import ClippedGaussianNoise, ShotNoise
from sextant.corruptions.pixels import eight_bit
from sextant.corruptions.shapes import affine_warp
from sextant.corruptions.weather import Brightness, Snow, SnowDraw

NOISE_FRAMES = 30


@dataclass(frozen=True)
class Movement(Corruption[None]):
    """A deterministic perturbation: frame ``level`` is a function of the image and the number of the frame.

    Args:
        name: the perturbation's name.
        frame: makes a frame of images ``(b, c, h, w)``.
        levels: the frames, in order.
    """

    name: str
    frame: Callable[[Tensor, int], Tensor]
    levels: Sequence[float]

    def apply(self, images: Images, level: float, params: None) -> Images:
        """The frame."""
        return self.frame(images, int(level))


@dataclass(frozen=True)
class SnowSequence(Corruption[SnowDraw]):
    """Snow whose flakes stay the same while the wind turns."""

    name: str = "snow"
    levels: Sequence[float] = tuple(range(31))

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> SnowDraw:
        """The flakes, which depend on the image, not on the frame, and the wind, which depends on the frame alone."""
        streams = generators(image_seeds(self.name, 0, indices, seed))
        noise = filled(shape[-2:], streams, lambda flakes, stream: flakes.normal_(generator=stream))
        return SnowDraw(noise, torch.full((len(indices),), 4.0 * level - 150, dtype=torch.float64))

    def apply(self, images: Images, level: float, params: SnowDraw) -> Images:
        """Snow in the frame's wind."""
        return Snow(((0.05, 0.3, 2, 0.5, 10, 2, 0.85),), self.name).apply(images, 1, params)


def cifar10_p() -> Mapping[str, Corruption[Any]]:
    """The perturbations by name, their frames as levels; those with noise lack the first, which is the image."""
    frames, noisy = tuple(range(31)), tuple(range(1, NOISE_FRAMES + 1))
    found: list[Corruption[Any]] = [
        ClippedGaussianNoise((0.02,) * NOISE_FRAMES, "gaussian_noise", noisy),
        ShotNoise((700.0,) * NOISE_FRAMES, "shot_noise", noisy),
        Movement("motion_blur", _motion_blur, frames[:21]),
        Movement("zoom_blur", _zoom_blur, frames),
        SnowSequence(),
        Movement("brightness", _brightness, frames),
        Movement("translate", lambda images, i: _shifted(images, i - 7), frames[:16]),
        Movement("rotate", lambda images, i: _rotated(images, math.radians(i - 15)), frames),
        Movement("tilt", lambda images, i: _tilted(images, math.radians(0.75 * (i - 15))), frames),
        Movement("scale", lambda images, i: _scaled(images, 0.7 + 0.02 * i), frames),
    ]
    return {perturbation.name: perturbation for perturbation in found}


def _motion_blur(images: Images, i: int) -> Images:
    degrees = torch.full((len(images),), 9.0 * (i - 20), dtype=torch.float64)
    return eight_bit(motion_blur(images, 6, 1.8, degrees), "corrected")


def _zoom_blur(images: Images, i: int) -> Images:
    total = images.clone()
    for step in range(1, i + 1):
        total += _scaled(images, 1 + 0.004 * step)
    return total / (i + 1)


def _brightness(images: Images, i: int) -> Images:
    return Brightness((0.015 * (i - 15),), "brightness").apply(images, 1, None)


def _shifted(images: Images, pixels: int) -> Images:
    unturned = torch.eye(2, dtype=torch.float64).expand(len(images), 2, 2)
    return affine_warp(images, unturned, torch.tensor([-float(pixels), 0.0]).expand(len(images), 2))


def _rotated(images: Images, angle: float) -> Images:
    cosine, sine = math.cos(angle), math.sin(angle)
    back = torch.tensor([[cosine, sine], [-sine, cosine]], dtype=torch.float64)
    return eight_bit(affine_warp(images, back.expand(len(images), 2, 2)), "corrected")


def _scaled(images: Images, factor: float) -> Images:
    back = torch.eye(2, dtype=torch.float64) / factor
    return eight_bit(affine_warp(images, back.expand(len(images), 2, 2)), "corrected")


def _tilted(images: Images, angle: float) -> Images:
    """The image as a plane, turned about its two axes through its middle, viewed from the distance of its diagonal."""
    height, width = images.shape[-2:]
    focal, cosine, sine = math.hypot(width, height), math.cos(angle), math.sin(angle)
    middle = torch.tensor([[1.0, 0, -width / 2], [0, 1, -height / 2], [0, 0, 1]], dtype=torch.float64)
    about_y = torch.tensor([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]], dtype=torch.float64)
    about_x = torch.tensor([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]], dtype=torch.float64)
    away = torch.tensor([0.0, 0.0, focal], dtype=torch.float64)
    onto = torch.tensor([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]], dtype=torch.float64)
    placed = about_x @ about_y @ middle
    placed[:, 2] += away
    back = torch.linalg.inv(onto @ placed)
    rows, columns = torch.meshgrid(torch.arange(height).double(), torch.arange(width).double(), indexing="ij")
    points = torch.stack([columns, rows, torch.ones_like(rows)], -1) @ back.T
    sources = (points[..., :2] / points[..., 2:]).to(images).expand(len(images), -1, -1, -1)
    return eight_bit(bilinear(images, sources[..., 1], sources[..., 0], "zero"), "corrected")
