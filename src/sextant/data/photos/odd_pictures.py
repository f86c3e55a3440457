"""Detect pictures given as photos that no camera took through a lens, each kind by its own mark."""

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.errors import UserError

#: longer side at which pictures are examined
SIDE = 512
#: a strip: longer side over shorter
STRIP = 3.5
#: difference to a neighbour, of 255, above which a pixel shows something; largest share of such pixels in a blank
#: picture
SHOWS, BLANK = 6, 0.004
#: share of pixels equal to those to the right and below, above which a picture was drawn, not taken
DRAWN = 0.65
DARK = 16  # of 255
#: standard deviation along the first or last row of a panorama, which is all zenith or nadir
POLE = 12
#: standard deviation along an edge without texture; largest variation of a circle's radius, relative to it
PLAIN, ROUND = 8, 0.08


def check_no_panorama(image: UInt8[ndarray, "h w 3"], name: str) -> None:
    """Raise a ``UserError`` if a picture is a full panorama."""
    if is_panorama(image):
        rows, columns = image.shape[:2]
        raise UserError(
            f"{name} is a panorama of 360 degrees ({columns}x{rows}, closed around), not a photo through one lens",
            "Give photos; panoramas are for dataset=panorama_folder, which cuts photos of known cameras from them.",
        )


def is_panorama(image: UInt8[ndarray, "h w 3"]) -> bool:
    """Whether a picture is a full panorama: 2:1, continuous across its edges, and one colour at a pole.

    Edges without texture do not count: before a plain backdrop, or in a frame, they are alike for any content.
    """
    edge = cv2.blur(image[:, :1].astype(np.float32), (1, 9))
    return closed_around(image) and float(np.std(edge, axis=0).mean()) > PLAIN


def closed_around(image: UInt8[ndarray, "h w 3"]) -> bool:
    """Whether a picture is 2:1, its left edge continues its right, and it is one colour at a pole."""
    rows, columns = image.shape[:2]
    if abs(columns / rows - 2) > 0.01:
        return False
    seam = _difference(image[:, 0], image[:, -1])
    steps, apart = range(0, columns - 1, max(columns // 64, 1)), int(0.37 * columns)
    beside = np.median([_difference(image[:, i], image[:, i + 1]) for i in steps])
    across = np.median([_difference(image[:, i], image[:, i - apart]) for i in steps])
    poles = [float(np.std(cv2.blur(row.astype(np.float32), (9, 1)), axis=1).mean()) for row in (image[:1], image[-1:])]
    return bool(seam < 3 * beside + 2 and seam < across / 2 and min(poles) < POLE)


def odd_picture(image: UInt8[ndarray, "h w 3"]) -> str | None:
    """Why a picture cannot be a photo through a lens of the model; None if it can be."""
    rows, columns = image.shape[:2]
    longer, shorter = max(rows, columns), min(rows, columns)
    if longer / shorter > STRIP:
        return f"a strip of {longer / shorter:.0f}:1 is not a whole photo: the position of its optical axis is unknown"
    step = max(longer // SIDE, 1)
    grey = cv2.cvtColor(np.ascontiguousarray(image[::step, ::step]), cv2.COLOR_RGB2GRAY).astype(np.int16)
    right, down = np.abs(np.diff(grey, axis=1))[1:], np.abs(np.diff(grey, axis=0))[:, 1:]
    if (np.maximum(right, down) > SHOWS).mean() < BLANK:
        return "it shows almost nothing: a blank wall, fog or darkness does not determine a camera"
    if ((right == 0) & (down == 0)).mean() > DRAWN:
        return "most of its pixels equal their neighbours: a screenshot, drawing or page, not a photo"
    if _in_a_circle(grey):
        return "its corners are dark around a bright circle: a fisheye picture, which the lens model does not cover"
    return None


def _in_a_circle(grey: ndarray) -> bool:
    """Whether all four corners are dark, and the dark ends at the same distance from the middle all around."""
    rows, columns = grey.shape
    dark = cv2.blur((grey < DARK).astype(np.float32), (5, 5)) > 0.5
    angles = np.linspace(0, 2 * np.pi, 96, endpoint=False)[:, None]
    along = np.linspace(0, 1, 256) * np.hypot(rows, columns) / 2
    row, column = rows / 2 + along * np.sin(angles), columns / 2 + along * np.cos(angles)
    inside = (row > 0) & (row < rows - 1) & (column > 0) & (column < columns - 1)
    bright = inside & ~dark[row.astype(int).clip(0, rows - 1), column.astype(int).clip(0, columns - 1)]
    last, end = (mask.shape[1] - 1 - mask[:, ::-1].argmax(axis=1) for mask in (bright, inside))
    meets = last < 0.97 * end  # elsewhere the circle is cut by the border
    corners = [dark[i, j] for i in (0, -1) for j in (0, -1)]
    if not all(corners) or meets.mean() < 0.2 or bright[:, :128].sum() < 0.7 * inside[:, :128].sum():
        return False
    return bool(np.ptp(np.quantile(last[meets], [0.1, 0.9])) < ROUND * np.median(last[meets]))


def _difference(first: ndarray, second: ndarray) -> float:
    return float(np.abs(first.astype(np.int16) - second.astype(np.int16)).mean())
