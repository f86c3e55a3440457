"""Digital: contrast, colour, warping and compression, as caused by processing and storage."""

import math
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int64, UInt8
from PIL import Image
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption, Mode
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

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
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

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
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


def jpeg_round_trip(pixels: UInt8[np.ndarray, "h w c"], quality: int) -> UInt8[np.ndarray, "h w c"]:
    """One image of one or three channels, encoded and decoded by Pillow.

    Example:
        >>> grey = np.full((8, 8, 1), 128, np.uint8)
        >>> bool((jpeg_round_trip(grey, 10) == grey).all())  # mid-grey is 0 in every coefficient
        True
        >>> noise = np.random.default_rng(0).integers(0, 256, (16, 16, 1), dtype=np.uint8)
        >>> low, high = (abs(jpeg_round_trip(noise, quality).astype(int) - noise).mean() for quality in (10, 95))
        >>> bool(low > high)
        True
    """
    encoded = BytesIO()
    Image.fromarray(pixels[..., 0] if pixels.shape[2] == 1 else pixels).save(encoded, "JPEG", quality=quality)
    with Image.open(encoded) as decoded:
        return np.asarray(decoded).reshape(pixels.shape)


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

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Encode and decode every image; images are rounded to 8 bits first.

        Raises:
            ValueError: images have neither one nor three channels.
        """
        if images.shape[1] not in (1, 3):
            raise ValueError(f"JPEG takes images of 1 or 3 channels, not {images.shape[1]}")
        pixels = to_bytes(images, "corrected").permute(0, 2, 3, 1).cpu().contiguous().numpy()
        decoded = np.stack([jpeg_round_trip(image, self.row(level)) for image in pixels])
        return (torch.from_numpy(decoded).permute(0, 3, 1, 2).contiguous().to(images.device) / 255).to(images.dtype)


PILLOW_UNIT = 2**22


@lru_cache(maxsize=64)
def box_weights(before: int, after: int) -> tuple[Tensor, int]:
    """The integer weights ``(after, before)`` of a pass from ``before`` pixels to ``after``, and their unit.

    Weights and unit are divided by their common factor; the type is the smallest that holds all sums.
    """
    scale = before / after
    half = 0.5 * max(scale, 1.0)
    weights = torch.zeros(after, before, dtype=torch.int64)
    for i in range(after):
        centre = (i + 0.5) * scale
        first, last = max(int(centre - half + 0.5), 0), min(int(centre + half + 0.5), before)
        taken = [j for j in range(first, last) if -0.5 < (j - centre + 0.5) / max(scale, 1.0) <= 0.5]
        weights[i, taken] = math.floor(0.5 + PILLOW_UNIT / len(taken))
    common = math.gcd(PILLOW_UNIT, *weights.unique().tolist())
    unit = PILLOW_UNIT // common
    return (weights // common).to(torch.float32 if 256 * unit <= 2**24 else torch.float64), unit


def box_resize(pixels: Float[Tensor, "b c h w"], height: int, width: int) -> Float[Tensor, "b c p q"]:
    """Whole values 0 ... 255, resized as ``PIL.Image.resize((width, height), BOX)`` does.

    Example:
        >>> box_resize(torch.tensor([[[[0.0, 10.0, 100.0, 101.0]] * 2]]), 1, 2)  # means of 2x2 pixels; 100.5 goes up
        tensor([[[[  5., 101.]]]])
    """
    if width != pixels.shape[-1]:
        weights, unit = _weights_for(pixels, pixels.shape[-1], width)
        pixels = _rounded(pixels.to(weights) @ weights.T, unit)
    if height != pixels.shape[-2]:
        weights, unit = _weights_for(pixels, pixels.shape[-2], height)
        pixels = _rounded(weights @ pixels.to(weights), unit)
    return pixels


def _weights_for(pixels: Tensor, before: int, after: int) -> tuple[Tensor, int]:
    weights, unit = box_weights(before, after)
    # a GPU may be configured to multiply float32 with 11 bits (TF32)
    return (weights if pixels.device.type == "cpu" else weights.to(pixels.device, torch.float64)), unit


def _rounded(sums: Float[Tensor, "*n"], unit: int) -> Float[Tensor, "*n"]:
    # the weights of a mean of three are rounded and may sum to more than the unit, but never to half a grey level more
    return sums if unit == 1 else sums.mul_(1 / unit).add_(0.5).floor_()


@dataclass(frozen=True)
class Pixelate(BenchmarkCorruption[float, None]):
    r"""Down to ``⌊f n⌋`` pixels per axis and back up to n, by box filter.

    With a box filter, Pillow resizes one axis after the other, columns first. A pass takes weights as integers in units
    of :math:`2^{-22}`, adds, and rounds to 8 bits: :math:`y_i = \lfloor (Σ_j W_{ij} x_j + 2^{21}) / 2^{22} \rfloor`.
    The sums are whole numbers that fit into float64, and into float32 where every mean is of one, two or four pixels,
    so matrix products give the same bytes for a whole batch, on any device.

    Source: Hendrycks & Dietterich, ICLR 2019, with Pillow.

    >>> image = torch.tensor([[[[0.0, 0.4, 1.0, 0.6]] * 2]])
    >>> Pixelate((0.5,), "pixelate")(image, level=1, indices=[0], seed=0)[0, 0, 0]  # blocks of two by two
    tensor([0.2000, 0.2000, 0.8000, 0.8000])

    Args:
        table: f for each severity.
        name: the corruption's name.
        levels: the severities to test at.
    """

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: None) -> Float[Tensor, "b c h w"]:
        """Resize down and up; images are rounded to 8 bits first."""
        height, width = images.shape[-2:]
        factor = self.row(level)
        pixels = (images.float() * 255).round_().clamp_(0, 255)
        small = box_resize(pixels, max(int(height * factor), 1), max(int(width * factor), 1))
        return (box_resize(small, height, width).float() / 255).to(images.dtype)


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

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> ElasticDraw:
        """Shifts of the corners, and noise."""
        corners = torch.empty(len(indices), 3, 2, dtype=torch.float64)
        noise = torch.empty(len(indices), 2, *shape[1:], dtype=torch.float32)
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
