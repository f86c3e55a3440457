"""Other occurrences of one or a few examples that are marked in photos."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from sextant.chapters.cosfire.detector import Detection, ExampleDetector
from sextant.chapters.cosfire.images import UprightImage, read_image
from sextant.errors import ArgumentError
from sextant.layers.cosfire import GaborBank
from sextant.layers.cosfire.tuples import offsets
from sextant.tools.demonstration.pictures import data_address

#: longest side of the photos that are searched, in pixels; what is found is about 70 of them wide
LONGEST = 480
MOST_EXAMPLES = 3
ROTATIONS, SCALES = 8, (0.7, 1.0, 1.4)
MOST_FOUND = 50
#: least response that is returned; the page shows fewer
LEAST = 0.4
#: opacity of the strongest response
OPAQUE = 217

#: number of the photo, and the point as shares of its width and height
Point = tuple[int, float, float]


def where_else_answer(
    photos: Sequence[Path], points: Sequence[Point], *, turned: bool = False, resized: bool = False
) -> dict[str, Any]:
    """Find spots similar to points in photos, by filters configured there; positions are shares of the photos' sides.

    Args:
        photos: one or two.
        points: points of the examples, at most :data:`MOST_EXAMPLES`.
        turned: find the examples in eight orientations.
        resized: find them at 0.7, 1 and 1.4 times their size.

    Raises:
        UserError: a photo cannot be read, there are no points or too many, or a point has no structure to configure
            a filter from.
    """
    if not 1 <= len(points) <= MOST_EXAMPLES:
        raise ArgumentError(f"points: {len(points)} given", f"Point at 1 to {MOST_EXAMPLES} things.")
    images = [read_image(path, LONGEST) for path in photos]
    detector = ExampleDetector(
        rotations=ROTATIONS if turned else None, scales=SCALES if resized else None, longest=LONGEST
    )
    for number, x, y in points:
        if not (0 <= number < len(images) and 0 <= x <= 1 and 0 <= y <= 1):
            raise ArgumentError(f"points={number},{x:g},{y:g} lies outside the photos", "Point into one of the photos.")
        image = images[number]
        detector.add(image, (x * image.width - 0.5, y * image.height - 0.5))
    return {
        "photos": [_found(detector, image) for image in images],
        "examples": [_parts(detector, i) | {"photo": point[0]} for i, point in enumerate(points)],
        "most": MOST_FOUND,
    }


def _found(detector: ExampleDetector, image: UprightImage) -> dict[str, Any]:
    response, found = detector.find(image, threshold=LEAST, max_detections=MOST_FOUND)
    own = _own(detector, image, found)
    rows = [
        {
            "x": (each.x + 0.5) / image.width,
            "y": (each.y + 0.5) / image.height,
            "score": each.score,
            "own": i in own,
            "example": each.example,
            "turned_deg": round(np.degrees(each.move.rotation_rad)) if each.move else 0,
            "scale": each.move.scale if each.move else 1.0,
        }
        for i, each in enumerate(found)
    ]
    radius = detector.radius / response.shape[1]
    return {
        "response": data_address(glow(response)),
        "found": rows,
        "strongest": float(response.max()),
        "radius": radius,
    }


def _own(detector: ExampleDetector, image: UprightImage, found: Sequence[Detection]) -> set[int]:
    """Numbers of the examples' own detections; one may stand for several, since close ones are merged."""
    own = set()
    for example in detector.examples:
        apart = [math.dist(image.at((each.x, each.y)), example.point) for each in found]
        if example.image is image and min(apart, default=math.inf) <= detector.radius:
            own.add(apart.index(min(apart)))
    return own


def glow(response: Float[ndarray, "y x"]) -> UInt8[ndarray, "y x 4"]:
    """A response as colours to overlay on its image: the stronger the brighter, transparent where there is none."""
    share = np.clip(response, 0, 1)
    colours = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_INFERNO)[..., ::-1]
    return np.dstack([colours, (OPAQUE * np.sqrt(share)).astype(np.uint8)])


def _parts(detector: ExampleDetector, number: int) -> dict[str, Any]:
    """The lines that make up a filter: their centres as shares of the photo's sides, and directions in degrees."""
    example, filters = detector.examples[number], detector.filters
    parts = filters.tuples(number)
    height, width = example.image.picture.shape[:2]
    assert isinstance(filters.bank, GaborBank)
    across, down = (part.double().numpy() for part in offsets(parts.rho, parts.phi))
    along = np.degrees(parts.channels[:, 1].double().numpy()) + 90  # theta is the direction across a line
    return {
        "x": (example.point[0] + 0.5) / width,
        "y": (example.point[1] + 0.5) / height,
        "parts": [
            {"x": x / width, "y": y / height, "direction_deg": round(float(angle) % 180, 1)}
            for x, y, angle in zip(example.point[0] + 0.5 + across, example.point[1] + 0.5 + down, along, strict=True)
        ],
    }
