r"""Images that no method can be expected to place: without content, or from a stopped train. Flagged, never dropped.

An image is *flat* if the standard deviation of its intensities (the mean of its channels, 0 to 255) is below
:data:`FLAT_SD`. The threshold lies in the gap of the training frames 0 to 1,599 of Nordland at 64 x 32 pixels: summer
has 60 frames below 8 (dark tunnels), none from 8 to 14 and 1,540 above; winter has 35 below 10.

An image is *still* if its mean absolute difference from the previous image of its traverse is below
:data:`STILL_DIFFERENCE`. Of the 1,599 steps between these frames, about 250 are below 2 and 1,310 above 8; few lie
between.
"""

import numpy as np
from jaxtyping import Bool, Float32, Int64
from numpy import ndarray

from sextant.data.places.image_rows import ImageRows

FLAT_SD = 10.0
STILL_DIFFERENCE = 3.0
#: images in memory at a time
CHUNK = 512


def flat_frames(images: ImageRows) -> Bool[ndarray, "n"]:
    """Whether the intensities of each image have a standard deviation below :data:`FLAT_SD`."""
    parts = [_grey(images, np.arange(start, min(start + CHUNK, len(images)))) for start in range(0, len(images), CHUNK)]
    return np.concatenate([part.std((1, 2)) < FLAT_SD for part in parts] or [np.zeros(0, bool)])


def still_frames(images: ImageRows, traverse: Int64[ndarray, "n"], frame: Int64[ndarray, "n"]) -> Bool[ndarray, "n"]:
    """Whether each image is *still*; False if the previous frame of its traverse is missing."""
    order = np.lexsort([frame, traverse])
    before, after = order[:-1], order[1:]
    follows = (traverse[before] == traverse[after]) & (frame[before] + 1 == frame[after])
    before, after = before[follows], after[follows]
    still = np.zeros(len(images), bool)
    for start in range(0, len(after), CHUNK):
        part = slice(start, start + CHUNK)
        difference = np.abs(_grey(images, after[part]) - _grey(images, before[part])).mean((1, 2))
        still[after[part]] = difference < STILL_DIFFERENCE
    return still


def _grey(images: ImageRows, rows: ndarray) -> Float32[ndarray, "k h w"]:
    return np.asarray(images[rows].mean(-1, dtype=np.float32))
