"""The full classical baseline: distortion from bent lines, then vanishing points, then everything at once.

The plumb-line estimate of ``k1_hat`` straightens the image, so that the detector finds whole lines instead of pieces of
arcs. Their ends are distorted again, and tilt, roll, heading, focal length and distortion are fitted together with the
exact lens model; the plumb-line estimate and its uncertainty are the prior of the distortion.
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from sextant.baselines.calibration.edge_chains import detect_chains
from sextant.baselines.calibration.estimate import CalibrationBaseline, CalibrationEstimate
from sextant.baselines.calibration.lens import apparent_k2, distort_points, undistort_points
from sextant.baselines.calibration.line_segments import (
    count_long,
    detect_segments,
    grey_segments,
    heights_from_working,
    longest_first,
    on_frame,
    working_grey,
)
from sextant.baselines.calibration.manhattan import BELIEFS
from sextant.baselines.calibration.plumb_line import straightening_k1_hat
from sextant.baselines.calibration.vanishing_points import find_frame

#: The straightened image is at most this many times as wide and high as the image.
LARGEST_CANVAS = 1.7
#: Smaller distortion does not affect the detector, and the image is not straightened.
NEGLIGIBLE = 0.02
#: Ends of segments may lie at most this far beyond the border of the picture, in image heights.
OVERSHOOT = 0.01


class CombinedGeometry(CalibrationBaseline):
    """Plumb lines, vanishing points and a joint fit of all parameters.

    Args:
        prior: belief about the camera; ``fit`` replaces it.
        seed: seed of the vanishing points' hypotheses; the same image and seed give the same camera.

    Example:
        >>> v, u = (np.mgrid[:256, :256] + 0.5) / 256 - 0.5
        >>> x, y = np.moveaxis(undistort_points(np.stack([u, v], axis=-1), -0.3, apparent_k2(-0.3, 0.87)), -1, 0)
        >>> bars = np.uint8(127.5 + 127.5 * np.sin(40 * x) * (abs(y) < 0.4))[..., None].repeat(3, axis=-1)  # bent
        >>> estimate = CombinedGeometry().calibrate(bars)
        >>> round(float(estimate.camera.k1 / estimate.camera.focal**2), 1), abs(round(float(estimate.camera.roll), 2))
        (-0.3, 0.0)
        >>> estimate.determined  # bars parallel to the picture do not show the focal length
        Determined(tilt=True, roll=True, focal=False, k1=True)
    """

    def calibrate(self, image: UInt8[ndarray, "h w 3"]) -> CalibrationEstimate:
        """The camera that took ``image``; what the image does not determine comes from the prior."""
        k1_hat, sigma = straightening_k1_hat(detect_chains(image), self.prior_)
        sharper = replace(self.prior_, k1_hat=k1_hat, sigma=(*self.prior_.sigma[:3], sigma))
        segments = detect_bent_segments(image, k1_hat, self.prior_.focal)
        found = find_frame(segments, sharper, seed=self.seed, bent=True)
        vector, covariance = sharper.vector, np.diag(np.square(sharper.sigma))
        if found is not None:
            vector, covariance = found.vector[BELIEFS], found.covariance[np.ix_(BELIEFS, BELIEFS)]
        return CalibrationEstimate.of_vector(vector, covariance, self.prior_, count_long(segments))


def detect_bent_segments(image: UInt8[ndarray, "h w 3"], k1_hat: float, focal: float) -> Float64[ndarray, "n 2 2"]:
    """Segments that are straight after undistortion, given by their ends in the original image, longest first.

    Args:
        image: RGB.
        k1_hat: apparent distortion of the lens.
        focal: in image heights; a rough value suffices.

    Raises:
        ValueError: it is not a uint8 RGB image.

    Example:
        >>> v, u = (np.mgrid[:256, :256] + 0.5) / 256 - 0.5
        >>> x, y = np.moveaxis(undistort_points(np.stack([u, v], axis=-1), -0.4, apparent_k2(-0.4, 0.9)), -1, 0)
        >>> bar = (abs(x - 0.25) < 0.1) & (abs(y) < 0.3)  # its sides, 0.6 long, are seen as arcs
        >>> ends = detect_bent_segments(255 * bar[..., None].repeat(3, axis=-1).astype(np.uint8), -0.4, focal=0.9)
        >>> first, second = undistort_points(ends[0], -0.4, apparent_k2(-0.4, 0.9))
        >>> round(float(np.linalg.norm(second - first)), 1)
        0.6
    """
    if abs(k1_hat) < NEGLIGIBLE:
        return detect_segments(image)
    k2_hat = float(apparent_k2(k1_hat, focal))
    grey = working_grey(image)
    edge = np.array([image.shape[1] / image.shape[0], 1.0]) / 2
    corners_and_sides = edge * np.array([[1, 1], [1, 0], [0, 1]])
    room = min(float((undistort_points(corners_and_sides, k1_hat, k2_hat).max(axis=0) / edge).max()), LARGEST_CANVAS)
    straight = _straighten(grey, edge, room, k1_hat, k2_hat)
    ends = heights_from_working(grey_segments(straight), straight, image) * room
    bent = distort_points(ends, k1_hat, k2_hat)
    middles = distort_points(ends.mean(axis=1, keepdims=True), k1_hat, k2_hat).repeat(2, axis=1)
    border = on_frame(bent, edge) | on_frame(middles, edge)  # in the straightened image it is an arc
    seen = (np.abs(bent) <= edge + OVERSHOOT).all(axis=(1, 2))
    return longest_first(np.clip(bent[seen & ~border], -edge, edge))


def _straighten(
    grey: UInt8[ndarray, "h w"], edge: Float64[ndarray, "2"], room: float, k1_hat: float, k2_hat: float
) -> UInt8[ndarray, "h2 w2"]:
    """The undistorted image, ``room`` times as wide and high; ``edge``: half of the image's sides in image heights.

    Beyond the border it is a single grey, so that lines end there: a replicated border would prolong them wrongly.
    """
    height, width = (max(round(side * room), 1) for side in grey.shape)
    columns, rows = (2 * (np.arange(count) + 0.5) / count - 1 for count in (width, height))
    points = np.stack(np.meshgrid(columns, rows), axis=-1) * edge * room
    source = (distort_points(points, k1_hat, k2_hat) / edge + 1) / 2 * grey.shape[::-1] - 0.5
    columns_of, rows_of = np.moveaxis(source.astype(np.float32), -1, 0)
    one_grey = int(grey.mean())
    return np.asarray(
        cv2.remap(grey, columns_of, rows_of, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=one_grey)
    )
