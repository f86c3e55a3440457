"""Crops of panoramas: sampled along the rays of cameras, on the CPU or another device."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int64, UInt8
from numpy import ndarray
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

from sextant.chapters.calibration.data.camera_distributions import CameraDraw
from sextant.chapters.calibration.data.panoramas import Panoramas, top_level
from sextant.chapters.calibration.data.rays import Rays, centres
from sextant.errors import UserError
from sextant.geometry import CameraParameters, K2Family


@dataclass(frozen=True)
class Sampling:
    """How crops are sampled.

    Attributes:
        level: of the pyramid.
        side: rays along each side of a pixel.
    """

    level: Int64[ndarray, "b"]
    side: Int64[ndarray, "b"]

    @classmethod
    def central(cls, count: int) -> "Sampling":
        """The central ray alone, in the panorama itself."""
        return cls(np.zeros(count, np.int64), np.ones(count, np.int64))

    @classmethod
    def of(cls, rays: Rays, rows: Int64[ndarray, "b"], width: int, height: int) -> "Sampling":
        """Sampling that averages over the area of a crop's pixels, given the ``rows`` of the panoramas.

        A crop pixel spans at least two pixels of the level. Against 256 rays per pixel in the panorama itself, 3 rays
        per side have errors of 0.4 to 1.4 grey levels (root mean square), and one ray 5 to 14; 2 would double the
        errors of 3, and 4 would halve them at twice the time.
        """
        # side of a square of the area of the central pixel, in panorama pixels
        size = np.sqrt(4 * rays.lens[:, 0] * rays.lens[:, 1] / (width * height)) * rows / math.pi
        tops = np.array([top_level(int(n)) for n in rows])
        level = np.clip(np.floor(np.log2(np.maximum(size / 2, 1))).astype(np.int64), 0, tops)
        size = size / 2.0**level
        return cls(level, np.select([size <= 0.5, size <= 2], [1, 2], 3).astype(np.int64))


#: rays processed at a time: bounds the memory of a large batch
CHUNK = 1 << 23


def crop_on_device(
    panoramas: Panoramas,
    indices: Int64[ndarray, "b"],
    rays: Rays,
    sampling: Sampling,
    width: int,
    height: int,
    device: torch.device,
) -> UInt8[Tensor, "b 3 height width"]:
    """See :func:`crop_batch`; crops of one level of one panorama are cut at once."""
    out = torch.empty(len(indices), 3, height, width, dtype=torch.uint8, device=device)
    groups: dict[tuple[int, int, int], list[int]] = defaultdict(list)
    for i, key in enumerate(zip(indices.tolist(), sampling.level.tolist(), sampling.side.tolist(), strict=True)):
        groups[key].append(i)
    lens, rotation = torch.from_numpy(rays.lens).to(device), torch.from_numpy(rays.rotation).to(device)
    for side in np.unique(sampling.side).tolist():
        chosen = [(key, members) for key, members in groups.items() if key[2] == side]
        most = max(1, CHUNK // (side * side * width * height))
        parts = [(key, members[k : k + most]) for key, members in chosen for k in range(0, len(members), most)]
        for (index, level, _), members in parts:
            which = torch.tensor(members, device=device)
            steps = int(rays.steps[members].max())
            points = _directions(lens[which], rotation[which], steps, side * width, side * height)
            image = panoramas.level_on(index, level, device)
            crops = _sampled(image, points)
            out[which] = (avg_pool2d(crops, side) if side > 1 else crops).add_(0.5).to(torch.uint8)
    return out


def _directions(
    lens: Float[Tensor, "n 4"], rotation: Float[Tensor, "n 9"], steps: int, width: int, height: int
) -> Float[Tensor, "n height width 2"]:
    """Longitude and downward latitude of every ray, in half turns and quarter turns."""
    x = torch.from_numpy(centres(width)).to(lens.device) * lens[:, 0, None, None]
    y = torch.from_numpy(centres(height)).to(lens.device)[:, None] * lens[:, 1, None, None]
    x, y = torch.broadcast_tensors(x, y)
    k1, k2 = lens[:, 2, None, None], lens[:, 3, None, None]
    wanted = torch.hypot(x, y)
    radius = wanted
    for _ in range(steps):
        square = radius * radius
        excess = radius * (1 + square * (k1 + k2 * square)) - wanted
        radius = radius - excess / (1 + square * (3 * k1 + 5 * k2 * square))
    square = radius * radius
    factor = 1 / (1 + square * (k1 + k2 * square))
    u, v = x * factor, y * factor
    right, down, ahead = (
        a * u + b * v + c for a, b, c in rotation.reshape(-1, 3, 3, 1, 1).permute(1, 2, 0, 3, 4).unbind(0)
    )
    latitude = torch.atan2(down, torch.hypot(right, ahead))
    return torch.stack([torch.atan2(right, ahead) / math.pi, latitude / (math.pi / 2)], dim=-1)


def _sampled(
    image: UInt8[Tensor, "3 h w"], points: Float[Tensor, "n rows columns 2"]
) -> Float[Tensor, "n 3 rows columns"]:
    """The padded image at points, interpolated linearly."""
    n, rows, columns = points.shape[:3]
    height, width = image.shape[1:]
    inside = torch.tensor([(width - 2) / width, (height - 2) / height], device=image.device)
    grid = (points * inside).reshape(1, n * rows, columns, 2)
    sampled = grid_sample(image[None].float(), grid, "bilinear", "border", align_corners=False)
    return sampled.reshape(3, n, rows, columns).transpose(0, 1)


Backend = Literal["cv2", "torch"]


def crop_panoramas(
    panoramas: UInt8[ndarray, "h w 3"] | UInt8[ndarray, "b h w 3"] | Sequence[UInt8[ndarray, "_ _ 3"]],
    parameters: CameraParameters,
    yaw: Float[Tensor, "b"],
    width: int,
    height: int,
    *,
    aspect: Float[Tensor, "b"] | None = None,
    k2_of_k1: K2Family = "lopez",
    antialias: bool = True,
    backend: Backend = "cv2",
) -> UInt8[ndarray, "b 3 height width"] | UInt8[Tensor, "b 3 height width"]:
    """Crops of one panorama, or of one panorama per camera; see :func:`crop_batch`.

    Every sample of a crop is interpolated linearly in the panorama along the sample's exact ray
    (:mod:`sextant.chapters.calibration.data.rays`). Without antialiasing, a pixel is its central ray. With it, a pixel
    is the mean of up to 3 x 3 rays over its area, sampled in the level of the panorama's pyramid whose pixels are about
    as large as the distance between these rays.

    Args:
        panoramas: one for all cameras, or one per camera.
        parameters: tilt, roll, focal length and k1 of the cameras.
        yaw: heading to the right, radians.
        width: width of the crops in pixels.
        height: height of the crops in pixels.
        aspect: width over height of the image before it is squashed to the crop's size; None for that of the crop.
        k2_of_k1: the lens family.
        antialias: average over the area of a pixel.
        backend: ``cv2``, or ``torch`` on the device of the parameters.
    """
    single = isinstance(panoramas, np.ndarray) and panoramas.ndim == 3
    images: Sequence[ndarray] = [panoramas] if single else list(panoramas)  # type: ignore[list-item]
    count = len(parameters.tilt)
    indices = np.zeros(count, np.int64) if single else np.arange(count)
    aspect = torch.full_like(parameters.tilt, width / height) if aspect is None else aspect
    held = Panoramas(images, [str(i) for i in range(len(images))])
    draw = CameraDraw(parameters, yaw, aspect)
    return crop_batch(held, indices, draw, width, height, k2_of_k1=k2_of_k1, antialias=antialias, backend=backend)


def crop_batch(
    panoramas: Panoramas,
    indices: Int64[ndarray, "b"],
    draw: CameraDraw,
    width: int,
    height: int,
    *,
    k2_of_k1: K2Family = "lopez",
    antialias: bool = True,
    backend: Backend = "cv2",
) -> UInt8[ndarray, "b 3 height width"] | UInt8[Tensor, "b 3 height width"]:
    """Crop ``i`` is the view of panorama ``indices[i]`` through camera ``i`` of ``draw``.

    The image spans ±aspect/2 by ±1/2 image heights and is squashed to the crop's size, whatever that is.

    Args:
        panoramas: the panoramas to crop.
        indices: panorama of each camera.
        draw: the cameras.
        width: width of the crops in pixels.
        height: height of the crops in pixels.
        k2_of_k1: the lens family.
        antialias: average over the area of a pixel.
        backend: ``cv2``, or ``torch`` on the device of the cameras, whose crops are a tensor there.

    Raises:
        UserError: the backend is unknown.
    """
    if backend not in get_args(Backend):
        raise UserError(f"backend={backend!r} must be one of {', '.join(get_args(Backend))}")
    rays = Rays.of(draw, k2_of_k1)
    rows = np.array([len(panoramas[int(i)]) for i in indices])
    sampling = Sampling.of(rays, rows, width, height) if antialias else Sampling.central(len(rows))
    if backend == "torch":
        from sextant.chapters.calibration.data.crops import crop_on_device

        device = draw.cameras.tilt.device
        return crop_on_device(panoramas, indices, rays, sampling, width, height, device)
    return _crop_with_cv2(panoramas, indices, rays, sampling, width, height)


def _crop_with_cv2(
    panoramas: Panoramas, indices: Int64[ndarray, "b"], rays: Rays, sampling: Sampling, width: int, height: int
) -> UInt8[ndarray, "b 3 height width"]:
    from sextant.chapters.calibration.data.rays import mean_of_rays

    out = np.empty((len(indices), 3, height, width), np.uint8)
    for i, index in enumerate(indices):
        source, side = panoramas.level(int(index), int(sampling.level[i])), int(sampling.side[i])
        x, y = rays.points(i, source.shape[1] - 2, source.shape[0] - 2, side * width, side * height)
        picture = cv2.remap(source, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        if side <= 2:
            picture = picture if side == 1 else cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
            for channel in range(3):
                cv2.extractChannel(picture, channel, out[i, channel])
        else:  # OpenCV is fast only for means of four
            mean_of_rays(picture, side, np.empty(4 * side * width, np.uint16), out[i])
    return out
