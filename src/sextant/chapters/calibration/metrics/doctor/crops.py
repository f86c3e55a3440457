"""Checks of crops, on panoramas whose colour is a known function of the direction."""

import math
from collections.abc import Callable

import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.chapters.calibration.metrics.doctor.finding import DOUBLE, Finding, largest_bow, random_cameras
from sextant.geometry import CameraParameters, EquirectangularCamera, PerspectiveCamera, rotation_from_tilt_roll

#: cuts crops of one panorama: (panorama, cameras, yaw to the right, width, height) -> (b, 3, height, width)
Crop = Callable[
    [UInt8[ndarray, "h w 3"], CameraParameters, Float[Tensor, "b"], int, int],
    UInt8[ndarray, "b 3 height width"] | UInt8[Tensor, "b 3 height width"],
]


def analytic_colour(directions: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """Colours from 20 to 220 that vary smoothly with the direction, differently along each axis."""
    waves = torch.tensor([[3.0, 1.0, -2.0], [-1.0, 4.0, 1.5], [2.0, -2.5, 3.0]], dtype=directions.dtype)
    return 120 + 100 * torch.sin(directions @ waves.T + torch.tensor([0.3, 1.1, 2.0], dtype=directions.dtype))


def crop_rays(cameras: CameraParameters, yaw: Tensor, width: int, height: int) -> Float[Tensor, "b h w 3"]:
    """Directions of the pixels of crops in the panorama, computed by the camera class."""
    lens = PerspectiveCamera.from_focal(cameras.focal, width, height, k1=cameras.k1)
    rays = lens.bearings(lens.pixel_centres())
    zero, one = torch.zeros_like(yaw), torch.ones_like(yaw)
    turn = [torch.cos(yaw), zero, torch.sin(yaw), zero, one, zero, -torch.sin(yaw), zero, torch.cos(yaw)]
    rotation = torch.stack(turn, -1).reshape(-1, 3, 3) @ rotation_from_tilt_roll(cameras.tilt, cameras.roll)
    return rays @ rotation[:, None].mT


def crop_against_render(crop: Crop, width: int = 128, height: int = 96, rows: int = 512) -> list[Finding]:
    """Crops of a panorama of :func:`analytic_colour` against its colours along the exact rays, in grey levels."""
    panorama_camera = EquirectangularCamera(2 * rows, rows)
    panorama = analytic_colour(panorama_camera.bearings(panorama_camera.pixel_centres(dtype=DOUBLE)))
    cameras = random_cameras(12, 5)
    yaw = torch.linspace(-math.pi, math.pi, 12, dtype=DOUBLE)
    crops = torch.as_tensor(crop(panorama.round().to(torch.uint8).numpy(), cameras, yaw, width, height))
    exact = analytic_colour(crop_rays(cameras, yaw, width, height)).movedim(-1, 1)
    difference = (crops - exact).abs()
    return [
        Finding("crop", "against the render, largest, grey levels", difference.max().item(), 2.0),
        Finding("crop", "against the render, mean, grey levels", difference.mean().item(), 0.5),
    ]


def edge_in_crop(crop: Crop, width: int = 256, height: int = 192, rows: int = 1024) -> list[Finding]:
    """The bow of a straight edge painted on a panorama, in a distorted crop and after undistortion, in pixels."""
    normal = torch.tensor([0.87, -0.13, -0.47], dtype=DOUBLE)
    panorama_camera = EquirectangularCamera(2 * rows, rows)
    side = panorama_camera.bearings(panorama_camera.pixel_centres(dtype=DOUBLE)) @ normal
    grey = (127.5 + 120 * torch.tanh(side / 0.05)).round().to(torch.uint8)
    camera = CameraParameters(*torch.tensor([[0.1], [0.05], [0.6], [-0.35]], dtype=DOUBLE))
    picture = torch.as_tensor(crop(grey[..., None].expand(-1, -1, 3).numpy(), camera, camera.tilt * 0, width, height))
    line = picture[0, 0].double() - 127.5
    rising = (line[:, :-1] < 0) & (line[:, 1:] >= 0)
    row, column = rising.nonzero().unbind(-1)
    before, after = line[row, column], line[row, column + 1]
    pixels = torch.stack([column + 0.5 - before / (after - before), row + 0.5], -1)
    lens = PerspectiveCamera.from_focal(camera.focal[0], width, height, k1=camera.k1[0])
    rays = lens.bearings(pixels)
    ideal = height * camera.focal[0] * rays[:, :2] / rays[:, 2:]
    return [
        Finding("crop", "straight edge as seen: bow, pixels", largest_bow(pixels[None]), math.inf, 2.0),
        Finding("crop", "straight edge undistorted: bow, pixels", largest_bow(ideal[None]), 0.25),
    ]
