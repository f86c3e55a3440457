"""Crops of panoramas: sampled along the rays of cameras."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.chapters.calibration.data.camera_distributions import CameraDraw
from sextant.chapters.calibration.data.panoramas import Panoramas, top_level
from sextant.chapters.calibration.data.rays import Rays, mean_of_rays
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
) -> UInt8[ndarray, "b 3 height width"]:
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
    """
    single = isinstance(panoramas, np.ndarray) and panoramas.ndim == 3
    images: Sequence[ndarray] = [panoramas] if single else list(panoramas)  # type: ignore[list-item]
    count = len(parameters.tilt)
    indices = np.zeros(count, np.int64) if single else np.arange(count)
    aspect = torch.full_like(parameters.tilt, width / height) if aspect is None else aspect
    held = Panoramas(images, [str(i) for i in range(len(images))])
    draw = CameraDraw(parameters, yaw, aspect)
    return crop_batch(held, indices, draw, width, height, k2_of_k1=k2_of_k1, antialias=antialias)


def crop_batch(
    panoramas: Panoramas,
    indices: Int64[ndarray, "b"],
    draw: CameraDraw,
    width: int,
    height: int,
    *,
    k2_of_k1: K2Family = "lopez",
    antialias: bool = True,
) -> UInt8[ndarray, "b 3 height width"]:
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
    """
    rays = Rays.of(draw, k2_of_k1)
    rows = np.array([len(panoramas[int(i)]) for i in indices])
    sampling = Sampling.of(rays, rows, width, height) if antialias else Sampling.central(len(rows))
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
