"""Noise: sensor and transmission noise, independent at every pixel."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import torch
from annotated_types import Gt, Le
from jaxtyping import Float, Int8
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.contract import Images, Positions
from sextant.corruptions.corruption import Corruption, filled, generators, image_seeds
from sextant.ranges import NonNegative, Positive, checked


@checked
@dataclass(frozen=True)
class GaussianNoise(Corruption[Tensor]):
    """``y = x + n`` with ``n ~ N(0, variance)`` independent at every value.

    Source: Strisciuglio et al. 2020, section 4.1 (MNIST); the paper does not clip.

    >>> noisy = GaussianNoise([0.01])(torch.zeros(2, 1, 28, 28), level=0.01, indices=[0, 1], seed=0)
    >>> noisy.std()  # the root of the variance
    tensor(0.0990)

    Args:
        levels: noise variances, at least 0.
        clip: clip the result to [0, 1].
        name: the corruption's name.
    """

    levels: Sequence[NonNegative]
    clip: bool = False
    name: str = "gaussian"

    def check_level(self, level: float) -> None:
        """Raise a ``ValueError`` unless ``level`` is a variance."""
        super().check_level(level)
        if level < 0:
            raise ValueError(f"a level of {self.name} is a variance, at least 0, not {level!r}")

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Float[Tensor, "b c h w"]:
        """The noise itself."""
        streams, std = generators(image_seeds(self.name, level, indices, seed)), math.sqrt(level)
        return filled(shape, streams, lambda image, stream: image.normal_(std=std, generator=stream))

    def apply(self, images: Images, level: float, params: Float[Tensor, "b c h w"]) -> Images:
        """Add the drawn noise."""
        noisy = images + params.to(images)
        return noisy.clamp(0, 1) if self.clip else noisy


@dataclass(frozen=True)
class ClippedGaussianNoise(BenchmarkCorruption[float, Tensor]):
    """``y = clip(x + σ n)`` with ``n ~ N(0, 1)`` independent at every value.

    Source: Hendrycks & Dietterich, ICLR 2019. :class:`~sextant.corruptions.GaussianNoise` takes variances, and its
    clipping is optional.

    >>> grey = torch.full((1, 1, 28, 28), 0.5)
    >>> ClippedGaussianNoise((0.1,), "gaussian_noise")(grey, level=1, indices=[0], seed=0).std()
    tensor(0.1005)

    Args:
        table: standard deviation σ for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Float[Tensor, "b c h w"]:
        """The standard normal ``n``."""
        streams = self.streams(level, indices, seed)
        return filled(shape, streams, lambda image, stream: image.normal_(generator=stream))

    def apply(self, images: Images, level: float, params: Float[Tensor, "b c h w"]) -> Images:
        """Add the drawn noise and clip."""
        return (images + self.row(level) * params.to(images)).clamp(0, 1)


@dataclass(frozen=True)
class SpeckleNoise(ClippedGaussianNoise):
    """``y = clip(x + σ x n)`` with ``n ~ N(0, 1)`` independent at every value.

    Source: Hendrycks & Dietterich, ICLR 2019 (an extra corruption, for validation).

    >>> import torch
    >>> image = torch.tensor([0.0, 0.1, 0.5]).view(1, 1, 1, 3)
    >>> SpeckleNoise((0.2,), "speckle_noise")(image, level=1, indices=[0], seed=0)  # black stays black
    tensor([[[[0.0000, 0.0956, 0.4346]]]])

    Args:
        table: σ for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def apply(self, images: Images, level: float, params: Float[Tensor, "b c h w"]) -> Images:
        """Add the drawn noise times the image, and clip."""
        return super().apply(images, level, params.to(images) * images)


class PhotonNoise(Corruption[list[int]]):
    """Noise of photons that are counted: a count depends on the image, so that its stream is the parameter."""

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> list[int]:
        """The seeds of the photon streams."""
        return image_seeds(self.name, level, indices, seed)


def photons(values: Images, peak: float, seeds: list[int]) -> Images:
    """``Poisson(peak · z) / peak`` of values ``z``, counted on the CPU from the stream of each seed."""
    rates = (values * peak).clamp(min=0).cpu()
    counts = [torch.poisson(rate, stream) for rate, stream in zip(rates, generators(seeds), strict=True)]
    return torch.stack(counts) / peak


@dataclass(frozen=True)
class ShotNoise(PhotonNoise, BenchmarkCorruption[float, list[int]]):
    """``y = clip(Poisson(c x) / c)``, so that the variance is ``x / c`` before clipping.

    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> grey = torch.full((1, 1, 1, 6), 0.5)
    >>> ShotNoise((10.0,), "shot_noise")(grey, level=1, indices=[0], seed=0)  # whole tenths
    tensor([[[[0.6000, 0.4000, 0.7000, 0.8000, 0.2000, 0.2000]]]])

    Args:
        table: photon count c of a white pixel for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def apply(self, images: Images, level: float, params: list[int]) -> Images:
        """Count photons from the drawn streams, on the CPU."""
        return photons(images.float(), self.row(level), params).clamp(0, 1).to(images)


