"""Shape and classes of the images that a model was trained on. Light to import."""

from collections.abc import Mapping
from typing import Any

from sextant.data.source import ImageSpec


def image_spec(spec: Mapping[str, Any]) -> ImageSpec:
    """Shape and classes of the images that a model was trained on, from the spec in its checkpoint."""
    return ImageSpec(spec["channels"], spec["height"], spec["width"], tuple(spec["classes"]))
