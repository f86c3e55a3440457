"""nerfstudio's ``transforms.json``, also used by instant-ngp and NeRF's synthetic scenes.

Each of ``frames`` has a ``file_path`` and a ``transform_matrix``, 4x4, ``world_from_camera`` of a camera whose x points
right, y *up* and z *backward* (OpenGL); it is converted here to x right, y down, z forward. The world's z points up.
``fl_x`` is the focal length in pixels, of one frame or of all; NeRF's files have ``camera_angle_x``, the horizontal
field of view in radians, instead. Source: nerfstudio's documentation, "Data conventions".
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sextant.data.reconstructions.json_file import read_foreign_json
from sextant.data.reconstructions.reconstruction import (
    ROTATION_TOLERANCE,
    Lens,
    PosedImage,
    Reconstruction,
    finite,
    reconstruction_of,
)
from sextant.errors import UserError

FIX = "It is the transforms.json that ns-process-data or instant-ngp's colmap2nerf.py wrote."
#: camera models that OpenCV has with the same parameters
SHARED = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE")
#: camera of OpenGL -> camera here
DOWN_FORWARD = np.diag([1.0, -1.0, -1.0, 1.0])


def read_nerfstudio(path: Path) -> Reconstruction:
    """Read the images of the file, in nerfstudio's world frame.

    Raises:
        UserError: the file cannot be read, has a different layout, or has an invalid pose; the message names it.
    """
    content = read_foreign_json(path, FIX)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list):
        raise UserError(f'{path}: a list of "frames" is expected', FIX)
    found: list[PosedImage | str] = []
    for number, frame in enumerate(frames, start=1):
        image = _image(frame, content) if isinstance(frame, dict) and isinstance(frame.get("file_path"), str) else None
        found.append(image or f"frame {number}: its file_path or its 4x4 transform_matrix is missing or not a pose")
    return reconstruction_of(path, found, fix=FIX)


def _image(frame: Mapping[str, Any], common: Mapping[str, Any]) -> PosedImage | None:
    matrix = finite(frame.get("transform_matrix"), 4, 4)
    if matrix is None:
        return None
    rotation = matrix[:3, :3]
    if (
        np.abs(rotation).max() > 2
        or np.abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE
        or np.linalg.det(rotation) < 0
    ):
        return None
    pose = matrix @ DOWN_FORWARD
    pose[3] = (0, 0, 0, 1)
    return PosedImage(Path(frame["file_path"]).as_posix(), pose, _lens({**common, **frame}))


def _lens(camera: Mapping[str, Any]) -> Lens:
    size = finite([camera.get("w"), camera.get("h")], 2)
    focal, angle = finite(camera.get("fl_x")), finite(camera.get("camera_angle_x"))
    width, height = (0, 0) if size is None else (int(size[0]), int(size[1]))
    focal_px = None if focal is None else float(focal)
    if focal_px is None and angle is not None and 0 < angle < math.pi and width:
        focal_px = width / 2 / math.tan(float(angle) / 2)
    model = str(camera.get("camera_model", "OPENCV"))
    return Lens(model, width, height, focal_px, _opencv(camera, width, height, focal_px) if model in SHARED else None)


def _opencv(camera: Mapping[str, Any], width: int, height: int, focal_px: float | None) -> tuple[float, ...] | None:
    """Parameters of OpenCV; the file's first pixel has its centre at (0.5, 0.5)."""
    if focal_px is None or not width:
        return None
    usual = {"fl_y": focal_px, "cx": width / 2, "cy": height / 2}
    given = {**usual, **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)}
    found = finite([camera.get(key, value) for key, value in given.items()], len(given))
    if found is None:
        return None
    fy, cx, cy, *bent = found.tolist()
    return (focal_px, fy, cx - 0.5, cy - 0.5, *bent)
