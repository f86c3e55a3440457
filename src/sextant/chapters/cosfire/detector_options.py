"""Options of detection from an example; imports nothing heavy."""

from typing import Literal, get_args

from sextant.errors import ArgumentError, shown
from sextant.ranges import fits

#: our own for photos, then those of :data:`sextant.layers.cosfire.PRESETS` that detect (those of vessels delineate)
Preset = Literal["photo", "bifurcation", "symbol", "digit", "traffic_sign"]
PRESET_NAMES: tuple[Preset, ...] = get_args(Preset)
PHOTO: Preset = "photo"
#: longest side in pixels that larger images, including examples, are shrunk to; most detections per image, by strength
LONGEST, MAX_DETECTIONS = 800, 100


def check_point(point: tuple[float, float], size: tuple[int, int]) -> None:
    """Raise an ``ArgumentError`` if a point is not two numbers, or outside an image of this width and height."""
    if not fits(tuple[float, float], point):
        raise ArgumentError(f"point={shown(point)} must be two finite numbers, x and y", "For example point=(310, 190)")
    (x, y), (width, height) = point, size
    if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
        raise ArgumentError(
            f"point={x:g},{y:g} lies outside the prototype of {width}x{height} pixels",
            f"Choose x from 0 to {width - 1} and y from 0 to {height - 1}.",
        )
