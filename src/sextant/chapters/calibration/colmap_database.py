r"""Priors for COLMAP: a database with cameras and gravity, and a file with their uncertainties.

``database.db`` holds for each photo its camera (model RADIAL), gravity and, if EXIF has it, the position on WGS 84.
Gravity is a unit vector in the camera's frame (x right, y down, z forward); for tilt θ and roll ψ it is

.. math:: g = (\sin\psi\cos\theta,\; \cos\psi\cos\theta,\; -\sin\theta).

COLMAP 4.2 stores no uncertainty of gravity, so ``priors.json`` holds it: the covariance
:math:`\sigma_\theta^2\, g_\theta g_\theta^\top + \sigma_\psi^2\, g_\psi g_\psi^\top` in rad², with the derivatives of g
by tilt and roll, whose errors are taken as independent. It is perpendicular to g, so its rank is 2. COLMAP treats the
database as exact. Gravity of photos that are not trustworthy is therefore only in ``priors.json``, and a focal length
is marked as known (``has_prior_focal_length``) only for a camera with a good photo.

COLMAP ignores the EXIF orientation; cameras and vectors are rotated to the image as stored.
Sources: COLMAP 4.2, ``src/colmap/geometry/pose_prior.h`` and ``sensor/models.h``.
"""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_json
from sextant.chapters.calibration.photo_camera import PhotoCamera
from sextant.data.photos.gps import photo_gps
from sextant.data.upright import STORED_FROM_UPRIGHT
from sextant.errors import ArgumentError, UserError

DATABASE, PRIORS = "database.db", "priors.json"
#: digits to which the parameters of one camera agree, rotated or not
SAME = 9
UNITS = (
    "names are relative to image_path; pixels, gravity (a unit vector, x right, y down, z forward) and its covariance "
    "(rad²) are of the image as it is stored, before EXIF orientation; sigmas are half of 68 % intervals"
)


def gravity_prior(camera: PhotoCamera) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3 3"]]:
    """Gravity as a unit vector in the camera frame of the stored image, and its covariance in rad²."""
    tilt, roll = math.radians(camera.tilt_deg), math.radians(camera.roll_deg)
    (ct, st), (cr, sr) = ((math.cos(angle), math.sin(angle)) for angle in (tilt, roll))
    by_tilt, by_roll = np.array([-sr * st, -cr * st, -ct]), np.array([cr * ct, -sr * ct, 0.0])
    near = camera.interval_68
    parts = (math.radians(_half(near.tilt_deg)) * by_tilt, math.radians(_half(near.roll_deg)) * by_roll)
    turn = np.eye(3)
    turn[:2, :2] = STORED_FROM_UPRIGHT[camera.exif_orientation]
    covariance = sum(np.outer(turn @ part, turn @ part) for part in parts)
    return turn @ np.array([sr * ct, cr * ct, -st]), np.asarray(covariance)


def check_colmap(folder: Path) -> None:
    """Raise any error of :func:`write_colmap` about the folder or the installation, before work is done."""
    import pycolmap  # noqa: F401

    if (folder / DATABASE).exists():
        raise UserError(
            f"{folder / DATABASE} already exists, and may hold features that took hours to extract",
            "Move it, or choose another folder: output=/path",
        )


def write_colmap(cameras: Sequence[PhotoCamera], folder: Path | str) -> list[Path]:
    """Write ``database.db`` and ``priors.json``.

    Photos with equal parameters, such as those of :meth:`~sextant.PhotoCalibrator.one_camera`, share a camera.
    ``colmap feature_extractor`` and all later steps accept the database as it is.

    Args:
        cameras: cameras of files; ``image_path`` in ``priors.json`` is the folder around all of them.
        folder: folder to write into; created if needed.

    Returns:
        The two files.

    Raises:
        ArgumentError: there are no cameras, or one is not of a file.
        UserError: a database already exists, the disk is full, or the folder cannot be written to.
        ModuleNotFoundError: pycolmap is not installed: ``pip install 'sextant-vision[colmap]'``.

    Example:
        >>> one = sextant.PhotoCalibrator.load().one_camera(sorted(Path("photos").iterdir()))  # doctest: +SKIP
        >>> write_colmap(one.cameras, "colmap")  # doctest: +SKIP
    """
    folder = Path(folder).expanduser()
    check_colmap(folder)
    if without := [camera.name for camera in cameras if not Path(camera.name).is_file()]:
        raise ArgumentError(f"cameras: {without[0]} is not a file, and COLMAP needs files", "Calibrate files.")
    if not cameras:
        raise ArgumentError("cameras=[]: there is no camera", "Give at least one.")
    paths = [Path(os.path.abspath(camera.name)) for camera in cameras]
    around = Path(os.path.commonpath([path.parent for path in paths]))
    names = [path.relative_to(around).as_posix() for path in paths]
    positions = [_position(path) for path in paths]
    unfinished = folder / f".{DATABASE}.tmp"
    with telling_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        unfinished.unlink(missing_ok=True)
        rows = _fill(unfinished, names, cameras, positions)
        write_json(folder / PRIORS, {"image_path": str(around), "units": UNITS, "images": rows})
        unfinished.replace(folder / DATABASE)
    return [folder / DATABASE, folder / PRIORS]


