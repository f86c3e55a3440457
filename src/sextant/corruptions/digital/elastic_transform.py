r"""Random affine map followed by a smooth random displacement.

Three corners of a square of half side :math:`s = \lfloor n/3 \rfloor` about the centre move by
:math:`U(-γ, γ)^2`, which fixes an affine map; the image is warped by it (mirrored at the centres of its edge pixels).
Then :math:`y(p) = x(p + α\, G_σ * u(p))` with :math:`u \sim U(-1, 1)` at every pixel and axis, ``G`` cut at 3σ, and
the image mirrored at its edges. Both samplings are bilinear.

The table holds (α, σ, γ) as fractions of the smaller side n of the image, which is how the authors write them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.filtering.bilinear import bilinear
from sextant.corruptions.filtering.gaussian_filter import gaussian_filter

# OpenCV 4 and earlier, which the benchmark was made with, interpolates at multiples of 1/32 of a pixel
OPENCV_STEPS = 32


class ElasticDraw(NamedTuple):
    """The random part: where the three corners go, and the noise that is smoothed into displacements.

    ``corners`` are shifts (x, y) in units of γ ``(b, 3, 2)``; ``noise`` is ``(b, (x, y), h, w)``. Both are in [-1, 1).
    """

    corners: Float[Tensor, "b 3 2"]
    noise: Float[Tensor, "b 2 h w"]


@dataclass(frozen=True)
class ElasticTransform(BenchmarkCorruption[tuple[float, float, float], ElasticDraw]):
    """Affine warp, then smooth displacement.

    Source: Hendrycks & Dietterich, ICLR 2019, after Simard et al. 2003. The published rows are not in the order of
    their effect.

    >>> images, still, warped = torch.rand(2, 3, 16, 16), (0.0, 1.0, 0.0), (0.1, 0.1, 0.1)
    >>> elastic = ElasticTransform((still, warped), "elastic_transform")
    >>> [elastic(images, level, [0, 1], seed=0).allclose(images, atol=1e-6) for level in (1, 2)]
    [True, False]

    Args:
        table: (α, σ, γ) as fractions of the image's smaller side, for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
        mode: ``faithful`` rounds the points of the affine warp to 1/32 of a pixel, as OpenCV did, and takes the
            height for the width in the centre of an image that is not square; ``corrected`` does neither.
        unit: the side that fractions refer to, in units of the image's smaller side (ImageNet-C: 244/224, an error).
    """

    mode: Mode = "faithful"
    unit: float = 1.0

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> ElasticDraw:
        """Shifts of the corners, and noise."""
        corners = torch.empty(len(indices), 3, 2, dtype=torch.float64)
        noise = torch.empty(len(indices), 2, *shape[1:])
        for corner, field, stream in zip(corners, noise, self.streams(level, indices, seed), strict=True):
            corner.uniform_(-1, 1, generator=stream)
            field.uniform_(-1, 1, generator=stream)
        return ElasticDraw(corners, noise)

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: ElasticDraw) -> Float[Tensor, "b c h w"]:
        """Warp and displace.

        Raises:
            ValueError: images are smaller than 3 pixels, so that there is no square to move.
        """
        height, width = images.shape[-2:]
        if min(height, width) < 3:
            raise ValueError(f"an elastic transform needs images of at least 3x3 pixels, not {height}x{width}")
        side = min(height, width) * self.unit
        alpha, sigma, gamma = (side * fraction for fraction in self.row(level))
        work = images if images.dtype == torch.float64 else images.float()
        columns, rows = self._warped_points(params.corners * gamma, height, width)
        warped = bilinear(work, rows.to(work), columns.to(work), "mirror")
        if alpha > 0:
            shifts = gaussian_filter(params.noise.to(work), sigma, "reflect", 3.0) * alpha
            across = torch.arange(width).to(work) + shifts[:, 0]
            down = torch.arange(height).to(work)[:, None] + shifts[:, 1]
            warped = bilinear(warped, down, across, "reflect")
        return warped.clamp(0, 1).to(images.dtype)

    def _warped_points(
        self, shifts: Float[Tensor, "b 3 2"], height: int, width: int
    ) -> tuple[Float[Tensor, "b h w"], Float[Tensor, "b h w"]]:
        """Where the affine warp samples the image: columns and rows, float64 on the CPU."""
        centre = (height // 2, width // 2) if self.mode == "faithful" else (width // 2, height // 2)
        half = min(height, width) // 3
        signs = torch.tensor([[1, 1], [1, -1], [-1, -1]], dtype=torch.float64)
        corners = torch.tensor(centre, dtype=torch.float64) + half * signs  # (3, 2), (x, y)
        moved = torch.cat([corners + shifts, torch.ones(len(shifts), 3, 1, dtype=torch.float64)], -1)
        back = torch.linalg.solve(moved, corners.expand(len(shifts), 3, 2))  # (b, 3, 2): moved @ back = corners
        y, x = torch.meshgrid(torch.arange(height).double(), torch.arange(width).double(), indexing="ij")
        points = torch.stack([x, y, torch.ones_like(x)], -1).flatten(0, 1) @ back
        if self.mode == "faithful":
            points = (points * OPENCV_STEPS).round() / OPENCV_STEPS
        return points[..., 0].view(-1, height, width), points[..., 1].view(-1, height, width)
