"""Pictures, cameras and poses in messages of ROS 1 and 2, whichever library read them.

Encodings are those of ``sensor_msgs/image_encodings``: grey and colour of 8 bits, ``mono16``, Bayer patterns, and YUV
as ``uyvy`` (formerly ``yuv422``), ``yuyv`` (``yuv422_yuy2``), ``nv12`` and ``nv21``, by BT.601 in video range.
"""

import io
import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray
from PIL import Image

from sextant.chapters.localization.data.pose_formats import LENGTH_TOLERANCE
from sextant.chapters.localization.data.posed_photos import PhotoLens
from sextant.correspondence import Pinhole
from sextant.errors import UserError

#: encoding -> channels of 8 bits, and their order as RGB (None: grey)
PLAIN: dict[str, tuple[int, tuple[int, ...] | None]] = {
    "mono8": (1, None),
    "8UC1": (1, None),
    "rgb8": (3, (0, 1, 2)),
    "bgr8": (3, (2, 1, 0)),
    "8UC3": (3, (2, 1, 0)),
    "rgba8": (4, (0, 1, 2)),
    "bgra8": (4, (2, 1, 0)),
}
#: encoding -> bytes of a pixel, rows of bytes for two rows of pixels, and OpenCV's conversion
CONVERTED: dict[str, tuple[int, int, str]] = {
    "bayer_rggb8": (1, 2, "COLOR_BayerRGGB2RGB"),
    "bayer_bggr8": (1, 2, "COLOR_BayerBGGR2RGB"),
    "bayer_gbrg8": (1, 2, "COLOR_BayerGBRG2RGB"),
    "bayer_grbg8": (1, 2, "COLOR_BayerGRBG2RGB"),
    "uyvy": (2, 2, "COLOR_YUV2RGB_UYVY"),
    "yuv422": (2, 2, "COLOR_YUV2RGB_UYVY"),
    "yuyv": (2, 2, "COLOR_YUV2RGB_YUY2"),
    "yuv422_yuy2": (2, 2, "COLOR_YUV2RGB_YUY2"),
    "nv12": (1, 3, "COLOR_YUV2RGB_NV12"),
    "nv21": (1, 3, "COLOR_YUV2RGB_NV21"),
}
ENCODINGS = (*PLAIN, "mono16", *CONVERTED)
#: distortion model of sensor_msgs/CameraInfo -> number of coefficients
MODELS = {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4, "fisheye": 4}
FISHEYE = ("equidistant", "fisheye")
#: words in the topic of images that are rectified already
RECTIFIED = frozenset({"rect", "rectified"})


def picture_of(message: Any, kind: str) -> Image.Image:
    """The picture in a ROS message; with 16 bits (mode ``I;16``) for ``mono16``.

    Args:
        message: ``sensor_msgs/Image`` or ``sensor_msgs/CompressedImage``.
        kind: which of the two, written as ``sensor_msgs/msg/Image``.

    Raises:
        ValueError: its encoding is not supported, or its data do not fit its size.
    """
    if kind == "sensor_msgs/msg/CompressedImage":
        return Image.open(io.BytesIO(bytes(message.data)), formats=("JPEG", "PNG", "WEBP"))
    name, height, width = message.encoding, message.height, message.width
    if name not in ENCODINGS:
        raise ValueError(f"encoding {name} is not one of {', '.join(ENCODINGS)}")
    if name in PLAIN:
        channels, order = PLAIN[name]
        pixels = _rows(message, height, width * channels).reshape(height, width, channels)
        return Image.fromarray(pixels[..., 0] if order is None else np.ascontiguousarray(pixels[..., order]))
    if name == "mono16":
        values = _rows(message, height, width * 2).view(">u2" if message.is_bigendian else "<u2")
        return Image.fromarray(values.astype(np.uint16))
    import cv2

    size, rows, conversion = CONVERTED[name]
    if height % 2 or width % 2:
        raise ValueError(f"{width}x{height} pixels do not go with {name}, whose sides are even")
    data = _rows(message, height * rows // 2, width * size).reshape(height * rows // 2, width, -1)
    return Image.fromarray(np.asarray(cv2.cvtColor(data, getattr(cv2, conversion))))


def _rows(message: Any, rows: int, used: int) -> UInt8[ndarray, "rows used"]:
    """The bytes of an image by rows, without padding at their ends."""
    data = np.frombuffer(message.data, np.uint8)
    if len(data) != rows * message.step or used > message.step:
        raise ValueError(
            f"{len(data):,} bytes in rows of {message.step:,} do not make {message.width}x{message.height} pixels of "
            f"{message.encoding}"
        )
    return np.ascontiguousarray(data.reshape(rows, message.step)[:, :used])


@dataclass(frozen=True)
class RosCamera:
    r"""The camera of a ``sensor_msgs/CameraInfo``.

    Attributes:
        lens: size, focal lengths, principal point and coefficients: OpenCV's ``k1, k2, p1, p2, k3[, k4, k5, k6]``, or
            with ``fisheye`` those of :math:`\theta (1 + k_1 \theta^2 + ... + k_4 \theta^8)`.
        model: its name there; ``rectified`` for the images of a topic that is rectified already.

    Example:
        >>> camera = RosCamera(PhotoLens(640, 480, (500.0, 500.0, 319.5, 239.5)), "plumb_bob")
        >>> camera.pinhole(320, 240, "half").fx  # of half the size
        250.0
    """

    lens: PhotoLens
    model: str

    def __str__(self) -> str:
        fx, fy, cx, cy, *bent = self.lens.opencv
        return (
            f"{self.lens.width}x{self.lens.height}, {self.model}: fx {fx:.5g}, fy {fy:.5g}, cx {cx:.5g}, cy {cy:.5g}"
            + (f"; {', '.join(f'{value:.4g}' for value in bent)}" if any(bent) else "")
        )

    def pinhole(self, width: int, height: int, what: str) -> Pinhole:
        """The camera of a straightened image.

        Raises:
            UserError: the image has another shape.
        """
        return Pinhole(width, height, *self.lens.of_size(width, height, what).opencv[:4])

    def straight(self, pixels: UInt8[ndarray, "h w c"], what: str) -> UInt8[ndarray, "h w c"]:
        """An image without distortion, of the same size and intrinsics; black where the camera did not see.

        Raises:
            UserError: the image has another shape.
        """
        lens = self.lens.of_size(pixels.shape[1], pixels.shape[0], what)
        if not any(lens.opencv[4:]) and self.model not in FISHEYE:
            return pixels
        import cv2

        straight = np.asarray(cv2.remap(pixels, *_maps(lens, self.model in FISHEYE), cv2.INTER_LINEAR))
        return straight.reshape(pixels.shape)


@lru_cache(maxsize=4)
def _maps(lens: PhotoLens, fisheye: bool) -> tuple[Float32[ndarray, "h w"], Float32[ndarray, "h w"]]:
    import cv2

    fx, fy, cx, cy, *bent = lens.opencv
    matrix, size = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), (lens.width, lens.height)
    make = cv2.fisheye.initUndistortRectifyMap if fisheye else cv2.initUndistortRectifyMap
    columns, rows = make(matrix, np.array(bent), np.eye(3), matrix, size, cv2.CV_32FC1)
    return np.asarray(columns), np.asarray(rows)


