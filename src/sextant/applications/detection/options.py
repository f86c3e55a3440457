"""What may be chosen of detection from one example."""

from dataclasses import dataclass

#: of ours for photos, then those of :data:`sextant.layers.cosfire.PRESETS` that detect (those of vessels delineate)
PHOTO = "photo"
PRESET_NAMES = (PHOTO, "bifurcation", "symbol", "digit", "traffic_sign")


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
    max_detections: int = 100
    longest: int = 800
