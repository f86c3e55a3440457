"""What a triangle is made of: rows of a table that the shading kernels read.

A mesh stores one row number per triangle. A row gives the kind of surface, its two colours (linear RGB), the frame of
its texture (an origin, and the heading of the horizontal texture axis), and up to eleven numbers that only this kind
uses. Textures are functions of position in that frame: nothing is stored as an image.
"""

from enum import IntEnum

import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray

#: columns of a row
KIND, SEED, RED, GREEN, BLUE, RED2, GREEN2, BLUE2, X, Y, Z, COS, SIN, P0 = range(14)
COLUMNS = 24


class Kind(IntEnum):
    """Kinds of surface, with the meaning of their parameters."""

    PLAIN = 0  # gloss
    FACADE = 1  # width, height, ground storey height, storeys, bays, ground use, window style, wall style, blank, trim
    ROOF = 2  # 0 tiles | 1 flat
    ROAD = 3  # length, half width, markings (0 none | 1 centre line | 2 lanes), crossing at start, crossing at end
    PAVEMENT = 4
    GRASS = 5
    KERB = 6
    BARK = 7
    LEAVES = 8  # radius of the crown; origin at the centre of the crown
    CONIFER = 9
    CAR = 10  # length, width, height
    HEDGE = 11
    SIGN = 12  # 0 round | 1 triangle | 2 board
    LAMP = 13
    PERSON = 14  # height
    FIELD = 15
    AWNING = 16  # width
    FENCE = 17  # height
    # indoors
    WALL = 18  # width, height, skirting height
    FLOOR = 19  # 0 carpet | 1 tiles | 2 planks
    CEILING = 20  # panel side, share of panels that are lamps
    DOOR = 21  # width, height
    WOOD = 22
    POSTER = 23  # width, height
    SCREEN = 24  # width, height
    WINDOW = 25  # width, height
    SHELF = 26  # width, height, boards


def linear(colour: str) -> tuple[float, float, float]:
    """Linear RGB of an sRGB colour written ``#rrggbb`` (IEC 61966-2-1)."""
    encoded = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in encoded)
    return red, green, blue


def palette(*colours: str) -> Float[ndarray, "n 3"]:
    """Linear RGB of several sRGB colours, one per row."""
    return np.array([linear(colour) for colour in colours])


def surface_rows(
    kind: Kind,
    count: int,
    *,
    seed: object = 0.0,
    colour: object = (0.5, 0.5, 0.5),
    second: object = (0.5, 0.5, 0.5),
    origin: object = (0.0, 0.0, 0.0),
    heading: object = 0.0,
    parameters: tuple[object, ...] = (),
) -> Float32[ndarray, "count 24"]:
    """Rows of the surface table; every argument is one value for all rows, or one per row.

    Args:
        seed: a number in [0, 1) that varies the texture.
        colour, second: linear RGB, ``(3,)`` or ``(count, 3)``.
        origin: origin of the texture frame, metres, ``(3,)`` or ``(count, 3)``.
        heading: direction of the texture's horizontal axis, radians counter-clockwise from world x.
        parameters: the kind's own numbers, each a scalar or ``(count,)``.
    """
    rows = np.zeros((count, COLUMNS), np.float64)
    rows[:, KIND] = kind
    rows[:, SEED] = np.asarray(seed)
    rows[:, RED : BLUE + 1] = np.asarray(colour)
    rows[:, RED2 : BLUE2 + 1] = np.asarray(second)
    rows[:, X : Z + 1] = np.asarray(origin)
    rows[:, COS] = np.cos(np.asarray(heading, np.float64))
    rows[:, SIN] = np.sin(np.asarray(heading, np.float64))
    for i, parameter in enumerate(parameters):
        rows[:, P0 + i] = np.asarray(parameter)
    return rows.astype(np.float32)