def camera_of(message: Any, image_topic: str) -> RosCamera | None:
    """The camera of a ``sensor_msgs/CameraInfo``; None if it is not calibrated, which ROS marks by a first number 0.

    A topic with the word ``rect`` or ``rectified`` in its last two parts, such as ``image_rect_color``, carries
    rectified images: their camera is that of the projection matrix P.

    Raises:
        UserError: its distortion model is not supported, or its numbers are no camera.
    """
    matrix, projection, given = (
        np.array(getattr(message, name, getattr(message, name.upper(), ())), np.float64) for name in ("k", "p", "d")
    )
    width, height, model = int(message.width), int(message.height), str(message.distortion_model)
    if matrix.shape != (9,) or matrix[0] == 0:
        return None
    words = re.split(r"[_\W]+", "/".join(image_topic.lower().strip("/").split("/")[-2:]))
    if not RECTIFIED.isdisjoint(words) and projection[:1].any():
        matrix, given, model = projection.reshape(3, 4)[:, :3].reshape(-1), np.zeros(0), "rectified"
    across, down = max(int(message.binning_x), 1), max(int(message.binning_y), 1)
    fx, cx, fy, cy = matrix[[0, 2, 4, 5]]
    numbers = (*_binned(fx, cx, across), *_binned(fy, cy, down))
    count = MODELS.get(model, 0)
    if any(given) and (model not in MODELS or len(given) < (4 if count == 5 else count)):
        raise UserError(
            f"camera_info of {image_topic}: distortion_model={model!r} with {len(given)} coefficients is not supported",
            f"Supported: {', '.join(MODELS)}. Or use a topic of rectified images.",
        )
    if not (np.isfinite([*numbers, *given]).all() and min(fx, fy) > 0 and min(width, height) > 0):
        raise UserError(f"camera_info of {image_topic}: {width}x{height}, K = {matrix.tolist()} is no camera")
    fx, cx, fy, cy = numbers
    bent = tuple(given[:count].tolist()) or (0.0,) * 4
    return RosCamera(PhotoLens(width // across, height // down, (fx, fy, cx, cy, *bent)), model or "pinhole")


def _binned(focal: float, centre: float, pixels: int) -> tuple[float, float]:
    return float(focal / pixels), float((centre + 0.5) / pixels - 0.5)


def planar_pose(pose: Any) -> Float64[ndarray, "3"]:
    """x, y and the heading of a ``geometry_msgs/Pose``: the direction of its x axis in the plane.

    Raises:
        ValueError: a number is not finite, or the orientation is no unit quaternion.
    """
    at, turned = pose.position, pose.orientation
    x, y, z, w = quaternion = np.array([turned.x, turned.y, turned.z, turned.w], np.float64)
    if not np.isfinite([at.x, at.y, *quaternion]).all() or abs(np.linalg.norm(quaternion) - 1) > LENGTH_TOLERANCE:
        raise ValueError(f"a pose at {at.x}, {at.y} with the quaternion {quaternion.tolist()} is none")
    return np.array([at.x, at.y, np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))])


def set_planar(pose: Any, found: Float64[ndarray, "3"]) -> Any:
    """Write x, y and a heading into a ``geometry_msgs/Pose``, or a ``Transform``, on the ground."""
    x, y, heading = map(float, found)
    at = pose.position if hasattr(pose, "position") else pose.translation
    turned = pose.orientation if hasattr(pose, "orientation") else pose.rotation
    at.x, at.y, at.z = x, y, 0.0
    turned.x, turned.y, turned.z, turned.w = 0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)
    return pose
