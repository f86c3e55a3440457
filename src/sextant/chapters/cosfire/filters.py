"""Filters that are not configured yet, for the options that the user chose."""

from collections.abc import Sequence
from dataclasses import replace

from torch import nn

from sextant.chapters.cosfire.detector_options import PHOTO, PRESET_NAMES
from sextant.errors import ArgumentError
from sextant.layers.cosfire import (
    Blur,
    ConcentricCircles,
    Cosfire,
    GaborBank,
    Tolerance,
    VectorBank,
    VectorKeypoints,
    preset,
)

#: least contribution of a network's vector, as a cosine: a missing one does not silence a filter
FLOOR = 0.05
#: distance in pixels from the centre of a filter for photos to its outermost parts
REACH = 32.0


def preset_filter(name: str, reach: float = REACH) -> Cosfire:
    """A filter on Gabor filters or differences of Gaussians; ``reach`` only applies to ``photo``.

    Raises:
        ArgumentError: there is no such preset.
    """
    if name not in PRESET_NAMES:
        raise ArgumentError(f"preset={name} must be one of {', '.join(PRESET_NAMES)}", f"preset={PHOTO}")
    return photo_filter(reach) if name == PHOTO else preset(name)


def photo_filter(reach: float = REACH) -> Cosfire:
    """Edges on circles of up to ``reach`` pixels, with a wavelength of a quarter of that, for objects twice as large.

    Raises:
        ArgumentError: the reach is less than 8 pixels, where no edge has a direction.
    """
    if not 8 <= reach < 1e4:
        raise ArgumentError(f"reach={reach:g} must be at least 8 pixels", "reach=32")
    return Cosfire(
        GaborBank(wavelengths=(reach / 4,), orientations=16, phase_deg=90.0),
        ConcentricCircles(radii=(0, reach / 4, reach / 2, 3 * reach / 4, reach), t2=0.75),
        blur=Blur(reach / 16, 0.1),
        t1=0.1,
    )


def network_filter(features: nn.Module, size: int) -> Cosfire:
    """A filter on the directions of feature vectors.

    Args:
        features: maps images to ``(b, size, y, x)``.
        size: length of a feature vector.
    """
    return Cosfire(VectorBank(features, size), VectorKeypoints(), blur=Blur(0.67, 0.1), floor=FLOOR)


def tolerant(
    filters: Cosfire, rotations: int | None, scales: Sequence[float] | None, reflection: bool | None
) -> Cosfire:
    """The filter with the tolerances that the user chose, otherwise its own; the example itself is always included."""
    own: Tolerance = filters.tolerance
    filters.tolerance = replace(
        own,
        rotations=own.rotations if rotations is None else rotations,
        span_deg=own.span_deg if rotations is None else 360.0,
        scales=own.scales if scales is None else tuple(dict.fromkeys((1.0, *scales))),
        reflection=own.reflection if reflection is None else reflection,
    )
    filters.t3 = 0.0  # relative to the image's strongest response and so to its other content; threshold= replaces it
    return filters
