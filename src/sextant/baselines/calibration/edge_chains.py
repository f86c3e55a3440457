"""Smooth chains of edge pixels with subpixel accuracy: the images of straight lines under distortion."""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, UInt8
from numpy import ndarray
from scipy.ndimage import map_coordinates

from sextant.baselines.calibration.line_segments import FRAME, heights_from_working, working_grey

#: Canny's thresholds on Sobel gradients of a slightly blurred image of 8 bits.
WEAK, STRONG = 60, 120
#: A chain ends where it turns by more than this within this many pixels on both sides.
TURN, REACH = np.radians(32), 5
#: Shorter chains, in image heights, are too short to measure bending.
SHORTEST = 0.1
#: Number of averaged points per chain.
POINTS = 16


def detect_chains(image: UInt8[ndarray, "h w 3"]) -> Float64[ndarray, "n points 2"]:
    """Chains, each of :data:`POINTS` points ``(u, v)`` in image heights from the centre, evenly spaced along it.

    Each point is the mean of a stretch of edge pixels, each moved across the edge to the peak of the gradient (a
    parabola through three values).

    Raises:
        ValueError: it is not a uint8 RGB image.

    Example:
        >>> image = np.zeros((256, 256, 3), np.uint8)
        >>> image[:, 64:192] = 255  # a band whose edges are a quarter of the height off the centre
        >>> chains = detect_chains(image)
        >>> chains.shape, sorted(chains[..., 0].mean(axis=1).round(2).tolist())
        ((2, 16, 2), [-0.25, 0.25])
    """
    grey = working_grey(image)
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0).astype(np.float32)
    dx, dy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    edges = cv2.Canny(dx.astype(np.int16), dy.astype(np.int16), WEAK, STRONG, L2gradient=True)
    margin = int(np.ceil(FRAME * grey.shape[0]))
    inside = np.zeros_like(edges)
    inside[margin:-margin, margin:-margin] = edges[margin:-margin, margin:-margin]
    contours = [c[:, 0] for c in cv2.findContours(inside, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]]
    contours = [contour for contour in contours if len(contour) > 2 * REACH]
    if not contours:
        return np.zeros((0, POINTS, 2))
    pixels = np.concatenate(contours)
    fine = _to_peak(pixels, dx, dy)
    chains, used = [], np.zeros(edges.shape, bool)
    for run in _smooth_runs(pixels, contours):
        if np.hypot(*(pixels[run.start] - pixels[run.stop - 1])) < SHORTEST * grey.shape[0]:
            continue
        columns, rows = pixels[run].T
        if used[rows, columns].mean() < 0.3:  # a contour runs along both sides of a thin edge
            used[rows, columns] = True
            chains.append(_averaged(fine[run]))
    if not chains:
        return np.zeros((0, POINTS, 2))
    return heights_from_working(np.stack(chains) + 0.5, grey, image)


def _to_peak(
    pixels: Int[ndarray, "n 2"], dx: Float32[ndarray, "h w"], dy: Float32[ndarray, "h w"]
) -> Float64[ndarray, "n 2"]:
    """Edge pixels moved along the gradient to the peak of its length, by at most one pixel."""
    length = np.hypot(dx, dy)
    columns, rows = pixels.T
    across = np.stack([dx[rows, columns], dy[rows, columns]], axis=-1) / (length[rows, columns, None] + 1e-6)
    at = [map_coordinates(length, (pixels + shift * across).T[::-1], order=1, mode="nearest") for shift in (-1, 1)]
    bend = at[0] - 2 * length[rows, columns] + at[1]
    offset = np.where(bend < -1e-3, (at[0] - at[1]) / (2 * np.minimum(bend, -1e-3)), 0).clip(-1, 1)
    return np.asarray(pixels + offset[:, None] * across, np.float64)


def _smooth_runs(pixels: Int[ndarray, "n 2"], contours: list[Int[ndarray, "k 2"]]) -> list[slice]:
    """Corner-free stretches of the contours, which are concatenated in ``pixels``."""
    ahead = np.zeros_like(pixels, dtype=np.float64)
    ahead[:-REACH] = pixels[REACH:] - pixels[:-REACH]
    before = np.zeros_like(ahead)
    before[REACH:] = ahead[:-REACH]
    cross, dot = before[:, 0] * ahead[:, 1] - before[:, 1] * ahead[:, 0], (before * ahead).sum(-1)
    corner: Bool[ndarray, "n"] = np.abs(np.arctan2(cross, dot)) > TURN
    ends = np.cumsum([len(contour) for contour in contours])
    for end in (0, *ends):  # where one contour meets the next, turns are meaningless
        corner[max(end - REACH, 0) : end + REACH] = True
    starts = np.flatnonzero(np.diff(np.concatenate([[True], corner, [True]]).astype(np.int8)))
    return [slice(first, last) for first, last in zip(starts[::2], starts[1::2], strict=True) if last - first > POINTS]


def _averaged(points: Float64[ndarray, "n 2"]) -> Float64[ndarray, "points 2"]:
    bounds = np.linspace(0, len(points), POINTS + 1).astype(int)
    return np.asarray(np.add.reduceat(points, bounds[:-1]) / np.diff(bounds)[:, None])
