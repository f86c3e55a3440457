"""What may be chosen of the matching of places."""

from dataclasses import dataclass
from typing import Literal

KnownBy = Literal["none", "csv", "utm", "name", "order"]


@dataclass(frozen=True)
class PlaceOptions:
    """What the user chose.

    Attributes:
        matches: of each query, the most similar first.
        sequence: queries in a sequence; None for single photos alone.
        places: how the truth is known, if it is.
        tolerance: largest distance of one place, in metres or files; None for that of the run's test.
        descriptors: keep the descriptors.
    """

    matches: int = 5
    sequence: int | None = None
    places: KnownBy = "none"
    tolerance: float | None = None
    descriptors: bool = False
