"""What is given as a photo and is none that a camera took through a lens: each is found by its own mark."""

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.errors import UserError

#: longer side that pictures are looked at
SIDE = 512
#: a strip: longer side over shorter
STRIP = 3.5
#: difference to a neighbour, of 255, from which a pixel shows something; the share of such pixels in a blank picture
SHOWS, BLANK = 6, 0.004
#: share of pixels that equal all four neighbours, from which a picture was drawn and not taken
DRAWN = 0.65
DARK = 16  # of 255
#: standard deviation along the first or last row of a panorama, all of which is the zenith or nadir
POLE = 12


def check_no_panorama(image: UInt8[ndarray, "h w 3"], name: str) -> None:
    """Raise a ``UserError`` if a picture is a full panorama."""
    if is_panorama(image):
        rows, columns = image.shape[:2]
        raise UserError(
            f"{name} is a panorama of 360 degrees ({columns}x{rows}, closed around), not a photo through one lens",
            "Give photos; panoramas are for dataset=panorama_folder, which cuts photos of known cameras from them.",
        )


def is_panorama(image: UInt8[ndarray, "h w 3"]) -> bool:
    """Whether a picture is a full panorama: 2:1, closed around, and one colour at a pole."""
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
    """Why a picture is none that a lens of the model took; None where nothing speaks against it."""
    rows, columns = image.shape[:2]
    longer, shorter = max(rows, columns), min(rows, columns)
    if longer / shorter > STRIP:
        return f"a strip of {longer / shorter:.0f}:1 is no whole photo: where its lens looked is not in it"
    step = max(longer // SIDE, 1)
    grey = cv2.cvtColor(np.ascontiguousarray(image[::step, ::step]), cv2.COLOR_RGB2GRAY).astype(np.int16)
    right, down = np.abs(np.diff(grey, axis=1))[1:], np.abs(np.diff(grey, axis=0))[:, 1:]
    if (np.maximum(right, down) > SHOWS).mean() < BLANK:
        return "it shows next to nothing: a blank wall, fog or the dark say nothing of a camera"
    if ((right == 0) & (down == 0)).mean() > DRAWN:
        return "most of its pixels equal their neighbours: a screenshot, drawing or page, not a photo"
    if _in_a_circle(grey):
        return "its corners are dark around a bright circle: a fisheye's picture, which the lens model does not cover"
    return None


def _in_a_circle(grey: ndarray) -> bool:
    """Whether all four corners are dark, and what lies between them and the middle is not."""
    rows, columns = grey.shape
    v, u = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : columns * 1j]
    height, width = min(rows / columns, 1), min(columns / rows, 1)
    radius = np.hypot(u * width, v * height) / np.hypot(width, height)
    corners = (grey[radius > 0.93] < DARK).mean()
    middle = (grey[radius < 0.5] < DARK).mean()
    return bool(corners > 0.98 and middle < 0.3)


def _difference(first: ndarray, second: ndarray) -> float:
    return float(np.abs(first.astype(np.int16) - second.astype(np.int16)).mean())
