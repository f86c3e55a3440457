"""JPEG compression."""

from dataclasses import dataclass
from io import BytesIO

import numpy as np
import torch
from jaxtyping import Float, Int64, UInt8
from PIL import Image
from torch import Tensor

from sextant.corruptions.benchmark_corruption import BenchmarkCorruption
from sextant.corruptions.eight_bit import to_bytes


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
    """JPEG compression by Pillow, on the CPU whatever the device, so that every run sees the same bytes.

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

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> None:
        """Nothing is random."""

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
