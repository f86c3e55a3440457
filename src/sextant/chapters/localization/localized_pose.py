"""The pose that live localization reports after a step."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray


@dataclass(frozen=True, eq=False)
class LocalizedPose:
    """The estimate after a step.

    Attributes:
        pose: x, y in the unit of the map and heading in rad, of the heaviest mode.
        covariance: covariance of 99 % of the belief about the pose, including other probable places.
        mass: share of the weight in the heaviest mode.
        modes: number of modes.
        lost: the heaviest mode holds less than half of the weight, or recent images were not foreseen, or, without
            odometry, not recognised.
        off_map: probability of being outside the mapped area; 0 for a filter without
            :class:`~sextant.localization.map_support.MapSupport`.
        degenerate: no particle explained the image, which was dropped.
        foreseen: mean share, over about twenty recent images, of the map that each resembled less than the place
            predicted before it. 1/2 is chance, less than 0.65 is lost; nan before the fifth image. See
            :mod:`~sextant.localization.innovation_test`.
        recognised: mean share, over recent images, of the map's own images that resemble its other places less than
            the recent image resembles the map. 1/2 is chance, less than 0.4 (of a drive's first four images, 1/2) is
            lost; nan where the motion is known. See :mod:`~sextant.localization.recognition`.
        disbelieved: the motion was treated as unknown, because odometry reported a standstill while the images showed
            motion. See :mod:`~sextant.localization.odometry_check`.
    """

    pose: Float64[ndarray, "3"]
    covariance: Float64[ndarray, "3 3"]
    mass: float
    modes: int
    lost: bool
    degenerate: bool = False
    off_map: float = 0.0
    foreseen: float = math.nan
    recognised: float = math.nan
    disbelieved: bool = False

    @property
    def sigmas(self) -> Float64[ndarray, "3"]:
        """Standard deviations of x, y and heading."""
        return np.asarray(np.sqrt(np.clip(self.covariance.diagonal(), 0.0, None)))