@dataclass(frozen=True)
class ImpulseNoise(BenchmarkCorruption[float, Tensor]):
    """Each value, independently, becomes 0 with probability p/2 and 1 with probability p/2.

    Source: Hendrycks & Dietterich, ICLR 2019; their ``skimage.util.random_noise`` treats the channels of a pixel
    independently, and so does this.

    >>> grey = torch.full((1, 1, 2, 4), 0.5)
    >>> ImpulseNoise((0.5,), "impulse_noise")(grey, level=1, indices=[0], seed=0)
    tensor([[[[0.5000, 0.5000, 0.5000, 0.5000],
              [0.5000, 1.0000, 0.0000, 1.0000]]]])

    Args:
        table: p for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
    """

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> Int8[Tensor, "b c h w"]:
        """-1 where a value becomes black, 1 where white, 0 where it stays."""
        streams, amount = self.streams(level, indices, seed), self.row(level)
        share = filled(shape, streams, lambda image, stream: image.uniform_(generator=stream))
        return (share < amount).to(torch.int8) - 2 * (share < amount / 2).to(torch.int8)

    def apply(self, images: Images, level: float, params: Int8[Tensor, "b c h w"]) -> Images:
        """Set the drawn values to black and white."""
        return (images + 2 * params.to(images)).clamp(0, 1)


@checked
@dataclass(frozen=True)
class ContrastPoisson(PhotonNoise):
    """``y = Poisson(peak · z) / peak`` with ``z = (x - 1/2) · contrast + 1/2``.

    Source: Strisciuglio et al. 2020, section 4.1 (MNIST). The paper does not state the Poisson scale; ``peak = 256``
    counts at white is what scikit-image's ``random_noise`` uses on an 8-bit image.

    >>> darker = ContrastPoisson([0.5])(torch.ones(1, 1, 28, 28), level=0.5, indices=[0], seed=0)
    >>> darker.mean()  # 1/2 + 0.5 / 2
    tensor(0.7482)

    Args:
        levels: contrast factors in (0, 1]; 1 leaves the contrast as it is.
        peak: photon count of a white pixel, above 0.
        clip: clip the result to [0, 1].
        name: the corruption's name.
    """

    levels: Sequence[Annotated[float, Gt(0), Le(1)]]
    peak: Positive = 256.0
    clip: bool = False
    name: str = "contrast_poisson"

    def check_level(self, level: float) -> None:
        """Raise a ``ValueError`` unless ``level`` is a contrast factor."""
        super().check_level(level)
        if not 0 < level <= 1:
            raise ValueError(f"a level of {self.name} is a contrast factor in (0, 1], not {level!r}")

    def apply(self, images: Images, level: float, params: list[int]) -> Images:
        """Reduce the contrast by the factor ``level``, then count photons from the drawn streams."""
        noisy = photons((images - 0.5) * level + 0.5, self.peak, params).to(images)
        return noisy.clamp(0, 1) if self.clip else noisy
