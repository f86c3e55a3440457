r"""Exact conversion of a calibrated camera to the conventions of other programs and back.

The distortion polynomial is the same everywhere, :math:`d = 1 + k_1 r^2 + k_2 r^4` on normalised coordinates, so k1
and k2 pass unchanged; what differs is the unit of the focal length and where pixels have their centres.

========== ============================ ============================= =========================================
program    focal length                 pixel (i, j) has its centre   principal point of a W x H image
========== ============================ ============================= =========================================
Sextant    image heights                at (i + 0.5, j + 0.5)         (W/2, H/2)
OpenCV     pixels                       at (i, j)                     (W/2 - 0.5, H/2 - 0.5)
COLMAP     pixels                       at (i + 0.5, j + 0.5)         (W/2, H/2)
OpenSfM    the longer side, max(W, H)   at (i, j), shifted internally the image centre, the origin of coordinates
GeoCalib   pixels, or vfov              at (i, j)                     (W/2, H/2): half a pixel off the centre
========== ============================ ============================= =========================================

A camera of another program that is not centred, has non-square pixels or other distortion than k1 and k2 is refused.

GeoCalib: roll and pitch are roll and tilt here, with the same signs; its ``Gravity.vec3d`` points *up*, as
:func:`~sextant.geometry.up_in_camera`. Its :math:`\hat k_1` is :math:`k_1/f^2` with f in image heights, as in
:mod:`sextant.geometry.parameterization`; AnyCalib uses the same name for :math:`k_1/f`. GeoCalib undistorts by a
truncated series, so that its rays differ: by 6 px at k1 = -0.2, f = 640 px and 0.6 f from the centre.

Sources: OpenCV, "Camera Calibration and 3D Reconstruction"; COLMAP, "Camera Models" (RADIAL); OpenSfM, ``features.py``
and "Geometric models" (perspective); GeoCalib, ``camera.py`` and ``gravity.py``.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.errors import UserError
from sextant.geometry.camera import floating
from sextant.geometry.parameterization import focal_from_vfov
from sextant.geometry.perspective import PerspectiveCamera

OPENCV_COEFFICIENTS = (4, 5, 8, 12, 14)
OPENCV_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")


class GeoCalibCamera(NamedTuple):
    """GeoCalib's estimate for an image.

    Attributes:
        roll: radians.
        pitch: radians, positive upwards.
        vfov: nominal vertical field of view, radians.
        k1_hat: ``k1 / f²``, f in image heights.
        k2: second coefficient, which GeoCalib does not scale; 0 for its ``simple_radial``.
    """

    roll: Float[Tensor, "*b"]
    pitch: Float[Tensor, "*b"]
    vfov: Float[Tensor, "*b"]
    k1_hat: Float[Tensor, "*b"]
    k2: Float[Tensor, "*b"]


def opencv_from_perspective(camera: PerspectiveCamera) -> tuple[Float[Tensor, "*b 3 3"], Float[Tensor, "*b 5"]]:
    """Camera matrix, and distortion coefficients (k1, k2, p1, p2, k3) of which the last three are 0.

    OpenCV's pixel coordinates are those of this package minus 0.5.
    """
    focal, k1, k2 = _broadcast(camera)
    one, zero = torch.ones_like(focal), torch.zeros_like(focal)
    focal, column, row = focal * camera.height, one * (camera.width / 2 - 0.5), one * (camera.height / 2 - 0.5)
    matrix = torch.stack([focal, zero, column, zero, focal, row, zero, zero, one], -1)
    return matrix.reshape(*focal.shape, 3, 3), torch.stack([k1, k2, zero, zero, zero], -1)


def perspective_from_opencv(
    matrix: Float[Tensor, "*b 3 3"],
    distortion: Float[Tensor, "*b n"],
    width: int,
    height: int,
    *,
    tolerance_px: float = 1e-6,
) -> PerspectiveCamera:
    """The camera of OpenCV's matrix and 4, 5, 8, 12 or 14 distortion coefficients.

    Args:
        matrix: camera matrix, in pixels with their centres at integers.
        distortion: coefficients; only k1 and k2 may differ from 0.
        width: width of the image in pixels.
        height: height of the image in pixels.
        tolerance_px: largest offset of the principal point from the image centre, difference of the two focal lengths,
            and skew. They are dropped, and the focal length is the mean of the two.

    Raises:
        UserError: the camera is not centred, its pixels are not square, it has other distortion, or it is impossible.
    """
    if distortion.shape[-1] not in OPENCV_COEFFICIENTS:
        raise UserError(
            f"OpenCV's distortion has {', '.join(map(str, OPENCV_COEFFICIENTS))} coefficients, got "
            f"{distortion.shape[-1]}",
            "Give (k1, k2, p1, p2) at least, zeros included.",
        )
    for name, values in zip(OPENCV_NAMES[2:], distortion[..., 2:].unbind(-1), strict=False):
        _check_zero(f"distortion coefficient {name}", values, 0.0, "Only k1 and k2 are supported: calibrate so.")
    fx, fy = matrix[..., 0, 0], matrix[..., 1, 1]
    _check_zero("fx - fy", fx - fy, tolerance_px, "Resize the image to square pixels first, or raise tolerance_px.")
    _check_zero("skew", matrix[..., 0, 1], tolerance_px, "A camera here has none; raise tolerance_px to drop it.")
    below = torch.cat([matrix[..., 1, :1], matrix[..., 2, :] - matrix.new_tensor([0, 0, 1])], -1)
    _check_zero("lower triangle", below, 0.0, "The matrix is (fx, 0, cx; 0, fy, cy; 0, 0, 1).")
    matrix = floating(matrix)
    centre = matrix.new_tensor([width / 2 - 0.5, height / 2 - 0.5])
    _check_centre(matrix[..., :2, 2] - centre, tolerance_px)
    return PerspectiveCamera((fx + fy) / 2 / height, distortion[..., 0], distortion[..., 1], width, height)


def colmap_from_perspective(camera: PerspectiveCamera) -> Float[Tensor, "*b 5"]:
    """Parameters (f, cx, cy, k1, k2) of COLMAP's RADIAL model, in the pixels of this package."""
    focal, k1, k2 = _broadcast(camera)
    one = torch.ones_like(focal)
    return torch.stack([focal * camera.height, one * (camera.width / 2), one * (camera.height / 2), k1, k2], -1)


