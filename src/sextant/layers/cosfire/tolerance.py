"""Rotations, scales and reflections of the prototype to which a filter also responds."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import torch
import torch.nn.functional as F
from annotated_types import MinLen
from jaxtyping import Float
from torch import Tensor

from sextant.ranges import Count, Positive, fits


class Move(NamedTuple):
    """How an image is moved about a point: mirrored left to right, then turned, then enlarged."""

    rotation_rad: float  # counter-clockwise as displayed
    scale: float
    mirrored: bool

    @property
    def nothing(self) -> bool:
        """Whether it leaves everything in place."""
        return self.rotation_rad == 0 and self.scale == 1 and not self.mirrored


@dataclass(frozen=True)
class Tolerance:
    """The moves of a prototype over which the strongest response counts.

    >>> [(round(move.rotation_rad, 2), move.scale) for move in Tolerance(rotations=2, scales=(0.5, 1.0)).moves()]
    [(0.0, 1.0), (0.0, 0.5), (3.14, 1.0), (3.14, 0.5)]

    Args:
        rotations: number of rotations, evenly spaced over ``span_deg`` from 0.
        span_deg: 360, or 180 for patterns that half a turn leaves unchanged.
        scales: scale factors.
        reflection: whether the mirror image counts as well.

    Raises:
        ValueError: no rotation or a fraction of one, no scale, a scale that is not positive, or a number that is not
            finite.
    """

    rotations: int = 1
    span_deg: float = 360.0
    scales: tuple[float, ...] = (1.0,)
    reflection: bool = False

    def __post_init__(self) -> None:
        scales = fits(Annotated[tuple[Positive, ...], MinLen(1)], self.scales)
        if not scales or not fits(Count, self.rotations) or not fits(float, self.span_deg):
            raise ValueError(
                "tolerance needs a whole number of rotations, at least one, a finite span_deg and positive scales; got "
                f"rotations={self.rotations}, span_deg={self.span_deg}, scales={self.scales}"
            )

    def moves(self) -> Iterator[Move]:
        """All combinations; the identity comes first if it is among them."""
        turns = [math.radians(self.span_deg * turn / self.rotations) for turn in range(self.rotations)]
        scales = [float(scale) for scale in sorted(self.scales, key=lambda scale: scale != 1)]
        for mirrored in (False, True)[: 1 + self.reflection]:
            for turn in turns:
                for scale in scales:
                    yield Move(turn, scale, mirrored)


def moved_image(
    image: Float[Tensor, "1 c h w"], point: tuple[float, float], move: Move
) -> tuple[Float[Tensor, "1 c H W"], tuple[float, float]]:
    """The image moved by ``move``, and where the point (x, y) then is.

    Quarter turns and reflections are exact and may swap height and width. All other moves keep the size and the point,
    interpolate bilinearly, and repeat the border.
    """
    x, y = point
    if move.mirrored:
        image, x = image.flip(-1), image.shape[-1] - 1 - x
    quarters = move.rotation_rad / (math.pi / 2)
    if move.scale == 1 and abs(quarters - round(quarters)) < 1e-9:
        for _ in range(round(quarters) % 4):
            x, y = y, image.shape[-1] - 1 - x
            image = torch.rot90(image, 1, (-2, -1))
        return image, (x, y)
    height, width = image.shape[-2:]
    columns = torch.arange(width, dtype=image.dtype, device=image.device) - x
    rows = torch.arange(height, dtype=image.dtype, device=image.device) - y
    cos, sin = math.cos(move.rotation_rad) / move.scale, math.sin(move.rotation_rad) / move.scale
    # where each pixel comes from: turned back, with y downwards
    from_x = x + cos * columns[None, :] - sin * rows[:, None]
    from_y = y + sin * columns[None, :] + cos * rows[:, None]
    grid = torch.stack([(2 * from_x + 1) / width - 1, (2 * from_y + 1) / height - 1], -1)
    return F.grid_sample(image, grid[None], padding_mode="border", align_corners=False), (x, y)
