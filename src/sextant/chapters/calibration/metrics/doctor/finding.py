"""Results of a check, and the cameras used in the checks."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.geometry import CameraParameters, EquirectangularCamera, PerspectiveCamera, rotation_from_tilt_roll

DOUBLE = torch.float64


@dataclass(frozen=True)
class Finding:
    """One measured figure and its limits.

    Attributes:
        check: what is checked.
        figure: what is measured, with its unit.
        value: the measured value.
        low, high: limits, inclusive.
    """

    check: str
    figure: str
    value: float
    high: float
    low: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether the figure is within its limits."""
        return self.low <= self.value <= self.high


def random_cameras(count: int, seed: int = 0, max_tilt: float = 1.3) -> CameraParameters:
    """Cameras of 13 to 38 mm with k1 from -0.4 to 0, float64."""
    generator = torch.Generator().manual_seed(seed)
    low = torch.tensor([-max_tilt, -math.pi / 4, 0.481, -0.4], dtype=DOUBLE)
    high = torch.tensor([max_tilt, math.pi / 4, 1.407, 0.0], dtype=DOUBLE)
    return CameraParameters(*(low + (high - low) * torch.rand(count, 4, generator=generator, dtype=DOUBLE)).unbind(-1))


def largest_bow(points: Float[Tensor, "b n 2"]) -> float:
    """Largest distance of points from the chord of their curve; nan for fewer than three points."""
    if points.shape[1] < 3:
        return math.nan
    chord = points[:, -1] - points[:, 0]
    normal = torch.stack([-chord[:, 1], chord[:, 0]], -1) / chord.norm(dim=-1, keepdim=True)
    return float(((points - points[:, :1]) * normal[:, None]).sum(-1).abs().max())


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


def crop_against_render(crop: Crop) -> list[Finding]:
    """Crops of a panorama of :func:`analytic_colour` against its colours along the exact rays, in grey levels."""
    width, height, rows = 128, 96, 512
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


def edge_in_crop(crop: Crop) -> list[Finding]:
    """The bow of a straight edge painted on a panorama, in a distorted crop and after undistortion, in pixels."""
    width, height, rows = 256, 192, 1024
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
        Finding("crop", "straight edge in the crop: bow, pixels", largest_bow(pixels[None]), math.inf, 2.0),
        Finding("crop", "straight edge undistorted: bow, pixels", largest_bow(ideal[None]), 0.25),
    ]
