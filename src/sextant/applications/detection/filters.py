"""Filters that are not configured yet, by what the user chose."""

from collections.abc import Sequence
from dataclasses import replace

from torch import nn

from sextant.applications.detection.options import PHOTO, PRESET_NAMES
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

#: the least that a vector of a network counts, as a cosine: one that is missing does not silence a filter
FLOOR = 0.05
#: pixels from the centre of a filter for photos to its outermost parts
REACH = 32.0


def preset_filter(name: str, reach: float = REACH) -> Cosfire:
    """A filter over Gabor filters or differences of Gaussians; ``reach`` is that of ``photo``.

    Raises:
        ArgumentError: there is no such preset.
    """
    if name not in PRESET_NAMES:
        raise ArgumentError(f"preset={name} must be one of {', '.join(PRESET_NAMES)}", f"preset={PHOTO}")
    return photo_filter(reach) if name == PHOTO else preset(name)


def photo_filter(reach: float = REACH) -> Cosfire:
    """Edges on circles of up to ``reach`` pixels, of a quarter of that for a wavelength: for things twice as large.

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
    """A filter over the directions of feature vectors.

    Args:
        features: maps images to ``(b, size, y, x)``.
        size: numbers of a feature vector.
    """
    return Cosfire(VectorBank(features, size), VectorKeypoints(), blur=Blur(0.67, 0.1), floor=FLOOR)


def tolerant(
    filters: Cosfire, rotations: int | None, scales: Sequence[float] | None, reflection: bool | None
) -> Cosfire:
    """With the moves that the user chose, those of the filter where nothing was; the example itself is among them.

    Raises:
        ArgumentError: no rotation, or a scale that is not above 0.
    """
    own: Tolerance = filters.tolerance
    try:
        filters.tolerance = replace(
            own,
            rotations=own.rotations if rotations is None else rotations,
            span_deg=own.span_deg if rotations is None else 360.0,
            scales=own.scales if scales is None else tuple(dict.fromkeys((1.0, *scales))),
            reflection=own.reflection if reflection is None else reflection,
        )
    except ValueError as error:
        raise ArgumentError(str(error), "For example rotations=8, scales=(0.7, 1, 1.4)") from None
    filters.t3 = 0.0  # of the image's own strongest: what is found then hangs on what else there is. threshold= does it
    return filters
