"""Noise of odometry as a share of how far the images of a map are apart."""

from sextant.localization.motion.exponential import ExponentialMotion


def motion_of_spacing(spacing: float, line: bool = False) -> ExponentialMotion:
    """Odometry that errs by three tenths over the spacing of a map, and by two such steps where it is missing.

    Wheels err by a tenth or less, but alike in each step. What the noise does not allow for, images have to pull back
    step by step, and the filter falls behind without knowing it (docs/localization_change.md).

    Args:
        spacing: of the map's images, in the unit of positions, above 0:
            :func:`~sextant.localization.map_support.map_spacing`.
        line: positions are those along a line, and nothing errs across it.

    >>> motion_of_spacing(2.0).unknown
    (4.0, 0.4, 0.1)
    >>> motion_of_spacing(2.0, line=True).unknown
    (4.0, 0.0, 0.0)
    """
    aside = 0.0 if line else 1.0
    return ExponentialMotion(
        per_step=(0.01 * spacing, aside * 0.01 * spacing, aside * 0.005),
        per_metre=(0.09 * spacing, aside * 0.001 * spacing, aside * 0.002 / max(1.0, spacing)),
        per_radian=(0.0, aside * 0.001 * spacing**2, aside * 0.002),
        unknown=(2 * spacing, aside * 0.2 * spacing, aside * 0.1),
    )
