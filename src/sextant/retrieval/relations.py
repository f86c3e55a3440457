r"""Which images show the same place, which another, and which pairs had better be left out.

For images i and j at :math:`p_i, p_j`, looking towards :math:`\theta_i, \theta_j`, with tolerances :math:`r_+ \le r_-`

.. math::
    \text{positive:}\quad & \|p_i - p_j\| \le r_+ \;\wedge\; |\operatorname{wrap}(\theta_i - \theta_j)| \le a_+ \\
    \text{negative:}\quad & \|p_i - p_j\| > r_- \\
    \text{ignored:}\quad & \text{all others, and an image with itself}

The ring between the tolerances is ignored because what is seen from there is partly the same. On rides that are aligned
frame by frame, p is the frame number, a space of one dimension. Images of different areas, such as two towns that
each have their own origin, are negatives wherever they lie.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int, Real
from torch import Tensor


@dataclass(frozen=True)
class Relation:
    """Pairs of one place and pairs of two, row by column; what is in neither is ignored.

    Attributes:
        positive: the row's image and the column's show one place.
        negative: they show two.

    Raises:
        ValueError: they differ in shape, or a pair is in both.
    """

    positive: Bool[Tensor, "m n"]
    negative: Bool[Tensor, "m n"]

    def __post_init__(self) -> None:
        if self.positive.shape != self.negative.shape:
            raise ValueError(f"{tuple(self.positive.shape)} positives but {tuple(self.negative.shape)} negatives")
        if (self.positive & self.negative).any():
            raise ValueError("a pair is positive and negative at once")

    def usable(self) -> Bool[Tensor, "m"]:
        """Whether a row has at least one positive and one negative."""
        return self.positive.any(1) & self.negative.any(1)

    def to(self, device: torch.device | str) -> "Relation":
        """The relation on another device."""
        return Relation(self.positive.to(device), self.negative.to(device))


@dataclass(frozen=True)
class Places:
    """Where images were taken. Equal rows are images of equal places, not the same image.

    Args:
        position: coordinates in metres, or one column of frame numbers. Give UTM coordinates in float64: a float32
            resolves only half a metre of their northing.
        heading: in degrees, or None where it does not matter.
        condition: index of the weather, season or light, or None.
        area: index of the coordinate frame, such as the town, or None where all share one.

    Raises:
        ValueError: a position or heading is not finite, or they differ in number.
    """

    position: Real[Tensor, "n k"]
    heading: Real[Tensor, "n"] | None = None
    condition: Int[Tensor, "n"] | None = None
    area: Int[Tensor, "n"] | None = None

    def __post_init__(self) -> None:
        for name in ("position", "heading", "condition", "area"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self.position):
                raise ValueError(f"{len(self.position)} positions but {len(values)} of {name}")
            if values is not None and not bool(values.isfinite().all()):
                raise ValueError(f"the {name} of image {int((~values.isfinite()).nonzero()[0, 0])} is not finite")

    @classmethod
    def by_frame(
        cls, frame: Real[Tensor, "n"], condition: Int[Tensor, "n"] | None = None, area: Int[Tensor, "n"] | None = None
    ) -> "Places":
        """Places along an aligned ride, known by their frame number alone."""
        return cls(frame[:, None], None, condition, area)

    def __len__(self) -> int:
        return len(self.position)


@dataclass(frozen=True)
class Tolerance:
    """How far apart one place ends and another begins, in metres or frames: the unit of the positions.

    Args:
        positive: largest distance within one place, at least 0.
        negative: distance beyond which it is another place, at least ``positive``.
        heading_deg: largest difference of heading within one place; None does not look at it. Images of one spot that
            look apart are ignored, unless ``apart_deg`` makes them negatives.
        apart_deg: difference of heading beyond which two images show different places even from one spot; None: never.
        across_conditions: only images under another condition are positives; those under the same one are ignored.

    Raises:
        ValueError: a tolerance is negative or not finite, or what must be the larger is the smaller.
    """

    positive: float
    negative: float
    heading_deg: float | None = None
    apart_deg: float | None = None
    across_conditions: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.positive <= self.negative < float("inf"):
            raise ValueError(f"need 0 <= positive <= negative, got {self.positive} and {self.negative}")
        if self.heading_deg is not None and not self.heading_deg >= 0:
            raise ValueError(f"heading_deg must be at least 0, got {self.heading_deg}")
        if self.apart_deg is not None and (self.heading_deg is None or not self.apart_deg >= self.heading_deg):
            raise ValueError(f"apart_deg={self.apart_deg} must be at least heading_deg={self.heading_deg}")


def relations(
    places: Places,
    tolerance: Tolerance,
    rows: Int[Tensor, "m"] | None = None,
    columns: Int[Tensor, "n"] | None = None,
) -> Relation:
    """Which pairs of images are positives and which negatives; see the module.

    Args:
        places: of all images.
        tolerance: in the unit of their positions.
        rows, columns: indices of images; all of them by default. The pair of an image with itself is neither.

    Raises:
        ValueError: the tolerance needs headings or conditions, and the places have none.
    """
    everything = torch.arange(len(places), device=places.position.device)
    rows, columns = (everything if chosen is None else chosen for chosen in (rows, columns))
    apart = distance(places.position[rows], places.position[columns])
    positive, negative = apart <= tolerance.positive, apart > tolerance.negative
    if tolerance.heading_deg is not None:
        if places.heading is None:
            raise ValueError("heading_deg is set, but the places have no heading")
        turn = heading_difference(places.heading[rows], places.heading[columns])
        positive &= turn <= tolerance.heading_deg
        if tolerance.apart_deg is not None:
            negative |= turn > tolerance.apart_deg
    if tolerance.across_conditions:
        if places.condition is None:
            raise ValueError("across_conditions is set, but the places have no condition")
        positive &= places.condition[rows][:, None] != places.condition[columns]
    if places.area is not None:
        elsewhere = places.area[rows][:, None] != places.area[columns]
        positive, negative = positive & ~elsewhere, negative | elsewhere
    itself = rows[:, None] == columns
    return Relation(positive & ~itself, negative & ~itself)


def distance(first: Real[Tensor, "m k"], second: Real[Tensor, "n k"]) -> Float[Tensor, "m n"]:
    """Distances in float64, by differences: a matrix product would lose metres among coordinates of UTM."""
    difference = first.double()[:, None] - second.double()
    if difference.shape[-1] == 1:
        return difference[..., 0].abs()
    return difference.square().sum(-1).sqrt()


def heading_difference(first: Real[Tensor, "m"], second: Real[Tensor, "n"]) -> Float[Tensor, "m n"]:
    """Size of the difference of headings in degrees, wrapped into [0, 180]."""
    turn = (first.double()[:, None] - second.double()).abs() % 360
    return torch.minimum(turn, 360 - turn)
