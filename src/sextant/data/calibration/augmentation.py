r"""Training crops with changed light and sensor, and mirrored: changes that leave the calibration known.

A crop with values x in [0, 1] becomes

.. math:: c\,g\,(x^\gamma - \mu) + \mu + \varepsilon ,

with gamma :math:`\log_2 \gamma \sim U(-0.6, 0.6)`, contrast :math:`c \sim U(0.5, 1.3)` about the crop's mean μ, a gain
:math:`g = e^{0.15 n}` for each colour and noise ε with a standard deviation drawn from U(0, 0.05). Before that, the
crop is blurred or sharpened by a share of a 3 x 3 binomial filter. Mirroring negates the camera's roll and changes
nothing else of the camera.

What a crop gets is a function of (seed, number of the crop) alone.
"""

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.data.counters import uniforms

if TYPE_CHECKING:
    from sextant.data.calibration.crop_batch import CropBatch

#: noise is taken from this many fields, rolled at random: fresh noise would cost more than the crop
FIELDS = 32


def augmented(batch: "CropBatch", seed: int) -> "CropBatch":
    """Augment a batch of training crops as the module describes."""
    numbers: Int64[ndarray, "b"] = batch.indices.numpy()
    u = uniforms(numbers % 2**32, numbers // 2**32, 0, seed ^ 0x5EED, 10)
    mirrored = torch.from_numpy(u[9] < 0.5)
    images = torch.where(mirrored[:, None, None, None], batch.images.flip(-1), batch.images)
    roll = torch.where(mirrored, -batch.cameras.roll, batch.cameras.roll)
    return replace(batch, images=relit(images, u[:9]), cameras=batch.cameras._replace(roll=roll))


def relit(images: UInt8[Tensor, "b 3 h w"], u: Float[ndarray, "9 b"]) -> UInt8[Tensor, "b 3 h w"]:
    """Images with changed light and sensor, by nine numbers in (0, 1) for each."""
    v = torch.from_numpy(u).float()[:, :, None, None, None]
    x = images.float() / 255
    blurred = F.avg_pool2d(F.avg_pool2d(F.pad(x, (1, 1, 1, 1), mode="replicate"), 2, 1), 2, 1)
    x = (x + (1.4 * v[0] - 0.4) * (blurred - x)).clamp(0, 1)
    x = x.pow(2 ** (1.2 * v[1] - 0.6))
    mean = x.mean((1, 2, 3), keepdim=True)
    gain = torch.exp(0.15 * torch.erfinv(2 * torch.cat([v[2], v[3], v[4]], 1) - 1) * 2**0.5)
    x = (0.5 + 0.8 * v[5]) * gain * (x - mean) + mean
    x = x + 0.05 * v[6] * _noise(u[7:9], images.shape[-2], images.shape[-1])
    return (255 * x.clamp(0, 1) + 0.5).to(torch.uint8)


def _noise(u: Float[ndarray, "2 b"], height: int, width: int) -> Float[Tensor, "b 3 h w"]:
    fields = _fields(height, width)
    chosen = fields[torch.from_numpy((u[0] * FIELDS).astype(np.int64))]
    shifts = (u[1] * width).astype(int)
    return torch.stack([field.roll(int(shift), -1) for field, shift in zip(chosen, shifts, strict=True)])


@lru_cache(maxsize=4)
def _fields(height: int, width: int) -> Float[Tensor, "fields 3 h w"]:
    generator = torch.Generator().manual_seed(0)
    return torch.randn(FIELDS, 3, height, width, generator=generator)
