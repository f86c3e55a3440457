"""The dimensions and styles of buildings, drawn at random for given footprints."""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray

from sextant.worlds.shading.facade import (
    BOARDS,
    BRICK,
    CURTAIN,
    FRENCH,
    GARAGE,
    HOME,
    OFFICE,
    PANELS,
    PLASTER,
    RIBBON,
    SASH,
    SHOP,
    SQUARE,
    STONE,
)

FLAT, GABLE, HIP, MANSARD = range(4)
#: one value for all buildings, or one for each
Number = Float64[ndarray, "n"] | float


@dataclass(frozen=True)
class Buildings:
    """Many buildings, one array per attribute. In a building's frame, x runs along its street and y away from it.

    Attributes:
        position: middle of the footprint on the ground, metres.
        heading: direction of x, radians.
        size: width along the street, depth, height of the walls.
        roof: FLAT, GABLE, HIP or MANSARD.
        rise: height of the roof above the walls.
        across: whether the ridge is perpendicular to the street.
        storeys, ground: number of storeys, and height of the ground storey.
        use: what the ground storey is used for (HOME, SHOP, GARAGE, OFFICE).
        window, wall: style of windows and walls.
        attached: whether a neighbour adjoins on the left (-x) and on the right.
        seed: in [0, 1).
    """

    position: Float64[ndarray, "n 3"]
    heading: Float64[ndarray, "n"]
    size: Float64[ndarray, "n 3"]
    roof: Int64[ndarray, "n"]
    rise: Float64[ndarray, "n"]
    across: Bool[ndarray, "n"]
    storeys: Int64[ndarray, "n"]
    ground: Float64[ndarray, "n"]
    use: Int64[ndarray, "n"]
    window: Int64[ndarray, "n"]
    wall: Int64[ndarray, "n"]
    attached: Bool[ndarray, "n 2"]
    seed: Float64[ndarray, "n"]

    def __len__(self) -> int:
        return len(self.position)

    def some(self, at: Int64[ndarray, "k"] | Bool[ndarray, "n"]) -> "Buildings":
        """The buildings with indices ``at``, or those where ``at`` is true."""
        return Buildings(**{field.name: getattr(self, field.name)[at] for field in fields(self)})

    @property
    def outline(self) -> Float64[ndarray, "n 4 2"]:
        """Corners of the footprint in the building's frame, counter-clockwise from the front left."""
        w, d = self.size[:, 0], self.size[:, 1]
        signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        return np.stack([np.stack([sx * w / 2, sy * d / 2], -1) for sx, sy in signs], 1)

    def beside(self, x: Number, y: Number, z: Number) -> Float64[ndarray, "n 3"]:
        """World positions of a point given in the frame of each building."""
        x, y, z = (np.broadcast_to(np.asarray(v, float), len(self)) for v in (x, y, z))
        c, s = np.cos(self.heading), np.sin(self.heading)
        return np.asarray(self.position + np.stack([c * x - s * y, s * x + c * y, z], -1))


def design(
    position: Float64[ndarray, "n 3"],
    heading: Float64[ndarray, "n"],
    footprint: Float64[ndarray, "n 2"],
    density: Float64[ndarray, "n"],
    attached: Bool[ndarray, "n 2"],
    terraced: Bool[ndarray, "n"],
    rng: np.random.Generator,
) -> Buildings:
    """Buildings for footprints: tall ones with shops where ``density`` (0 to 1) is high, houses where it is low.

    Args:
        position, heading: of the middle of the footprints.
        footprint: width along the street, and depth, metres.
        attached: whether a neighbour adjoins on the left and on the right.
        terraced: whether the ridge must run along the street.
    """
    draw = rng.random((11, len(position)))
    office = (density > 0.72) & (draw[0] < 0.3)
    storeys = _storeys(density, office, draw[1])
    use = np.where(draw[2] < np.clip(1.5 * density - 0.4, 0, 0.85), SHOP, np.where(draw[2] > 0.8, GARAGE, HOME))
    use = np.where(office, OFFICE, use)
    ground = np.where((use == SHOP) | (use == OFFICE), 3.6 + 0.8 * draw[3], 2.8 + 0.4 * draw[3])
    storey_height = np.where(office, 3.4, 2.75 + 0.55 * draw[4])
    height = ground + (storeys - 1) * storey_height + np.where(storeys > 1, 0.35, 0.25)
    wall, window, roof = _styles(density > 0.45, office, draw[5:8])
    roof = np.where(office | (storeys > 5), FLAT, roof)
    across = ~terraced & (draw[8] < 0.35)
    span = np.where(across, footprint[:, 0], footprint[:, 1])
    pitched = np.clip(span * (0.26 + 0.16 * draw[9]), 1.2, 5.5)
    return Buildings(
        position=position,
        heading=heading,
        size=np.column_stack([footprint, height]),
        roof=roof,
        rise=np.select([roof == FLAT, roof == MANSARD], [0.0, 2.3 + 0.5 * draw[9]], pitched),
        across=across,
        storeys=storeys,
        ground=ground,
        use=use,
        window=window,
        wall=wall,
        attached=attached,
        seed=draw[10],
    )


def _storeys(
    density: Float64[ndarray, "n"], office: Bool[ndarray, "n"], draw: Float64[ndarray, "n"]
) -> Int64[ndarray, "n"]:
    """One or two in villages, up to seven in a centre, four to eight for offices."""
    dense = 2 + np.floor(4.4 * density * draw + 0.8)
    sparse = 1 + np.floor(1.75 * draw + 0.35)
    tall = 4 + np.floor(5 * draw)
    return np.where(office, tall, np.where(density > 0.45, dense, sparse)).astype(np.int64)


def _styles(
    dense: Bool[ndarray, "n"], office: Bool[ndarray, "n"], draw: Float64[ndarray, "3 n"]
) -> tuple[Int64[ndarray, "n"], Int64[ndarray, "n"], Int64[ndarray, "n"]]:
    """Styles of walls, windows and roofs, in the proportions of towns, villages and offices."""
    for_wall, for_window, for_roof = draw
    wall = np.where(
        dense,
        np.select([for_wall < 0.55, for_wall < 0.78, for_wall < 0.93], [PLASTER, BRICK, STONE], PANELS),
        np.select([for_wall < 0.5, for_wall < 0.75], [PLASTER, BRICK], BOARDS),
    )
    wall = np.where(office, np.where(for_wall < 0.7, PANELS, STONE), wall)
    window = np.where(
        dense,
        np.select([for_window < 0.4, for_window < 0.65], [SASH, FRENCH], SQUARE),
        np.select([for_window < 0.35], [SASH], SQUARE),
    )
    window = np.where(office, np.where(for_window < 0.55, RIBBON, CURTAIN), window)
    roof = np.where(
        dense,
        np.select([for_roof < 0.4, for_roof < 0.62, for_roof < 0.8], [GABLE, MANSARD, HIP], FLAT),
        np.select([for_roof < 0.62, for_roof < 0.92], [GABLE, HIP], FLAT),
    )
    return wall, window, roof


def footprints(b: Buildings) -> Float32[ndarray, "n 4 2"]:
    """Corners of the footprints, for maps and to keep things out of houses."""
    x, y = np.moveaxis(b.outline, -1, 0)
    c, s = np.cos(b.heading)[:, None], np.sin(b.heading)[:, None]
    turned = np.stack([c * x - s * y, s * x + c * y], -1)
    return np.asarray(turned + b.position[:, None, :2], np.float32)
