r"""Errors of predicted cameras against the true ones, image by image.

Errors are absolute, with their units in their names. Two of them are averaged over a 15 x 15 grid of image points
:math:`p`, edges included, with lengths in image heights:

- ``bearing_deg``: mean angle between the rays of the point in the gravity frame under the two cameras;
- ``undistortion_px``: with :math:`U(p) = f\,n(p)` the position of the point in the undistorted image and n its
  normalised undistorted coordinates, the mean of :math:`480\,\|\hat U(p) - U(p)\|`: pixels of an image 480 high. Each
  camera undistorts at its own f, so that the centre of the picture keeps its scale under both and only the bending of
  lines counts. Two cameras of equal :math:`k_1 / f^2` bend lines alike, but for the small part of k2 linear in k1.
"""

import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from sextant.geometry import (
    CameraParameters,
    K2Family,
    Parameterization,
    perspective_bearings,
    undistort_radius,
    vfov_from_focal,
    wrap_angle,
)
from sextant.losses.camera_losses import bearing_grid, world_bearings

GRID = 15  # points along each side of the image
PIXELS = 480  # of height, to which undistortion errors are scaled
#: the errors, in the order of tables
ERRORS = (
    "tilt_deg", "roll_deg", "vfov_deg", "true_vfov_deg", "focal_percent", "k1", "k1_hat", "bearing_deg",
    "undistortion_px",
)  # fmt: skip


def calibration_errors(
    predicted: CameraParameters,
    truth: CameraParameters,
    aspect: Float[Tensor, "n"],
    *,
    k2_of_k1: K2Family = "lopez",
) -> dict[str, Float[ndarray, "n"]]:
    """Absolute errors of each image, named by :data:`ERRORS`; see the module.

    Args:
        predicted: the predicted cameras; nan where a method has no estimate, which makes every error that needs it nan.
        truth: the true cameras.
        aspect: width over height of each image.
        k2_of_k1: the lens family.

    >>> truth = CameraParameters(*torch.tensor([[0.0], [0.0], [1.0], [0.0]]))
    >>> wrong = CameraParameters(*torch.tensor([[torch.pi / 90], [0.0], [1.1], [0.0]]))  # 2° up, 10 % too long
    >>> errors = calibration_errors(wrong, truth, aspect=torch.tensor([1.5]))
    >>> {name: round(float(errors[name][0]), 2) for name in ("tilt_deg", "focal_percent", "undistortion_px")}
    {'tilt_deg': 2.0, 'focal_percent': 10.0, 'undistortion_px': 0.0}
    """
    predicted, truth = predicted.to(dtype=torch.float64), truth.to(dtype=torch.float64)
    lens = Parameterization("direct", k2_of_k1)
    grid = bearing_grid(GRID, aspect.double())
    errors = {
        "tilt_deg": torch.rad2deg((predicted.tilt - truth.tilt).abs()),
        "roll_deg": torch.rad2deg(wrap_angle(predicted.roll - truth.roll).abs()),
        "vfov_deg": torch.rad2deg((vfov_from_focal(predicted.focal) - vfov_from_focal(truth.focal)).abs()),
        "true_vfov_deg": torch.rad2deg((true_vfov(predicted, lens) - true_vfov(truth, lens)).abs()),
        "focal_percent": 100 * (predicted.focal / truth.focal - 1).abs(),
        "k1": (predicted.k1 - truth.k1).abs(),
        "k1_hat": (predicted.k1 / predicted.focal.square() - truth.k1 / truth.focal.square()).abs(),
        "bearing_deg": torch.rad2deg(bearing_error(predicted, truth, grid, lens)),
        "undistortion_px": PIXELS * _distance(undistorted(predicted, grid, lens), undistorted(truth, grid, lens)),
    }
    return {name: values.cpu().numpy() for name, values in errors.items()}


def true_vfov(camera: CameraParameters, lens: Parameterization) -> Float[Tensor, "*b"]:
    """Angle between the rays through the middles of the top and bottom edges, in radians, including distortion.

    >>> cameras = CameraParameters(*torch.tensor([[0.0, 0.0], [0.0, 0.0], [0.5, 0.5], [0.0, -0.1]]))
    >>> torch.rad2deg(true_vfov(cameras, Parameterization("direct")))  # a barrel sees more
    tensor([90.0000, 97.2083])
    """
    return 2 * torch.atan(undistort_radius(0.5 / camera.focal, camera.k1, lens.k2(camera.k1)))


def bearing_error(
    predicted: CameraParameters, truth: CameraParameters, grid: Float[Tensor, "b n 2"], lens: Parameterization
) -> Float[Tensor, "b"]:
    """Mean angle between the rays of image points under two cameras, in the gravity frame, radians.

    >>> level, raised = (CameraParameters(*torch.tensor([[t], [0.0], [100.0], [0.0]])) for t in (0.0, 0.1))
    >>> bearing_error(raised, level, bearing_grid(GRID, torch.ones(1)), Parameterization("direct"))
    tensor([0.1000])
    """
    chord = world_bearings(predicted, lens, grid) - world_bearings(truth, lens, grid)
    half = torch.linalg.vector_norm(chord, dim=-1) / 2  # the sine of half the angle: exact for small ones
    return 2 * torch.asin(half.clamp(max=1)).mean(-1)


def undistorted(
    camera: CameraParameters, grid: Float[Tensor, "b n 2"], lens: Parameterization
) -> Float[Tensor, "b n 2"]:
    """Positions of image points after undistortion at the camera's own focal length, in image heights.

    >>> camera = CameraParameters(*torch.tensor([[0.0], [0.0], [1.0], [-0.1]]))  # a barrel: borders are pulled inwards
    >>> undistorted(camera, torch.tensor([[[0.0, 0.0], [0.5, 0.5]]]), Parameterization("direct"))[0]
    tensor([[0.0000, 0.0000],
            [0.5285, 0.5285]])
    """
    focal, k1 = camera.focal[:, None], camera.k1[:, None]
    rays = perspective_bearings(grid, focal, k1, lens.k2(k1))
    return focal[..., None] * rays[..., :2] / rays[..., 2:]


def _distance(first: Float[Tensor, "b n 2"], second: Float[Tensor, "b n 2"]) -> Float[Tensor, "b"]:
    distances: Tensor = torch.linalg.vector_norm(first - second, dim=-1)
    return distances.mean(-1)
