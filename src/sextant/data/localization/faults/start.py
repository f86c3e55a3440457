"""A wrong initial pose."""

from dataclasses import dataclass

from sextant.data.localization.faults.fault import Fault
from sextant.errors import UserError


@dataclass(frozen=True)
class WrongStart(Fault):
    """The filter starts around a pose that is ``distance`` and ``heading_deg`` away from the true one.

    Drives and map are left unchanged: the code that starts the filter reads these values.

    Attributes:
        distance: in the dataset's unit, in a direction drawn at random.
        heading_deg: to either side.
    """

    distance: float = 5.0
    heading_deg: float = 90.0

    def __post_init__(self) -> None:
        if not self.distance >= 0 or not 0 <= self.heading_deg <= 180:
            raise UserError(
                f"fault.distance={self.distance:g} must not be negative, and fault.heading_deg={self.heading_deg:g} "
                "must be in [0, 180]",
                "fault.distance=5 fault.heading_deg=90",
            )
