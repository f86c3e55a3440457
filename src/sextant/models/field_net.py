"""GeoCalib's network: image to a perspective field with confidences.

Sources: A. Veicht et al., "GeoCalib: learning single-image calibration with geometric optimization", ECCV 2024; for the
encoder M.-H. Guo et al., "SegNeXt: rethinking convolutional attention design for semantic segmentation", NeurIPS 2022;
for the decoder Z. Geng et al., "Is attention better than matrix decomposition?", ICLR 2021.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

#: lengths of the strips whose crossings gather the surroundings of a cell
STRIPS = (7, 11, 21)
#: factors of the matrix decomposition, and its steps; the initial factors are drawn with a fixed seed
FACTORS, STEPS, TINY = 64, 7, 1e-6
#: sides of images are multiples of the encoder's steps
MULTIPLE = 32


class StripAttention(nn.Module):
    """Weighs each cell by a mixture of its surroundings, which crossed strips of several lengths gather."""

    def __init__(self, width: int):
        super().__init__()
        self.before = nn.Conv2d(width, width, 1)
        self.near = nn.Conv2d(width, width, 5, padding=2, groups=width)
        self.across = nn.ModuleList(_depthwise(width, (1, length)) for length in STRIPS)
        self.down = nn.ModuleList(_depthwise(width, (length, 1)) for length in STRIPS)
        self.mix = nn.Conv2d(width, width, 1)
        self.after = nn.Conv2d(width, width, 1)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        """The weighed cells, added to the input."""
        inner = F.gelu(self.before(x))
        near = self.near(inner)
        strips = zip(self.across, self.down, strict=True)
        gathered: Tensor = near + sum(down(across(near)) for across, down in strips)
        found: Tensor = x + self.after(self.mix(gathered) * inner)
        return found


class StripBlock(nn.Module):
    """Attention, then two layers with the neighbours between them; both scaled by channel and added."""

    def __init__(self, width: int, hidden: int):
        super().__init__()
        self.first_norm, self.second_norm = nn.BatchNorm2d(width), nn.BatchNorm2d(width)
        self.attention = StripAttention(width)
        self.widen, self.narrow = nn.Conv2d(width, hidden, 1), nn.Conv2d(hidden, width, 1)
        self.near = _depthwise(hidden, (3, 3))
        self.first_scale, self.second_scale = nn.Parameter(torch.ones(width)), nn.Parameter(torch.ones(width))

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        """Cells of the same width."""
        x = x + self.first_scale[:, None, None] * self.attention(self.first_norm(x))
        hidden = F.gelu(self.near(self.widen(self.second_norm(x))))
        found: Tensor = x + self.second_scale[:, None, None] * self.narrow(hidden)
        return found


class StripEncoder(nn.Module):
    """Maps of the image at a quarter, eighth, sixteenth and thirty-second of its size."""

    def __init__(self, widths: Sequence[int], depths: Sequence[int], hidden: Sequence[int]):
        super().__init__()
        first, half = widths[0], widths[0] // 2
        stem = nn.Sequential(
            nn.Conv2d(3, half, 3, 2, 1), nn.BatchNorm2d(half), nn.GELU(),
            nn.Conv2d(half, first, 3, 2, 1), nn.BatchNorm2d(first),
        )  # fmt: skip
        steps = [
            nn.Sequential(nn.Conv2d(before, after, 3, 2, 1), nn.BatchNorm2d(after))
            for before, after in pairwise(widths)
        ]
        self.steps = nn.ModuleList([stem, *steps])
        self.blocks = nn.ModuleList(
            nn.Sequential(*(StripBlock(width, inner) for _ in range(depth)))
            for width, depth, inner in zip(widths, depths, hidden, strict=True)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(width) for width in widths)

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> list[Float[Tensor, "b _c _h _w"]]:
        """Maps of images in [0, 1]; the weights are of pictures of bytes whose first channel is blue."""
        x, found = 255 * images.flip(1), []
        for step, blocks, norm in zip(self.steps, self.blocks, self.norms, strict=True):
            x = norm(blocks(step(x)).movedim(1, -1)).movedim(-1, 1)
            found.append(x)
        return found


def decomposed(cells: Float[Tensor, "b c n"]) -> Float[Tensor, "b c n"]:
    r"""The nearest product of few non-negative factors, by the multiplicative updates of Lee and Seung (2001).

    >>> decomposed(torch.ones(1, 4, 9)).round(decimals=3).unique()
    tensor([1.])
    """
    drawn = torch.rand(1, cells.shape[1], FACTORS, generator=torch.Generator().manual_seed(0)).to(cells)
    bases = F.normalize(drawn, dim=1).expand(len(cells), -1, -1)
    shares = torch.softmax(cells.mT @ bases, -1)
    for _ in range(STEPS):
        shares = shares * (cells.mT @ bases) / (shares @ (bases.mT @ bases) + TINY)
        bases = bases * (cells @ shares) / (bases @ (shares.mT @ shares) + TINY)
    shares = shares * (cells.mT @ bases) / (shares @ (bases.mT @ bases) + TINY)
    return bases @ shares.mT


class FieldDecoder(nn.Module):
    """All maps of the encoder, decomposed, joined with a map at full size: numbers and a confidence for each pixel.

    Args:
        channels: of all maps of the encoder together.
        ham: channels that are decomposed.
        width: channels of the map at full size.
        numbers: predicted for each pixel.
    """

    def __init__(self, channels: int, ham: int, width: int, numbers: int):
        super().__init__()
        self.squeeze = nn.Conv2d(channels, ham, 1)
        self.before, self.after = nn.Conv2d(ham, ham, 1), nn.Conv2d(ham, ham, 1)
        self.align = nn.Conv2d(ham, width, 1)
        self.smooth = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.fine = _residual(width)
        self.fused = _residual(width)
        self.confidence = nn.Sequential(
            nn.Conv2d(width, width, 3, padding=1, bias=False), nn.ReLU(), nn.Conv2d(width, 1, 1)
        )
        self.numbers = nn.Conv2d(width, numbers, 1)

    def forward(
        self, maps: Sequence[Float[Tensor, "b _c _h _w"]], fine: Float[Tensor, "b d h w"]
    ) -> tuple[Float[Tensor, "b k h w"], Float[Tensor, "b h w"]]:
        """The numbers, and confidences in (0, 1)."""
        size = maps[0].shape[-2:]
        joined = torch.cat([F.interpolate(each, size, mode="bilinear") for each in maps], 1)
        x = F.relu(self.squeeze(joined))
        cells = F.relu(self.before(x)).flatten(2)
        x = F.relu(x + F.relu(self.after(decomposed(cells).unflatten(2, size))))
        x = F.interpolate(F.relu(self.align(x)), scale_factor=2, mode="bilinear")
        x = F.interpolate(F.relu(self.smooth(x)), scale_factor=2, mode="bilinear")
        x = F.relu(x + fine + self.fine(fine))
        x = x + self.fused(x)
        return self.numbers(x), torch.sigmoid(self.confidence(x)[:, 0])


class PredictedField(NamedTuple):
    """Fields of images.

    Attributes:
        latitude: radians.
        up: unit directions, x to the right and y down.
        latitude_confidence, up_confidence: from 0 to 1.
    """

    latitude: Float[Tensor, "b h w"]
    up: Float[Tensor, "b 2 h w"]
    latitude_confidence: Float[Tensor, "b h w"]
    up_confidence: Float[Tensor, "b h w"]


class FieldNet(nn.Module):
    """Images to perspective fields, as GeoCalib predicts them before it fits a camera.

    Args:
        widths, depths, hidden: channels, blocks and inner channels of the encoder's four stages.
        ham: channels that the decoders decompose.
        fine: channels of the map at full size.

    Example:
        >>> network = FieldNet((8, 8, 8, 8), (1, 1, 1, 1), (16, 16, 16, 16), ham=8, fine=4).eval()
        >>> [each.shape for each in network(torch.rand(1, 3, 32, 64))][:2]
        [torch.Size([1, 32, 64]), torch.Size([1, 2, 32, 64])]
    """

    def __init__(self, widths: Sequence[int], depths: Sequence[int], hidden: Sequence[int], ham: int, fine: int):
        super().__init__()
        self.encoder = StripEncoder(widths, depths, hidden)
        self.fine = nn.Sequential(
            nn.Conv2d(3, fine, 3, padding=1), nn.ReLU(), nn.Conv2d(fine, fine, 3, padding=1), nn.ReLU()
        )
        self.up = FieldDecoder(sum(widths), ham, fine, 2)
        self.latitude = FieldDecoder(sum(widths), ham, fine, 1)

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> PredictedField:
        """Fields of images in [0, 1] whose sides are multiples of :data:`MULTIPLE`."""
        maps, fine = self.encoder(images), self.fine(images)
        up, up_confidence = self.up(maps, fine)
        sine, latitude_confidence = self.latitude(maps, fine)
        latitude = torch.asin(torch.tanh(sine[:, 0]))
        return PredictedField(latitude, F.normalize(up, dim=1), latitude_confidence, up_confidence)


def _depthwise(width: int, kernel: tuple[int, int]) -> nn.Conv2d:
    return nn.Conv2d(width, width, kernel, padding=(kernel[0] // 2, kernel[1] // 2), groups=width)


def _residual(width: int) -> nn.Sequential:
    return nn.Sequential(
        nn.ReLU(), nn.Conv2d(width, width, 3, padding=1), nn.ReLU(), nn.Conv2d(width, width, 3, padding=1)
    )
