"""Snow: flakes blown one way and the opposite way over a whitened image."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.eight_bit import eight_bit
from sextant.corruptions.filtering.clipped_zoom import clipped_zoom
from sextant.corruptions.filtering.motion_kernel import motion_blur
from sextant.corruptions.luma import luma

ANGLES = (-135.0, -45.0)


class SnowDraw(NamedTuple):
    """Standard normal noise from which the flakes are made, and the wind's angle in degrees."""

    noise: Float[Tensor, "b h w"]
    angles: Float64[Tensor, "b"]


class SnowRow(NamedTuple):
    """One severity: mean, spread, zoom and threshold of flakes, radius and sigma of their blur, the image's share."""

    mean: float
    spread: float
    zoom: float
    threshold: float
    radius: float
    sigma: float
    mix: float


@dataclass(frozen=True)
class Snow(BenchmarkCorruption[tuple[float, ...], SnowDraw]):
    """``y = w + s + rot180(s)`` with ``w = mix·x + (1 - mix)·max(x, 1.5·luma(x) + 0.5)``, clipped to [0, 1].

    The flakes ``s`` are normal noise, zoomed about the centre, set to 0 below a threshold, clipped to [0, 1] and
    blurred along the wind, whose angle is uniform in [-135°, -45°]; turned by 180° they fall a second time.

    Source: Hendrycks & Dietterich, "Benchmarking neural network robustness", ICLR 2019, and its published code.

    >>> row = SnowRow(mean=0.1, spread=0.3, zoom=2, threshold=0.5, radius=4, sigma=2, mix=0.8)
    >>> snowy = Snow((row,), "snow")(torch.zeros(1, 3, 32, 32), level=1, indices=[0], seed=0)
    >>> snowy.min()  # 0.2 · 0.5: where there is no flake the image is whiter all the same
    tensor(0.1000)

    Args:
        table: the values of :class:`SnowRow` for each severity.
        mode: ``faithful`` holds the flakes in 8 bits before the blur (rounded down) and after it (rounded), as the
            benchmark does by way of PNG files; ``corrected`` does not round them.
    """

    mode: Mode = "faithful"

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> SnowDraw:
        """Noise and wind."""
        noise, angles = torch.empty(len(indices), *shape[-2:]), torch.empty(len(indices), dtype=torch.float64)
        for i, generator in enumerate(self.streams(level, indices, seed)):
            noise[i].normal_(generator=generator)
            angles[i].uniform_(*ANGLES, generator=generator)
        return SnowDraw(noise, angles)

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: SnowDraw) -> Float[Tensor, "b c h w"]:
        """Whiten the image and let the drawn flakes fall."""
        row = SnowRow(*self.row(level))
        flakes = clipped_zoom(params.noise[:, None].to(images) * row.spread + row.mean, row.zoom)
        flakes = flakes.where(flakes >= row.threshold, 0).clamp(0, 1)
        if self.mode == "faithful":
            flakes = eight_bit(flakes, "faithful")
        flakes = motion_blur(flakes, row.radius, row.sigma, params.angles)
        if self.mode == "faithful":
            flakes = eight_bit(flakes, "corrected")  # ImageMagick rounds to the nearest
        whiter = row.mix * images + (1 - row.mix) * torch.maximum(images, 1.5 * luma(images) + 0.5)
        return (whiter + flakes + flakes.flip(-2, -1)).clamp(0, 1)
