"""Blur of frosted glass: pixels change places with neighbours, between two Gaussian blurs.

Scanning from the last row and column, every pixel p is swapped with p + d, with d drawn from {-m, ..., m - 1}² for a
largest distance m. Where a pixel ends up does not depend on its value: the swaps are played out on an index, whose
result is the drawn parameter, and applying it to a batch is one gather on any device.

The authors' code swaps views of an array, so that in a colour image p takes the colour of p + d while p + d keeps its
own, and it truncates the first blur to 8 bits. ``faithful`` keeps both. ``corrected`` swaps the two and does not round.
The values of a grey image are not views: they are swapped in either mode.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.compiled import compiled
from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.eight_bit import to_bytes
from sextant.corruptions.filtering.gaussian_filter import gaussian_filter


@dataclass(frozen=True)
class GlassBlur(BenchmarkCorruption[tuple[float, int, int], Tensor]):
    """Gaussian blur, local shuffling of pixels, Gaussian blur.

    Source: Hendrycks & Dietterich, ICLR 2019; for ``chance`` and ``down_only`` Mu & Gilmer 2019 (MNIST-C).

    >>> image = torch.zeros(1, 1, 8, 8)
    >>> image[..., 4:] = 1  # an edge, which becomes ragged
    >>> GlassBlur(((0.1, 1, 1),), "glass_blur")(image, level=1, indices=[0], seed=0)[0, 0, 2:5].round()
    tensor([[0., 1., 1., 0., 1., 1., 1., 1.],
            [0., 0., 0., 0., 0., 1., 1., 1.],
            [0., 0., 0., 1., 0., 1., 1., 1.]])

    Args:
        table: (σ in pixels, largest distance m, passes) for each severity.
        name: the corruption's name; enters the seeds.
        levels: the severities to test at.
        mode: whether colours are copied (``faithful``) or swapped (``corrected``).
        chance: probability that a pixel is swapped at all: 1, and in MNIST-C 1/2.
        down_only: blur along columns alone, as MNIST-C's authors do by taking the columns of a grey image for channels;
            ``corrected`` blurs both ways.
    """

    mode: Mode = "faithful"
    chance: float = 1.0
    down_only: bool = False

    def draw(
        self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int
    ) -> Int64[Tensor, "b h w"]:
        """The pixel ``row · w + column`` that each pixel takes its colour from."""
        _, reach, passes = self.row(level)
        channels, height, width = shape
        meetings = (passes, max(height - 2 * reach, 0), max(width - 2 * reach, 0))
        sources = torch.arange(height * width).repeat(len(indices), 1).view(-1, height, width)
        copies = self.mode == "faithful" and channels > 1
        for source, stream in zip(sources, self.streams(level, indices, seed), strict=True):
            moves = torch.randint(-reach, reach, (*meetings, 2), generator=stream)
            if self.chance < 1:  # a pixel that is swapped with itself stays
                moves *= (torch.rand(meetings, generator=stream) < self.chance)[..., None]
            _play(source.numpy(), moves.numpy(), reach, copies)
        return sources

    def apply(
        self, images: Float[Tensor, "b c h w"], level: float, params: Int64[Tensor, "b h w"]
    ) -> Float[Tensor, "b c h w"]:
        """Blur, let every pixel take its colour from the drawn one, and blur again."""
        sigma = self.row(level)[0]
        sigmas = (sigma, 0.0 if self.down_only and self.mode == "faithful" else sigma)
        work = images.to(torch.promote_types(images.dtype, torch.float32))
        blurred = gaussian_filter(work, sigmas)
        if self.mode == "faithful":
            blurred = to_bytes(blurred)
        places = params.to(images.device).flatten(1)[:, None].expand(-1, images.shape[1], -1)
        shuffled = blurred.flatten(2).gather(2, places).view_as(images)
        if self.mode == "faithful":
            shuffled = shuffled.to(work.dtype).div_(255)
        return gaussian_filter(shuffled, sigmas).clamp(0, 1).to(images.dtype)


@compiled
def _play(source, moves, reach, copies):  # type: ignore[no-untyped-def]
    passes, rows, columns, _ = moves.shape
    height, width = source.shape
    for turn in range(passes):
        for i in range(rows):
            for j in range(columns):
                y, x = height - reach - i, width - reach - j
                other_y, other_x = y + moves[turn, i, j, 1], x + moves[turn, i, j, 0]
                mine = source[y, x]
                source[y, x] = source[other_y, other_x]
                if not copies:
                    source[other_y, other_x] = mine
