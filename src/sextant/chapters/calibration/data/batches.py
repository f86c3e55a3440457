"""Batches of crops: cameras drawn, images cut and augmented."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int64, UInt8
from numpy import ndarray
from torch import Tensor
from torch.utils.data import Dataset

from sextant.chapters.calibration.data.camera_distributions import CameraDistribution
from sextant.chapters.calibration.data.crops import crop_batch
from sextant.data.batches import StoredImages
from sextant.data.counters import uniforms
from sextant.geometry import CameraParameters
from sextant.geometry.canvas import on_canvas

if TYPE_CHECKING:
    from sextant.chapters.calibration.data.panoramas import Panoramas


@dataclass(frozen=True)
class CropBatch(StoredImages):
    """Crops with the cameras that they were taken with.

    Attributes:
        images: bytes, ``(b, 3, h, w)``.
        cameras: tilt, roll, focal and k1 of each, float32.
        aspect: width over height of each image before it was squashed to the crop's size.
        panoramas: index of the panorama of each.
        indices: numbers of the crops in the split, which seed corruptions.
        weight: weight of the mean over these crops when several processes share a batch.
    """

    images: UInt8[Tensor, "b 3 h w"]
    cameras: CameraParameters
    aspect: Float[Tensor, "b"]
    panoramas: Int64[Tensor, "b"]
    indices: Int64[Tensor, "b"]
    weight: float = 1.0


#: standard deviation, in widths of a line, of the Gaussian that attenuates the finest wave to a tenth
SIGMA = np.sqrt(2 * np.log(10)) / np.pi
SHRINKING, ENLARGING = (cv2.INTER_AREA, cv2.INTER_CUBIC), (cv2.INTER_LINEAR, cv2.INTER_CUBIC)
SHARPENED, COMPRESSED = 1 / 3, 1 / 3
QUALITY = (50, 95)


def with_detail(
    images: UInt8[ndarray, "b 3 h w"], lines: tuple[float, float], numbers: Int64[ndarray, "b"], seed: int
) -> UInt8[ndarray, "b 3 h w"]:
    """Random sharpness, sharpening and compression of training crops, drawn independently of the camera.

    Crops of a panorama show more detail the wider the lens, since a long lens enlarges a few of its pixels, whereas
    photos are sharp with any lens. So that a network cannot infer the lens from sharpness, every training crop is
    reduced to a number of lines per side that is drawn log-uniformly. Half of the crops are blurred by a Gaussian. The
    others are reduced by area averages or bicubic interpolation and enlarged again by linear or bicubic interpolation.
    Then a third of the crops are sharpened by an unsharp mask, and a third are compressed by JPEG at a quality of 50 to
    95.

    The draws depend on (seed, number of the crop) alone.

    Args:
        images: crops.
        lines: smallest and largest number of lines per side.
        numbers: numbers of the crops.
        seed: seed of the draws.
    """
    u = uniforms(numbers % 2**32, numbers // 2**32, 0, seed ^ 0xDE7A11, 6)
    drawn = [_drawn(image.transpose(1, 2, 0), lines, each) for image, each in zip(images, u.T, strict=True)]
    return np.ascontiguousarray(np.stack(drawn).transpose(0, 3, 1, 2))


def _drawn(image: UInt8[ndarray, "h w 3"], lines: tuple[float, float], u: Float[ndarray, "6"]) -> ndarray:
    image = np.ascontiguousarray(image)
    height, width = image.shape[:2]
    left = min(float(lines[0] * (lines[1] / lines[0]) ** u[0]), float(width))  # at most all pixels
    share = left / width
    if u[1] < 0.5:
        image = cv2.GaussianBlur(image, (0, 0), float(SIGMA / share) if share < 1 else 0.3)
    elif share < 1:
        which = int((u[1] - 0.5) * 8)
        small = (max(2, round(width * share)), max(2, round(height * share)))
        image = cv2.resize(image, small, interpolation=SHRINKING[which // 2])
        image = cv2.resize(image, (width, height), interpolation=ENLARGING[which % 2])
    if u[2] < SHARPENED:
        image = cv2.addWeighted(image, 1 + u[3], cv2.GaussianBlur(image, (0, 0), 1.2), -u[3], 0)
    if u[4] < COMPRESSED:
        quality = round(QUALITY[0] + (QUALITY[1] - QUALITY[0]) * u[5])
        coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))
    return image


#: noise is taken from this many fields, rolled at random: fresh noise would cost more than the crop
FIELDS = 32


def augmented(batch: "CropBatch", seed: int) -> "CropBatch":
    r"""Augment a batch of training crops: brightness, contrast, colour, noise, sharpness and mirroring.

    A crop with values x in [0, 1] becomes

    .. math:: c\,g\,(x^\gamma - \mu) + \mu + \varepsilon ,

    with gamma :math:`\log_2 \gamma \sim U(-0.6, 0.6)`, contrast :math:`c \sim U(0.5, 1.3)` about the crop's mean μ, a
    gain :math:`g = e^{0.15 n}`, n standard normal, for each colour and noise ε with a standard deviation drawn from
    U(0, 0.05). Before that, the crop is blurred or sharpened by a share of a 3 x 3 binomial filter. Half of the crops
    are mirrored, which negates the camera's roll and keeps the rest of the camera.

    The draws depend on (seed, number of the crop) alone.
    """
    numbers: Int64[ndarray, "b"] = batch.indices.numpy()
    u = uniforms(numbers % 2**32, numbers // 2**32, 0, seed ^ 0x5EED, 10)
    mirrored = torch.from_numpy(u[9] < 0.5)
    images = torch.where(mirrored[:, None, None, None], batch.images.flip(-1), batch.images)
    roll = torch.where(mirrored, -batch.cameras.roll, batch.cameras.roll)
    return replace(batch, images=relit(images, u[:9]), cameras=batch.cameras._replace(roll=roll))


def relit(images: UInt8[Tensor, "b 3 h w"], u: Float[ndarray, "9 b"]) -> UInt8[Tensor, "b 3 h w"]:
    """Images with changed lighting and sensor noise, given nine uniform numbers in (0, 1) for each."""
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


class Crops(Dataset[CropBatch]):
    """Crops of panoramas by number: ``crops[[3, 1, 4]]`` is one batch of three.

    A crop is identified by its panorama and its draw number. Training draws are new in every epoch; validation and test
    draws are the same for every run.

    Number ``i`` is draw ``i // n`` of panorama ``i % n``, with n panoramas.

    Args:
        panoramas: the panoramas to crop.
        distribution: distribution of the cameras.
        width: width of a crop in pixels.
        height: height of a crop in pixels.
        seed: seed of the draws.
        augment: vary lighting and sensor noise, and mirror, by :func:`augmented`.
        keep: cache every batch, for crops that are requested repeatedly.
        canvas: crops are squares of ``width`` with the whole picture in the middle (:mod:`sextant.geometry.canvas`);
            otherwise pictures are squashed to the crop.
        detail: smallest and largest number of lines of detail in a training crop; see :func:`with_detail`.
    """

    def __init__(
        self,
        panoramas: "Panoramas",
        distribution: CameraDistribution,
        width: int,
        height: int,
        seed: int,
        *,
        augment: bool = False,
        keep: bool = False,
        canvas: bool = False,
        detail: tuple[float, float] | None = None,
    ):
        self.panoramas, self.distribution, self.seed, self.augment = panoramas, distribution, seed, augment
        self._kept: dict[bytes, CropBatch] | None = {} if keep else None
        self.width, self.height = width, height
        self.canvas, self.detail = canvas, detail

    def __getitem__(self, numbers: list[int] | Tensor) -> CropBatch:
        chosen = np.asarray(numbers, np.int64)
        if self._kept is None:
            return self._cut(chosen)
        if chosen.tobytes() not in self._kept:
            self._kept[chosen.tobytes()] = self._cut(chosen)
        return self._kept[chosen.tobytes()]

    def _cut(self, chosen: Int64[ndarray, "b"]) -> CropBatch:
        which, draws = chosen % len(self.panoramas), chosen // len(self.panoramas)
        draw = self.distribution.draw_for(which, draws, self.seed)
        shown = draw
        if self.canvas:
            shown = replace(draw, cameras=on_canvas(draw.cameras, draw.aspect), aspect=torch.ones_like(draw.aspect))
        family = self.distribution.k2_of_k1
        images = crop_batch(self.panoramas, which, shown, self.width, self.height, k2_of_k1=family)
        if self.detail is not None:
            images = with_detail(images, self.detail, chosen, self.seed)
        batch = CropBatch(
            torch.from_numpy(images),
            draw.cameras.to(dtype=torch.float32),
            draw.aspect.float(),
            torch.from_numpy(which),
            torch.from_numpy(chosen),
        )
        return augmented(batch, self.seed) if self.augment else batch

    def cameras(self, count: int) -> CameraParameters:
        """The first ``count`` cameras without their images, in float64."""
        numbers: Int64[ndarray, "n"] = np.arange(count)
        n = len(self.panoramas)
        return self.distribution.draw_for(numbers % n, numbers // n, self.seed).cameras
