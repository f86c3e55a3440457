"""Cameras from the lines of one image, by every method; few imports, for use in worker processes."""

from collections.abc import Sequence

from jaxtyping import UInt8
from numpy import ndarray

from sextant.baselines.calibration.estimate import CalibrationBaseline, camera_of_vector
from sextant.baselines.calibration.joint import joint_estimate
from sextant.baselines.calibration.line_evidence import LineEvidence
from sextant.baselines.calibration.line_segments import LONG, detect_segments, segment_lengths
from sextant.baselines.calibration.terms import CameraBelief
from sextant.geometry import CameraParameters


def cameras_by_lines(
    methods: Sequence[CalibrationBaseline], image: UInt8[ndarray, "h w 3"], belief: CameraBelief
) -> list[CameraParameters]:
    """The camera by each of ``methods``, then the one from all lines and a network's ``belief``.

    >>> import numpy as np
    >>> from sextant.baselines.calibration import VanishingPoints
    >>> belief = CameraBelief(tilt=0.1, roll=0.0, focal=1.0, k1_hat=0.0, sigma=(0.1, 0.1, 0.2, 0.1))
    >>> _, joint = cameras_by_lines([VanishingPoints()], np.zeros((64, 64, 3), np.uint8), belief)
    >>> round(float(joint.tilt), 3)  # no lines: what the network believes
    0.1
    """
    joint = joint_estimate(LineEvidence.of(image), [belief])
    return [*(method.calibrate(image).camera for method in methods), camera_of_vector(joint.vector)]


def look_of_lines(image: UInt8[ndarray, "h w 3"]) -> tuple[int, float, float]:
    """Lines and brightness of an image.

    Returns:
        The number of segments longer than a tenth of the height, their share of the length of all segments (1 without
        any), and the mean grey, from 0 to 255.

    >>> import numpy as np
    >>> stripes = np.zeros((64, 64, 3), np.uint8)
    >>> stripes[:, 16:48] = 255
    >>> look_of_lines(stripes)  # two edges, half of it white
    (2, 1.0, 127.5)
    """
    lengths = segment_lengths(detect_segments(image))
    among = float(lengths[lengths > LONG].sum() / lengths.sum()) if len(lengths) else 1.0
    return int((lengths > LONG).sum()), among, float(image.mean())
