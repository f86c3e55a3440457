"""Line evidence of a photo: chains of edge pixels, straight segments, and a first estimate of the distortion."""

from dataclasses import dataclass, replace

from jaxtyping import Float64, UInt8
from numpy import ndarray

from sextant.baselines.calibration.combined import detect_bent_segments
from sextant.baselines.calibration.edge_chains import detect_chains
from sextant.baselines.calibration.estimate import CameraPrior
from sextant.baselines.calibration.plumb_line import straightening_k1_hat
from sextant.baselines.calibration.vanishing_points import explained_share

#: prior for straightening chains before segments are detected
FIRST = CameraPrior(focal=0.9, k1_hat=-0.03, sigma=(0.3, 0.1, 0.4, 0.15))


@dataclass(frozen=True, eq=False)
class LineEvidence:
    """The lines of one photo.

    Attributes:
        chains: smooth chains of edge pixels, in image heights from the centre.
        segments: ends of segments that are straight after undistortion, longest first.
        k1_hat: the distortion that straightens the chains, a first estimate.
        longer: longer side of the photo, in image heights.
        shorter: shorter side, in image heights; pixels, and so the noise of lines, are the same fraction of it in
            portrait and landscape.
        explained: share of the segments' length that some frame of three orthogonal axes explains beyond chance.

    Example:
        >>> import numpy as np
        >>> image = np.zeros((192, 256, 3), np.uint8)
        >>> image[:, 64:192] = 255  # a band with two straight edges
        >>> lines = LineEvidence.of(image)
        >>> len(lines.chains), len(lines.segments), round(lines.longer, 2), abs(round(lines.k1_hat, 2))
        (2, 2, 1.33, 0.0)
    """

    chains: Float64[ndarray, "n points 2"]
    segments: Float64[ndarray, "m 2 2"]
    k1_hat: float
    longer: float
    explained: float = 1.0
    shorter: float = 1.0

    @classmethod
    def of(cls, image: UInt8[ndarray, "h w 3"]) -> "LineEvidence":
        """The lines of an RGB image.

        Raises:
            ValueError: it is not a uint8 RGB image.
        """
        chains = detect_chains(image)
        k1_hat, _ = straightening_k1_hat(chains, FIRST)
        longer = max(image.shape[1] / image.shape[0], 1.0)
        segments = detect_bent_segments(image, k1_hat, FIRST.focal)
        explained = explained_share(segments, replace(FIRST, k1_hat=k1_hat, focal=FIRST.focal * longer), seed=0)
        return cls(chains, segments, k1_hat, longer, explained, min(image.shape[1] / image.shape[0], 1.0))
