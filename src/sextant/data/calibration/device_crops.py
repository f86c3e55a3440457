"""Crops on any device, by torch's ``grid_sample``: the same rays and the same samples as on the CPU."""

import math
from collections import defaultdict

import numpy as np
import torch
from jaxtyping import Float, Int64, UInt8
from numpy import ndarray
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

from sextant.data.calibration.panoramas import Panoramas
from sextant.data.calibration.ray_sampling import Sampling
from sextant.data.calibration.rays import Rays, centres

#: rays worked on at a time: bounds the memory of a large batch
CHUNK = 1 << 23


def crop_on_device(
    panoramas: Panoramas,
    indices: Int64[ndarray, "b"],
    rays: Rays,
    sampling: Sampling,
    width: int,
    height: int,
    device: torch.device,
) -> UInt8[Tensor, "b 3 height width"]:
    """See :func:`~sextant.data.calibration.crops.crop_batch`; crops of one level of one panorama are cut at once."""
    out = torch.empty(len(indices), 3, height, width, dtype=torch.uint8, device=device)
    groups: dict[tuple[int, int, int], list[int]] = defaultdict(list)
    for i, key in enumerate(zip(indices.tolist(), sampling.level.tolist(), sampling.side.tolist(), strict=True)):
        groups[key].append(i)
    lens, rotation = torch.from_numpy(rays.lens).to(device), torch.from_numpy(rays.rotation).to(device)
    for side in np.unique(sampling.side).tolist():
        chosen = [(key, members) for key, members in groups.items() if key[2] == side]
        most = max(1, CHUNK // (side * side * width * height))
        parts = [(key, members[k : k + most]) for key, members in chosen for k in range(0, len(members), most)]
        for (index, level, _), members in parts:
            which = torch.tensor(members, device=device)
            steps = int(rays.steps[members].max())
            points = _directions(lens[which], rotation[which], steps, side * width, side * height)
            image = panoramas.level_on(index, level, device)
            crops = _sampled(image, points)
            out[which] = (avg_pool2d(crops, side) if side > 1 else crops).add_(0.5).to(torch.uint8)
    return out


def _directions(
    lens: Float[Tensor, "n 4"], rotation: Float[Tensor, "n 9"], steps: int, width: int, height: int
) -> Float[Tensor, "n height width 2"]:
    """Longitude and downward latitude of every ray, in half turns and quarter turns."""
    x = torch.from_numpy(centres(width)).to(lens.device) * lens[:, 0, None, None]
    y = torch.from_numpy(centres(height)).to(lens.device)[:, None] * lens[:, 1, None, None]
    x, y = torch.broadcast_tensors(x, y)
    k1, k2 = lens[:, 2, None, None], lens[:, 3, None, None]
    wanted = torch.hypot(x, y)
    radius = wanted
    for _ in range(steps):
        square = radius * radius
        excess = radius * (1 + square * (k1 + k2 * square)) - wanted
        radius = radius - excess / (1 + square * (3 * k1 + 5 * k2 * square))
    square = radius * radius
    factor = 1 / (1 + square * (k1 + k2 * square))
    u, v = x * factor, y * factor
    right, down, ahead = (
        a * u + b * v + c for a, b, c in rotation.reshape(-1, 3, 3, 1, 1).permute(1, 2, 0, 3, 4).unbind(0)
    )
    latitude = torch.atan2(down, torch.hypot(right, ahead))
    return torch.stack([torch.atan2(right, ahead) / math.pi, latitude / (math.pi / 2)], dim=-1)


def _sampled(
    image: UInt8[Tensor, "3 h w"], points: Float[Tensor, "n rows columns 2"]
) -> Float[Tensor, "n 3 rows columns"]:
    """The padded image at points, interpolated linearly."""
    n, rows, columns = points.shape[:3]
    height, width = image.shape[1:]
    inside = torch.tensor([(width - 2) / width, (height - 2) / height], device=image.device)
    grid = (points * inside).reshape(1, n * rows, columns, 2)
    sampled = grid_sample(image[None].float(), grid, "bilinear", "border", align_corners=False)
    return sampled.reshape(3, n, rows, columns).transpose(0, 1)
