"""Filters that are not configured yet, by what the user chose."""

from dataclasses import replace

from torch import nn

from sextant.applications.detection.options import PHOTO, DetectionOptions
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

#: least score, with filters made by hand and with features of a network: cosines are seldom small
THRESHOLD, NETWORK_THRESHOLD = 0.7, 0.8
#: the least that a vector of a network counts, as a cosine: one that is missing does not silence a filter
FLOOR = 0.05


def preset_filter(options: DetectionOptions) -> Cosfire:
    """A filter over Gabor filters or differences of Gaussians."""
    name = options.preset or PHOTO
    return _tolerant(photo_filter() if name == PHOTO else preset(name), options)


def photo_filter() -> Cosfire:
    """Edges of eight pixels' wavelength on circles of up to 32: for things of some 70 pixels in photos."""
    return Cosfire(
        GaborBank(wavelengths=(8.0,), orientations=16, phase_deg=90.0),
        ConcentricCircles(radii=(0, 8, 16, 24, 32), t2=0.75),
        blur=Blur(2.0, 0.1),
        t1=0.1,
    )


def network_filter(features: nn.Module, size: int, options: DetectionOptions) -> Cosfire:
    """A filter over the directions of feature vectors.

    Args:
        features: maps images to ``(b, size, y, x)``.
        size: numbers of a feature vector.
        options: chosen by the user.
    """
    filters = Cosfire(VectorBank(features, size), VectorKeypoints(), blur=Blur(0.67, 0.1), floor=FLOOR)
    return _tolerant(filters, options)


def _tolerant(filters: Cosfire, options: DetectionOptions) -> Cosfire:
    """With the moves that the user chose, those of the preset where nothing was; the example itself is among them."""
    own: Tolerance = filters.tolerance
    scales = own.scales if options.scales is None else tuple(dict.fromkeys((1.0, *options.scales)))
    filters.tolerance = replace(
        own,
        rotations=own.rotations if options.rotations is None else options.rotations,
        span_deg=own.span_deg if options.rotations is None else 360.0,
        scales=scales,
        reflection=own.reflection if options.reflection is None else options.reflection,
    )
    filters.t3 = 0.0  # of the image's own strongest: what is found then hangs on what else there is. threshold= does it
    return filters
