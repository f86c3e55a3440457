"""Fog: a plasma fractal is added, and the whole is dimmed back to the image's range."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.weather.plasma import map_side, plasma

MAP_POINTS = 2**21  # points of the maps that are in memory at once


@dataclass(frozen=True)
class Fog(BenchmarkCorruption[tuple[float, float], Tensor]):
    """``y = (x + c·P) · m / (m + c)`` with ``m = max x`` over the image and ``P`` a plasma fractal in [0, 1].

    Every channel gets the same fog, and a black image stays black. The side of the map is the next power of two of the
    image's longer side, and its corner is used, as in CIFAR-10-C (32 for 32 pixels) and ImageNet-C (256 for 224).
    MNIST-C takes its 28 pixels from a map of 256, of which so small a corner is smooth: ``map_size=256``.

    Source: Hendrycks & Dietterich, "Benchmarking neural network robustness", ICLR 2019, and its published code.

    >>> foggy = Fog(((1.5, 2.0),), "fog")(torch.eye(16)[None, None], level=1, indices=[0], seed=0)
    >>> foggy.mean() > 1 / 16, foggy.max() <= 1
    (tensor(True), tensor(True))

    Args:
        table: (c, decay of the plasma) for each severity.
        map_size: side of the map, a power of two; None, or less than the image, takes the smallest that covers it.
    """

    map_size: int | None = None

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Float[Tensor, "b n n"]:
        """The perturbation of each point of the map, uniform in [-1, 1]."""
        side = max(map_side(*shape[-2:]), self.map_size or 0)
        noise = torch.empty(len(indices), side, side)
        for one, generator in zip(noise, self.streams(level, indices, seed), strict=True):
            one.uniform_(-1, 1, generator=generator)
        return noise

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Float[Tensor, "b n n"]
    ) -> Float[Tensor, "b c h w"]:
        """Add the fog and rescale."""
        amount, decay = self.row(level)
        size = (images.shape[-2], images.shape[-1])
        at_once = max(1, MAP_POINTS // params[0].numel())
        maps = [plasma(part.to(images.device), decay, size) for part in params.split(at_once)]
        fog = torch.cat(maps)[:, None].to(images)
        brightest = images.amax((1, 2, 3), keepdim=True)
        return ((images + amount * fog) * brightest / (brightest + amount)).clamp(0, 1)
