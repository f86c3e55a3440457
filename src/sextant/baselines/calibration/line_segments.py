"""Straight segments of an image, by OpenCV's line segment detector.

Source: R. Grompone von Gioi, J. Jakubowicz, J.-M. Morel, G. Randall, "LSD: a line segment detector", IPOL 2012. OpenCV
lacked it in 3.4.6 to 3.4.15 and 4.1.0 to 4.5.3.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float64, UInt8
from numpy import ndarray

from sextant.baselines.calibration.estimate import check_image

#: The detector shrinks by this before computing gradients; its pixel centres are ``0.5 / LSD_SCALE`` too small.
LSD_SCALE = 0.8
#: Range of the shorter side, in pixels, to which images are resized: smaller loses segments, larger takes longer.
SMALLEST, LARGEST = 256, 512
#: Length, in image heights, from which a segment counts as long.
LONG = 0.1
#: Margin, in image heights, for black columns, scan borders and other frames that the lens did not distort.
FRAME = 0.012
#: Shorter segments, in image heights, do not determine directions.
SHORTEST = 0.03


def detect_segments(image: UInt8[ndarray, "h w 3"], shortest: float = SHORTEST) -> Float64[ndarray, "n 2 2"]:
    """Segments by their two ends ``(u, v)`` in image heights from the centre, longest first, with subpixel accuracy.

    Args:
        image: RGB.
        shortest: segments below this length, in image heights, are dropped.

    Raises:
        ValueError: it is not a uint8 RGB image.

    Example:
        >>> image = np.zeros((256, 256, 3), np.uint8)
        >>> image[:, 64:192] = 255  # a band whose edges are a quarter of the height off the centre
        >>> segments = detect_segments(image)
        >>> segments.shape, sorted(segments[..., 0].mean(axis=1).round(2).tolist())
        ((2, 2, 2), [-0.25, 0.25])
    """
    grey = working_grey(image)
    segments = heights_from_working(grey_segments(grey), grey, image)
    edge = np.array([image.shape[1] / image.shape[0], 1.0]) / 2
    return longest_first(segments[~on_frame(segments, edge)], shortest)


def on_frame(segments: Float64[ndarray, "n 2 2"], edge: Float64[ndarray, "2"]) -> Bool[ndarray, "n"]:
    """Which segments run along the border of an image; ``edge``: half of its sides in image heights."""
    near = segments[:, :, None] * np.array([[-1.0], [1.0]]) > edge - FRAME  # (n, end, sign, axis)
    return np.asarray(near.all(axis=1).any(axis=(1, 2)))


def grey_segments(grey: UInt8[ndarray, "h w"]) -> Float64[ndarray, "n 2 2"]:
    """Segments of a grey image by their two ends in pixels, whose centres are at + 0.5, in no particular order."""
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_NONE, scale=LSD_SCALE).detect(grey)[0]
    return np.zeros((0, 2, 2)) if found is None else found.reshape(-1, 2, 2).astype(np.float64) + 0.5 / LSD_SCALE


def longest_first(segments: Float64[ndarray, "n 2 2"], shortest: float = SHORTEST) -> Float64[ndarray, "m 2 2"]:
    """Segments in the order of their length, without those below ``shortest``."""
    lengths = segment_lengths(segments)
    order = np.argsort(-lengths, kind="stable")
    return np.asarray(segments[order[lengths[order] >= shortest]])


def segment_lengths(segments: Float64[ndarray, "n 2 2"]) -> Float64[ndarray, "n"]:
    """Lengths of segments, in their unit."""
    return np.asarray(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=-1))


def count_long(segments: Float64[ndarray, "n 2 2"]) -> int:
    """Number of segments longer than a tenth of the image height, a measure of an image's line evidence.

    Example:
        >>> count_long(np.array([[[0.0, 0.0], [0.3, 0.4]], [[0.0, 0.0], [0.0, 0.05]]]))  # lengths of 0.5 and 0.05
        1
    """
    return int((segment_lengths(segments) > LONG).sum())


def heights_from_working(
    points: Float64[ndarray, "*n 2"], grey: UInt8[ndarray, "h2 w2"], image: UInt8[ndarray, "h w 3"]
) -> Float64[ndarray, "*n 2"]:
    """Convert pixels of ``grey``, the resized ``image``, to image heights from the centre of ``image``."""
    aspect = image.shape[1] / image.shape[0]
    return np.asarray((points / np.array([grey.shape[1], grey.shape[0]]) - 0.5) * np.array([aspect, 1.0]))


def working_grey(image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h2 w2"]:
    """The image in grey, its shorter side between :data:`SMALLEST` and :data:`LARGEST` pixels.

    Raises:
        ValueError: it is not a uint8 RGB image.
    """
    check_image(image)
    grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
    side = min(grey.shape)
    scale = max(SMALLEST / side, 1.0) if side < LARGEST else LARGEST / side
    # limits the size of very elongated images
    scale = min(scale, 8 * LARGEST / max(grey.shape))
    if scale != 1:
        size = max(round(grey.shape[1] * scale), 1), max(round(grey.shape[0] * scale), 1)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    return np.asarray(grey)