def perspective_from_colmap(
    parameters: Float[Tensor, "*b 5"], width: int, height: int, *, tolerance_px: float = 1e-6
) -> PerspectiveCamera:
    """The camera of COLMAP's RADIAL parameters (f, cx, cy, k1, k2).

    Raises:
        UserError: the principal point is farther than ``tolerance_px`` from the image centre, or there is no such
            camera.
    """
    parameters = floating(parameters)
    _check_centre(parameters[..., 1:3] - parameters.new_tensor([width / 2, height / 2]), tolerance_px)
    focal, k1, k2 = parameters[..., 0], parameters[..., 3], parameters[..., 4]
    return PerspectiveCamera(focal / height, k1, k2, width, height)


def opensfm_from_perspective(camera: PerspectiveCamera) -> Float[Tensor, "*b 3"]:
    """``focal`` (in units of the longer side), ``k1`` and ``k2`` of an OpenSfM camera of type ``perspective``."""
    focal, k1, k2 = _broadcast(camera)
    return torch.stack([focal * (camera.height / max(camera.width, camera.height)), k1, k2], -1)


def perspective_from_opensfm(parameters: Float[Tensor, "*b 3"], width: int, height: int) -> PerspectiveCamera:
    """The camera of an OpenSfM ``perspective`` camera's (focal, k1, k2).

    Raises:
        UserError: there is no such camera.
    """
    focal, k1, k2 = parameters.unbind(-1)
    return PerspectiveCamera(focal * max(width, height) / height, k1, k2, width, height)


def geocalib_from_perspective(
    camera: PerspectiveCamera, tilt: Float[Tensor, "*#b"], roll: Float[Tensor, "*#b"]
) -> GeoCalibCamera:
    """A camera with its tilt and roll (radians) in GeoCalib's terms."""
    focal, k1, k2, tilt, roll = torch.broadcast_tensors(camera.focal, camera.k1, camera.k2, tilt, roll)
    return GeoCalibCamera(roll, tilt, 2 * torch.atan(0.5 / focal), k1 / focal.square(), k2)


def perspective_from_geocalib(
    said: GeoCalibCamera, width: int, height: int
) -> tuple[PerspectiveCamera, Float[Tensor, "*b"], Float[Tensor, "*b"]]:
    """The camera, its tilt and its roll (radians).

    Raises:
        UserError: there is no such camera.
    """
    focal = focal_from_vfov(said.vfov)
    camera = PerspectiveCamera(focal, said.k1_hat * focal.square(), said.k2, width, height)
    return camera, said.pitch, said.roll


def _broadcast(camera: PerspectiveCamera) -> tuple[Tensor, Tensor, Tensor]:
    focal, k1, k2 = torch.broadcast_tensors(camera.focal, camera.k1, camera.k2)
    return focal, k1, k2


def _check_centre(offset: Float[Tensor, "*b 2"], tolerance_px: float) -> None:
    if not bool((offset.abs() <= tolerance_px).all()):
        worst = offset.reshape(-1, 2)[offset.abs().amax(-1).argmax()].tolist()
        raise UserError(
            f"the principal point lies ({worst[0]:.4g}, {worst[1]:.4g}) pixels from the image centre, "
            f"more than tolerance_px={tolerance_px:g}",
            "Crop the image around the principal point, or raise tolerance_px to use the centre instead.",
        )


def _check_zero(name: str, values: Tensor, tolerance: float, fix: str) -> None:
    if not bool((values.abs() <= tolerance).all()):
        raise UserError(f"{name} must be 0, got {values.flatten()[values.abs().argmax()].item():.4g}", fix)
