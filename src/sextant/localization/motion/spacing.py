"""Odometry noise as a share of the distance between images of a map."""

from sextant.localization.motion.exponential import ExponentialMotion


def motion_of_spacing(spacing: float, line: bool = False) -> ExponentialMotion:
    """Odometry that errs by three tenths over one spacing of a map, and by two spacings where it is missing.

    Wheels err by a tenth or less, but in the same way in each step. Images have to correct step by step what the noise
    does not allow for, and the filter falls behind without knowing it (docs/localization_change.md).

    Args:
        spacing: spacing of the map's images, in the unit of positions, above 0
            (:func:`~sextant.localization.map_support.map_spacing`).
        line: whether positions lie along a line, with no errors across it.

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
