r"""Which images show the same place, which show different places, and which pairs should be left out.

For images i and j at :math:`p_i, p_j` with headings :math:`\theta_i, \theta_j`, and tolerances :math:`r_+ < r_-`

.. math::
    \text{positive:}\quad & \|p_i - p_j\| \le r_+ \;\wedge\; |\operatorname{wrap}(\theta_i - \theta_j)| \le a_+ \\
    \text{negative:}\quad & \|p_i - p_j\| \ge r_- \\
    \text{ignored:}\quad & \text{all others, and an image with itself}

The ring between the tolerances is ignored because the views from there partly overlap. For traverses that are aligned
frame by frame, p is the frame number, in one dimension.
"""

from dataclasses import dataclass
from typing import Protocol

import torch
from jaxtyping import Bool, Float, Int, Real
from torch import Tensor


@dataclass(frozen=True)
class Relation:
    """Pairs of the same place and pairs of different places, row by column; a pair in neither is ignored.

    Attributes:
        positive: whether the row's image and the column's show the same place.
        negative: whether they show different places.

    Raises:
        ValueError: they differ in shape, or a pair is in both.

    Example:
        >>> same = torch.tensor([[False, True, False], [True, False, False], [False, False, False]])
        >>> different = torch.tensor([[False, False, True], [False, False, True], [True, True, False]])
        >>> Relation(same, different).usable()  # the third image has no other of its place
        tensor([ True,  True, False])
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


@dataclass(frozen=True)
class Places:
    """Where images were taken. Equal rows are images taken at the same place, not the same image.

    Args:
        position: coordinates in metres, or one column of frame numbers. Give UTM coordinates in float64: a float32
            resolves only half a metre of their northing.
        heading: in degrees, or None where it does not matter.

    Raises:
        ValueError: a position or heading is not finite, or they differ in number.
    """

    position: Real[Tensor, "n k"]
    heading: Real[Tensor, "n"] | None = None

    def __post_init__(self) -> None:
        for name in ("position", "heading"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self.position):
                raise ValueError(f"{len(self.position)} positions but {len(values)} of {name}")
            if values is not None and not bool(values.isfinite().all()):
                raise ValueError(f"the {name} of image {int((~values.isfinite()).nonzero()[0, 0])} is not finite")

    def __len__(self) -> int:
        return len(self.position)


class Tolerance(Protocol):
    """The distances that separate the same place from different places, in the unit of the positions.

    :class:`sextant.chapters.places.data.PlaceTolerance` is one; it also has a unit and refuses invalid values.

    Attributes:
        positive: largest distance within one place.
        negative: smallest distance of two places, above ``positive``.
        heading_deg: largest difference of heading within one place; None ignores headings. Pairs of images taken at one
            spot in different directions are ignored.
    """

    @property
    def positive(self) -> float:
        """See the class."""

    @property
    def negative(self) -> float:
        """See the class."""

    @property
    def heading_deg(self) -> float | None:
        """See the class."""


def relations(
    places: Places,
    tolerance: Tolerance,
    rows: Int[Tensor, "m"] | None = None,
    columns: Int[Tensor, "n"] | None = None,
) -> Relation:
    """Which pairs of images are positives and which negatives; see the module.

    >>> from types import SimpleNamespace
    >>> places = Places(torch.tensor([[0.0], [3.0], [50.0]]))  # metres along a street
    >>> tolerance = SimpleNamespace(positive=5.0, negative=20.0, heading_deg=None)
    >>> relations(places, tolerance).positive
    tensor([[False,  True, False],
            [ True, False, False],
            [False, False, False]])

    Args:
        places: the places of all images.
        tolerance: in the unit of their positions.
        rows, columns: indices of images; all of them by default. The pair of an image with itself is neither.

    Raises:
        ValueError: headings are needed, and the places have none.
    """
    everything = torch.arange(len(places), device=places.position.device)
    rows, columns = (everything if chosen is None else chosen for chosen in (rows, columns))
    apart = distance(places.position[rows], places.position[columns])
    positive, negative = apart <= tolerance.positive, apart >= tolerance.negative
    if tolerance.heading_deg is not None:
        if places.heading is None:
            raise ValueError("heading_deg is set, but the places have no heading")
        positive &= heading_difference(places.heading[rows], places.heading[columns]) <= tolerance.heading_deg
    itself = rows[:, None] == columns
    return Relation(positive & ~itself, negative & ~itself)


def distance(first: Real[Tensor, "m k"], second: Real[Tensor, "n k"]) -> Float[Tensor, "m n"]:
    """Distances in float64, by differences: a matrix product would lose metres among UTM coordinates."""
    difference = first.double()[:, None] - second.double()
    if difference.shape[-1] == 1:
        return difference[..., 0].abs()
    return difference.square().sum(-1).sqrt()


def heading_difference(first: Real[Tensor, "m"], second: Real[Tensor, "n"]) -> Float[Tensor, "m n"]:
    """Absolute difference of headings in degrees, wrapped into [0, 180]."""
    turn = (first.double()[:, None] - second.double()).abs() % 360
    return torch.minimum(turn, 360 - turn)
