r"""Views of panoramas as taken by a lens of a given calibration.

Every sample of a crop is the panorama where the sample's exact ray points (:mod:`sextant.data.calibration.rays`),
interpolated linearly. Without antialiasing, a pixel is its central ray. With it, a pixel is the mean of up to 3 x 3
rays over its area. They are sampled in the level of the panorama's pyramid whose pixels are about as large as the
distance between these rays.
"""

from collections.abc import Sequence
from typing import Literal, get_args

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.data.calibration.camera_distributions import CameraDraw
from sextant.data.calibration.panoramas import Panoramas
from sextant.data.calibration.ray_sampling import Sampling
from sextant.data.calibration.rays import Rays
from sextant.errors import UserError
from sextant.geometry import CameraParameters, K2Family

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

    Args:
        panoramas: one for all cameras, or one per camera.
        parameters: of the cameras.
        yaw: to the right, radians.
        width: of the crops in pixels.
        height: of the crops in pixels.
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
    """Crop ``i`` is what camera ``i`` of ``draw`` sees of panorama ``indices[i]``.

    The image spans ±aspect/2 by ±1/2 image heights and is squashed to the crop's size, whatever that is.

    Args:
        panoramas: the panoramas to crop.
        indices: which panorama each camera sees.
        draw: the cameras.
        width: of the crops in pixels.
        height: of the crops in pixels.
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
        from sextant.data.calibration.device_crops import crop_on_device

        device = draw.cameras.tilt.device
        return crop_on_device(panoramas, indices, rays, sampling, width, height, device)
    return _crop_with_cv2(panoramas, indices, rays, sampling, width, height)


def _crop_with_cv2(
    panoramas: Panoramas, indices: Int64[ndarray, "b"], rays: Rays, sampling: Sampling, width: int, height: int
) -> UInt8[ndarray, "b 3 height width"]:
    from sextant.data.calibration.ray_kernels import mean_of_rays

    out = np.empty((len(indices), 3, height, width), np.uint8)
    for i, index in enumerate(indices):
        source, side = panoramas.level(int(index), int(sampling.level[i])), int(sampling.side[i])
        x, y = rays.points(i, source.shape[1] - 2, source.shape[0] - 2, side * width, side * height)
        picture = cv2.remap(source, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        if side <= 2:
            picture = picture if side == 1 else cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
            for channel in range(3):
                cv2.extractChannel(picture, channel, out[i, channel])
        else:  # OpenCV is quick only at means of four
            mean_of_rays(picture, side, np.empty(4 * side * width, np.uint16), out[i])
    return out
