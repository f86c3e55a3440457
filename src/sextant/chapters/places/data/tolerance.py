"""Criteria by which two images count as the same place or as different places."""

from dataclasses import dataclass
from typing import Literal, get_args

from sextant.errors import UserError

Unit = Literal["m", "frames"]
UNITS: tuple[Unit, ...] = get_args(Unit)


@dataclass(frozen=True)
class PlaceTolerance:
    r"""Which pairs of images are positives, negatives, or neither.

    With the distance :math:`d` of two images, in metres or in frames along aligned traverses, and the angle α between
    their headings: a pair is *positive* if :math:`d \le` ``positive`` and :math:`\alpha \le` ``heading_deg``,
    *negative* if :math:`d \ge` ``negative``, and otherwise *ignored*: pairs in the ring between the two, and near pairs
    with different headings.

    Args:
        unit: ``m`` or ``frames``.
        positive: largest distance between images of the same place.
        negative: smallest distance between images of different places, above ``positive``.
        heading_deg: largest angle between headings at the same place, in (0, 180]; None ignores headings.

    Raises:
        UserError: an argument is invalid.
    """

    unit: Unit
    positive: float
    negative: float
    heading_deg: float | None = None

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise UserError(f"tolerance.unit={self.unit!r} must be one of {', '.join(UNITS)}", "tolerance.unit=m")
        if not 0 <= self.positive < self.negative < float("inf"):
            raise UserError(
                f"tolerance.positive={self.positive:g}, tolerance.negative={self.negative:g}: positive must be at "
                "least 0, and negative above it",
                "For example 5 and 25 metres, or 1 and 10 frames.",
            )
        if self.heading_deg is not None and not 0 < self.heading_deg <= 180:
            raise UserError(
                f"tolerance.heading_deg={self.heading_deg:g} must be above 0 and at most 180",
                "tolerance.heading_deg=null ignores headings.",
            )

    @property
    def name(self) -> str:
        """The positive tolerance for names of metrics: ``pm1f``, ``5m``, ``5m_30deg``."""
        distance = f"pm{self.positive:g}f" if self.unit == "frames" else f"{self.positive:g}m"
        return distance if self.heading_deg is None else f"{distance}_{self.heading_deg:g}deg"
