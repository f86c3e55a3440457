"""Whether matches of two photos show two motions: then no camera and no pose explains the scene as one still thing.

The matches that agree with the most supported epipolar geometry are taken away, and those near it, which a lens with
distortion would leave behind. If one other geometry then explains most of the rest, by enough matches, something moved;
wrong matches agree with no common geometry. What moves along its epipolar lines is not seen.
"""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.correspondence.matching import epipolar_inliers

#: matches of a second motion, and their least share of the matches that the first does not explain
LEAST, SHARE = 30, 0.5
#: their least share of all matches. Windows matched with their neighbours make second motions of still facades, of at
#: most 4.5 % among the 48 pairs of neighbouring photos of ``strecha_posed``. Less than this has little say
OF_ALL = 0.06
#: matches this near to the first geometry, in largest errors of right ones, are not asked
NEAR = 4.0


def second_motion(
    first: Float64[ndarray, "m 2"],
    second: Float64[ndarray, "m 2"],
    squared: Float64[ndarray, "m"],
    largest_px: float,
) -> int:
    """The number of matches that move together in another way than most do; 0 if there is no second motion.

    Args:
        first, second: matched pixels.
        squared: their squared errors in the first geometry, pixels.
        largest_px: largest error of a right match.

    Example:
        >>> rng = np.random.default_rng(0)
        >>> one, moved = rng.uniform(0, 600, (100, 2)), np.zeros((100, 2))
        >>> moved[:60, 0], moved[60:, 1] = 10, 20 + rng.uniform(0, 40, 40)  # along the rows, and along the columns
        >>> off = (one + moved - one)[:, 1]
        >>> second_motion(one, one + moved, off**2, largest_px=2.0) >= 35
        True
    """
    rest = squared > (NEAR * largest_px) ** 2
    if rest.sum() < LEAST:
        return 0
    found = epipolar_inliers(first[rest].astype(np.float32), second[rest].astype(np.float32), largest_px)
    together = int(found.sum())
    return together if together >= max(LEAST, SHARE * rest.sum(), OF_ALL * len(rest)) else 0
