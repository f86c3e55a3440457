"""What a user may choose of detection from one example; imports nothing but the standard library."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from sextant.applications.detection.options import LONGEST, MAX_DETECTIONS, PHOTO, PRESET_NAMES
from sextant.errors import UserError

KEYS = {
    "prototype": "the image that a filter is configured from",
    "point": "x,y in pixels of the upright prototype: what is there is looked for; its middle unless given",
    "preset": f"constants of the filter: {PHOTO} (edges; default), {', '.join(PRESET_NAMES[1:])}",
    "layer": "with run=: the layer of its network whose features the filter looks at, instead of a preset's",
    "rotations": "how many rotations of the example are found too, evenly over the circle; the preset's, or 1",
    "scales": "sizes of the example that are found too, such as 0.7,1,1.4; the preset's, or 1",
    "reflection": "true: mirror images of the example are found too",
    "threshold": "least score of a detection: a share of what the filter answers to its own prototype; 0.7 unless "
    "given, with run= 0.8",
    "min_distance": "pixels of an image within which two detections are one; the filter's radius unless given",
    "max_detections": "of an image, the strongest; 100 unless given",
    "longest": "pixels of the longest side that larger images, the prototype too, are shrunk to; 800 unless given",
}
MOST_ROTATIONS, SMALLEST_LONGEST = 360, 16


@dataclass(frozen=True)
class DetectionOptions:
    """What the user chose; None leaves a choice to the filter.

    Attributes:
        point: x and y in pixels of the upright prototype; None is its middle.
        preset: constants of the filter, one of :data:`PRESET_NAMES`.
        layer: of a network whose features the filter looks at.
        rotations: of the example that are found too, evenly over the circle.
        scales: sizes of the example that are found too.
        reflection: mirror images of the example are found too.
        threshold: least score of a detection, a share of what the filter answers to its own prototype.
        min_distance: pixels of an image within which two detections are one.
        max_detections: of an image, the strongest.
        longest: pixels of the longest side that larger images, the prototype too, are shrunk to.
    """

    point: tuple[float, float] | None = None
    preset: str | None = None
    layer: str | None = None
    rotations: int | None = None
    scales: tuple[float, ...] | None = None
    reflection: bool | None = None
    threshold: float | None = None
    min_distance: float | None = None
    max_detections: int = MAX_DETECTIONS
    longest: int = LONGEST


def options_from(given: Mapping[str, str]) -> DetectionOptions:
    """Read the keys of :data:`KEYS` but ``prototype``.

    Raises:
        UserError: a value is not one of those allowed, or two keys exclude each other.
    """
    if given.get("preset", PHOTO) not in PRESET_NAMES:
        raise UserError(f"preset={given['preset']} must be one of {', '.join(PRESET_NAMES)}", f"preset={PHOTO}")
    if "preset" in given and "run" in given:
        raise UserError(
            "preset= and run= do not go together: the filter looks through a preset's filters or through a network",
            "Leave one of them out.",
        )
    if "layer" in given and "run" not in given:
        raise UserError("layer= is of a network: run= is missing", "run=<run of classification or place_recognition>")
    if given.get("reflection", "true") not in ("true", "false"):
        raise UserError(f"reflection={given['reflection']} must be true or false", "reflection=true")
    point, scales = _numbers(given, "point", "120,80"), _numbers(given, "scales", "0.7,1,1.4")
    if point is not None and len(point) != 2:
        raise UserError(f"point={given['point']} must be two numbers, x,y in pixels", "For example point=120,80")
    if scales is not None and min(scales) <= 0:
        raise UserError(f"scales={given['scales']} must be above 0", "For example scales=0.7,1,1.4")
    return DetectionOptions(
        point=None if point is None else (point[0], point[1]),
        preset=given.get("preset"),
        layer=given.get("layer"),
        rotations=_whole(given, "rotations", 1, MOST_ROTATIONS),
        scales=scales,
        reflection=None if "reflection" not in given else given["reflection"] == "true",
        threshold=_above_zero(given, "threshold", "0.7"),
        min_distance=_above_zero(given, "min_distance", "20"),
        max_detections=_whole(given, "max_detections", 1) or DetectionOptions.max_detections,
        longest=_whole(given, "longest", SMALLEST_LONGEST) or DetectionOptions.longest,
    )


def _numbers(given: Mapping[str, str], key: str, example: str) -> tuple[float, ...] | None:
    if key not in given:
        return None
    try:
        values = tuple(float(text) for text in given[key].strip("()[]").split(","))
    except ValueError:
        values = (math.nan,)
    if not all(map(math.isfinite, values)):
        raise UserError(f"{key}={given[key]} must be numbers separated by commas", f"For example {key}={example}")
    return values


def _above_zero(given: Mapping[str, str], key: str, example: str) -> float | None:
    values = _numbers(given, key, example)
    if values is None:
        return None
    if len(values) != 1 or values[0] <= 0:
        raise UserError(f"{key}={given[key]} must be a number above 0", f"For example {key}={example}")
    return values[0]


def _whole(given: Mapping[str, str], key: str, least: int, most: int | None = None) -> int | None:
    if key not in given:
        return None
    text = given[key]
    if not (text.isascii() and text.isdigit() and least <= int(text) <= (most or math.inf)):
        span = f"from {least} up" if most is None else f"from {least} to {most}"
        raise UserError(f"{key}={text} must be a whole number {span}", f"For example {key}={max(least, 8)}")
    return int(text)
