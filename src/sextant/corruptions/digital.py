"""Digital: contrast, colour, warping and compression, as caused by processing and storage."""

from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
from sextant.corruptions.contract import Images, Positions
from sextant.corruptions.filtering import bilinear, gaussian_filter
from sextant.corruptions.pixels import to_bytes


@dataclass(frozen=True)
class Contrast(BenchmarkCorruption[float, None]):
    """``y = clip((x - m) c + m)`` with m the image's mean in each channel.

    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> import torch
    >>> Contrast((0.5,), "contrast")(torch.tensor([[[[0.2, 0.6]]]]), level=1, indices=[0], seed=0)
    tensor([[[[0.3000, 0.5000]]]])

    Args:
        table: c for each severity; 1 changes nothing.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Draw every value to the mean of its channel."""
        return images.mean((2, 3), keepdim=True).lerp(images, self.row(level)).clamp(0, 1)


@dataclass(frozen=True)
class Saturate(BenchmarkCorruption[tuple[float, float], None]):
    r"""``S' = clip(c₀ S + c₁)`` in HSV.

    With hue and value :math:`V = \max(r, g, b)` kept, a new saturation S' in place of
    :math:`S = (V - \min(r, g, b)) / V` moves every channel to :math:`V - (V - x)\, S'/S`. So no conversion is needed.

    A grey pixel of a colour image has no hue, and its saturation cannot be raised: ``corrected`` leaves it as it is.
    The authors' conversion gives it the hue 0, and with c₁ > 0 it turns reddish: ``faithful`` keeps that. An image of
    one channel has no colour and is returned as it is.

    Source: Hendrycks & Dietterich, ICLR 2019 (an extra corruption, for validation). The published rows are not in the
    order of their effect: the first two take colour away, the others add to it.

    >>> reddish = torch.tensor([0.8, 0.4, 0.4]).view(1, 3, 1, 1)
    >>> Saturate(((0.5, 0.0),), "saturate")(reddish, level=1, indices=[0], seed=0).flatten()  # half the saturation
    tensor([0.8000, 0.6000, 0.6000])

    Args:
        table: (c₀, c₁) for each severity.
        name: the corruption's name.
        levels: the severities to test at.
        mode: how grey pixels are treated.
    """

    mode: Mode = "faithful"

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Move every channel away from, or towards, the value of its pixel."""
        if images.shape[1] == 1:
            return images.clone()
        factor, shift = self.row(level)
        work = images.to(torch.promote_types(images.dtype, torch.float32))  # half precision has no 1e-12
        value = work.amax(1, keepdim=True)
        spread = value - work.amin(1, keepdim=True)
        saturation = spread / value.clamp(min=1e-12)
        wanted = (saturation * factor + shift).clamp(0, 1)
        coloured = value - (value - work) * (wanted / saturation.clamp(min=1e-12))
        red = torch.tensor([0.0, 1.0, 1.0], device=work.device, dtype=work.dtype)[:, None, None]
        grey = value * (1 - wanted * red) if self.mode == "faithful" else work
        return torch.where(spread > 0, coloured, grey).clamp(0, 1).to(images.dtype)


def jpeg_round_trip(picture: Image.Image, quality: int) -> Image.Image:
    """A grey or colour image, encoded and decoded by Pillow.

    Example:
        >>> jpeg_round_trip(Image.new("L", (8, 8), 128), 10).getextrema()  # mid-grey is 0 in every coefficient
        (128, 128)
        >>> noise = np.random.default_rng(0).integers(0, 256, (16, 16), dtype=np.uint8)
        >>> decoded = (jpeg_round_trip(Image.fromarray(noise), quality) for quality in (10, 95))
        >>> low, high = (abs(np.asarray(each, int) - noise).mean() for each in decoded)
        >>> bool(low > high)
        True
    """
    encoded = BytesIO()
    picture.save(encoded, "JPEG", quality=quality)
    return Image.open(encoded)


def _each(images: Images, change: Callable[[Image.Image], Image.Image]) -> Images:
    """``images``, rounded to 8 bits, each changed by Pillow."""
    pixels = to_bytes(images, "corrected").permute(0, 2, 3, 1).cpu().contiguous().numpy()
    pictures = pixels[..., 0] if pixels.shape[3] == 1 else pixels
    changed = np.stack([np.asarray(change(Image.fromarray(picture))) for picture in pictures]).reshape(pixels.shape)
    return (torch.from_numpy(changed).permute(0, 3, 1, 2).contiguous().to(images.device) / 255).to(images.dtype)


@dataclass(frozen=True)
class JPEGCompression(BenchmarkCorruption[int, None]):
    """JPEG compression by Pillow, on the CPU whatever the device, so that every run gets the same bytes.

    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> image = torch.rand(1, 3, 16, 16)
    >>> high, low = (JPEGCompression((quality,), "jpeg")(image, 1, [0], seed=0) for quality in (95, 10))
    >>> (high - image).abs().mean() < (low - image).abs().mean()
    tensor(True)

    Args:
        table: JPEG quality for each severity.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Encode and decode every image; images are rounded to 8 bits first.

        Raises:
            ValueError: images have neither one nor three channels.
        """
        if images.shape[1] not in (1, 3):
            raise ValueError(f"JPEG takes images of 1 or 3 channels, not {images.shape[1]}")
        quality = self.row(level)
        return _each(images, lambda picture: jpeg_round_trip(picture, quality))


@dataclass(frozen=True)
class Pixelate(BenchmarkCorruption[float, None]):
    """Down to ``⌊f n⌋`` pixels per axis and back up to n by Pillow's box filter, on the CPU whatever the device.

    Source: Hendrycks & Dietterich, ICLR 2019.

    >>> image = torch.tensor([[[[0.0, 0.4, 1.0, 0.6]] * 2]])
    >>> Pixelate((0.5,), "pixelate")(image, level=1, indices=[0], seed=0)[0, 0, 0]  # blocks of two by two
    tensor([0.2000, 0.2000, 0.8000, 0.8000])

    Args:
        table: f for each severity.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def apply(self, images: Images, level: float, params: None) -> Images:
        """Resize down and up; images are rounded to 8 bits first."""
        height, width = images.shape[-2:]
        factor, box = self.row(level), Image.Resampling.BOX
        small = (max(int(width * factor), 1), max(int(height * factor), 1))
        return _each(images, lambda picture: picture.resize(small, box).resize((width, height), box))


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
    r"""Affine warp, then smooth displacement.

    Three corners of a square of half side :math:`s = \lfloor n/3 \rfloor` about the centre move by :math:`U(-γ, γ)^2`,
    which fixes an affine map; the image is warped by it (mirrored at the centres of its edge pixels). Then :math:`y(p)
    = x(p + α\, G_σ * u(p))` with :math:`u \sim U(-1, 1)` at every pixel and axis, ``G`` cut at 3σ, and the image
    mirrored at its edges. Both samplings are bilinear.

    The table holds (α, σ, γ) as fractions of the smaller side n of the image, which is how the authors write them.

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

    def draw(self, level: float, indices: Positions, shape: tuple[int, ...], seed: int) -> ElasticDraw:
        """Shifts of the corners, and noise."""
        corners = torch.empty(len(indices), 3, 2, dtype=torch.float64)
        noise = torch.empty(len(indices), 2, *shape[1:], dtype=torch.float32)
        for corner, field, stream in zip(corners, noise, self.streams(level, indices, seed), strict=True):
            corner.uniform_(-1, 1, generator=stream)
            field.uniform_(-1, 1, generator=stream)
        return ElasticDraw(corners, noise)

    def apply(self, images: Images, level: float, params: ElasticDraw) -> Images:
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
