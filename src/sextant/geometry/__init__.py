"""Geometry: cameras and their distortion, rotations, poses in space and in the plane, the horizon.

Camera frames have x right, y down, z forward; world frames have z up; pixels have their centres at + 0.5.
Angles are in radians, lengths on the image in image heights unless they are called pixels. Everything is batched by
leading dimensions and differentiable.
"""

from sextant.geometry.camera import Camera, heights_from_pixels, pixels_from_heights
from sextant.geometry.distortion import (
    K2Family,
    distort_radius,
    distortion_factor,
    k2_of_k1,
    max_distorted_radius,
    max_radius,
    undistort_radius,
)
from sextant.geometry.equirectangular import EquirectangularCamera
from sextant.geometry.horizon import (
    horizon_foot,
    horizon_line,
    horizon_points,
    rho_from_tilt,
    tau_from_tilt,
    tilt_from_rho,
    tilt_from_tau,
)
from sextant.geometry.parameterization import (
    CameraParameters,
    Parameterization,
    ParameterSpace,
    focal_from_vfov,
    vfov_from_focal,
)
from sextant.geometry.perspective import PerspectiveCamera, perspective_bearings, perspective_project
from sextant.geometry.planar import se2_between, se2_compose, se2_exp, se2_inverse, se2_log, wrap_angle
from sextant.geometry.poses import (
    level_camera_pose,
    se3_compose,
    se3_exp,
    se3_from_rotation_translation,
    se3_inverse,
    se3_log,
    transform_points,
)
from sextant.geometry.rotations import (
    rotation_from_tilt_roll,
    so3_exp,
    so3_hat,
    so3_log,
    tilt_roll_from_up,
    up_in_camera,
)

__all__ = [
    "Camera",
    "CameraParameters",
    "EquirectangularCamera",
    "K2Family",
    "ParameterSpace",
    "Parameterization",
    "PerspectiveCamera",
    "distort_radius",
    "distortion_factor",
    "focal_from_vfov",
    "heights_from_pixels",
    "horizon_foot",
    "horizon_line",
    "horizon_points",
    "k2_of_k1",
    "level_camera_pose",
    "max_distorted_radius",
    "max_radius",
    "perspective_bearings",
    "perspective_project",
    "pixels_from_heights",
    "rho_from_tilt",
    "rotation_from_tilt_roll",
    "se2_between",
    "se2_compose",
    "se2_exp",
    "se2_inverse",
    "se2_log",
    "se3_compose",
    "se3_exp",
    "se3_from_rotation_translation",
    "se3_inverse",
    "se3_log",
    "so3_exp",
    "so3_hat",
    "so3_log",
    "tau_from_tilt",
    "tilt_from_rho",
    "tilt_from_tau",
    "tilt_roll_from_up",
    "transform_points",
    "undistort_radius",
    "up_in_camera",
    "vfov_from_focal",
    "wrap_angle",
]