def _fill(
    path: Path, names: Sequence[str], cameras: Sequence[PhotoCamera], positions: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Write the database, and return the rows of the priors."""
    import pycolmap

    database = pycolmap.Database.open(path)
    sensors: dict[str, tuple[int, int]] = {}
    known = {_key(camera) for camera in cameras if camera.verdict == "good"}
    rows = []
    try:
        for name, camera, position in zip(names, cameras, positions, strict=True):
            key = _key(camera)
            if key not in sensors:
                sensors[key] = _new_sensor(database, _stored(camera), key in known)
            camera_id, rig_id = sensors[key]
            image = pycolmap.Image(name=name, camera_id=camera_id)
            image.image_id = database.write_image(image)
            frame = pycolmap.Frame(rig_id=rig_id)
            frame.add_data_id(image.data_id)
            database.write_frame(frame)
            gravity, covariance = gravity_prior(camera)
            believed = {} if camera.verdict == "not trustworthy" else {"gravity": gravity}
            prior = pycolmap.PosePrior(corr_data_id=image.data_id, **believed, **position)
            if prior.has_gravity() or prior.has_position():
                database.write_pose_prior(prior)
            rows.append({
                "name": name, "camera_id": camera_id, "verdict": camera.verdict, "in_database": bool(believed),
                "focal_px": camera.focal_px, "focal_sigma_px": _half(camera.interval_68.focal_px),
                "gravity": gravity.tolist(), "gravity_covariance": covariance.tolist(),
                "tilt_sigma_deg": _half(camera.interval_68.tilt_deg),
                "roll_sigma_deg": _half(camera.interval_68.roll_deg),
            })  # fmt: skip
    finally:
        database.close()
    return rows


def _new_sensor(database: Any, stored: dict[str, Any], known: bool) -> tuple[int, int]:
    """Ids of a new camera and of its rig, which consists of that camera only."""
    import pycolmap

    camera = pycolmap.Camera(**stored, has_prior_focal_length=known)
    camera.camera_id = database.write_camera(camera)
    rig = pycolmap.Rig()
    rig.add_ref_sensor(camera.sensor_id)
    return camera.camera_id, database.write_rig(rig)


def _key(camera: PhotoCamera) -> str:
    """A key that is equal for photos of one camera."""
    stored = _stored(camera)
    return " ".join(f"{value:.{SAME}g}" for value in (stored["width"], stored["height"], *stored["params"]))


def _stored(camera: PhotoCamera) -> dict[str, Any]:
    """COLMAP's camera for the image as it is stored."""
    model, (focal, cx, cy, *distortion) = camera.colmap()
    width, height = camera.width, camera.height
    if camera.exif_orientation >= 5:
        width, height, cx, cy = height, width, cy, cx
    return {"model": model, "width": width, "height": height, "params": [focal, cx, cy, *distortion]}


def _position(path: Path) -> dict[str, Any]:
    """The position of a photo by EXIF; COLMAP needs the altitude too."""
    import pycolmap

    found, _ = photo_gps(path)
    if found is None or found.altitude_m is None:
        return {}
    place = [found.latitude_deg, found.longitude_deg, found.altitude_m]
    return {"position": place, "coordinate_system": pycolmap.PosePriorCoordinateSystem.WGS84}


def _half(ends: tuple[float, float]) -> float:
    return (ends[1] - ends[0]) / 2
