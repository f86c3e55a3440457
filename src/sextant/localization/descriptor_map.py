"""A map: images, represented by their descriptors, at known poses."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float32, Float64
from torch import Tensor

from sextant.errors import UserError
from sextant.geometry.planar import wrap_angle
from sextant.shapes import check_shape
from sextant.tables import counted

#: Descriptor rows processed together, so that a mapped file larger than memory is read in pieces.
BLOCK = 16_384
NAMED = 5


@dataclass(frozen=True)
class DescriptorMap:
    """The images of a map at n poses, in no particular order.

    Attributes:
        poses: x, y in metres and heading in rad; all rows differ when made by :meth:`of`.
        descriptors: descriptors of the images taken there; may be a view of a mapped file.
        mean: the mean descriptor, to which a Gaussian process falls back far from the map.

    Example:
        >>> poses = torch.tensor([[0.0, 0, 0], [0, 0, 0], [5, 0, 0]], dtype=torch.float64)
        >>> places = DescriptorMap.of(poses, torch.tensor([[1.0], [3.0], [8.0]]), merge_duplicates=True)
        >>> len(places), places.descriptors.flatten().tolist(), places.mean.tolist()  # the first two are one place
        (2, [2.0, 8.0], [5.0])
    """

    poses: Float64[Tensor, "n 3"]
    descriptors: Float32[Tensor, "n d"]
    mean: Float32[Tensor, " d"]

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def dimension(self) -> int:
        """The number of values in a descriptor."""
        return int(self.descriptors.shape[1])

    @classmethod
    def of(
        cls, poses: Float64[Tensor, "n 3"], descriptors: Float32[Tensor, "m d"], *, merge_duplicates: bool = False
    ) -> Self:
        """Make a map of images at known poses, after checking them.

        Args:
            poses: poses of the images.
            descriptors: descriptors of the same images in the same order; not copied if they are float32.
            merge_duplicates: merge images at exactly the same pose into one with their mean descriptor, in the place of
                the first of them.

        Raises:
            UserError: poses or descriptors are not rows, their numbers differ, there is no image, a pose or descriptor
                is not finite, or two poses are equal and ``merge_duplicates`` is false.
        """
        poses, descriptors = poses.double(), descriptors.float()  # the types of the files of a map
        check_pairs(poses, descriptors)
        if len(poses) == 0 or descriptors.shape[1] == 0:
            raise UserError("the map is empty: it has no image with a descriptor", "Provide images with known poses.")
        check_finite(poses)
        broken = torch.cat([~torch.isfinite(rows).all(dim=1) for rows in descriptors.split(BLOCK)])
        _refuse(
            broken,
            "descriptor that is not finite",
            "descriptors that are not finite",
            "Leave these images out, or describe them again.",
        )
        first = _first_of_equals(poses)
        repeated = first != torch.arange(len(poses))
        if merge_duplicates and bool(repeated.any()):
            poses, descriptors = _merged(poses, descriptors, first)
        else:
            _refuse(
                repeated,
                "pose equal to that of an earlier image (same x, y and heading)",
                "poses equal to that of an earlier image (same x, y and heading)",
                "Leave these images out, or keep one with their mean descriptor: merge_duplicates=true",
            )
        return cls(poses, descriptors, mean_of_blocks(descriptors.split(BLOCK)))


def check_pairs(poses: Tensor, descriptors: Tensor) -> None:
    """Raise a ``UserError`` unless there is one pose of x, y and heading for each descriptor.

    >>> check_pairs(torch.zeros(2, 3), torch.zeros(2, 64))
    """
    check_shape("poses", poses, "n", 3)
    check_shape("descriptors", descriptors, "n", "d")
    if len(poses) != len(descriptors):
        raise UserError(
            f"the map has {counted(len(poses), 'pose')} and {counted(len(descriptors), 'descriptor')}",
            "Give one pose for each image, in the same order.",
        )


def check_finite(poses: Tensor) -> None:
    """Raise a ``UserError`` that names the poses of a map that are not finite.

    >>> check_finite(torch.zeros(2, 3))
    """
    finite = torch.isfinite(poses).all(dim=1)
    _refuse(~finite, "pose that is not finite", "poses that are not finite", "Leave these images out.")


def _refuse(wrong: Tensor, one: str, several: str, fix: str) -> None:
    rows = wrong.nonzero().flatten().tolist()
    if rows:
        named = ", ".join(map(str, rows[:NAMED])) + (", ..." if len(rows) > NAMED else "")
        where = "row" if len(rows) == 1 else "rows"
        raise UserError(f"the map has {counted(len(rows), one, several)}: {where} {named}, counted from 0", fix)


def _first_of_equals(poses: Tensor) -> Tensor:
    """For every row, the first row with the same pose; headings a full turn apart are the same."""
    wrapped = torch.cat([poses[:, :2], wrap_angle(poses[:, 2:])], dim=1)
    _, group = torch.unique(wrapped + 0.0, dim=0, return_inverse=True)  # -0 + 0 is 0: both are one place
    rows = torch.arange(len(poses))
    first = torch.full((len(poses),), len(poses)).scatter_reduce(0, group, rows, "amin")
    return first[group]


def _merged(poses: Tensor, descriptors: Tensor, first: Tensor) -> tuple[Tensor, Tensor]:
    kept, group = torch.unique(first, return_inverse=True)
    total = torch.zeros(len(kept), descriptors.shape[1], dtype=torch.float64)
    total.index_add_(0, group, descriptors.double())
    return poses[kept], (total / torch.bincount(group)[:, None]).float()


def mean_of_blocks(blocks: Iterable[Float32[Tensor, "_ d"]]) -> Float32[Tensor, " d"]:
    """The mean of all rows; it does not depend on how they are stored if they come in blocks of ``BLOCK`` rows.

    Raises:
        ValueError: there is no block.

    Example:
        >>> rows = torch.tensor([[1.0, 0.0], [2.0, 0.0], [6.0, 3.0]])
        >>> mean_of_blocks(rows.split(2))  # of all rows, not of the blocks' means
        tensor([3., 1.])
    """
    total, count = torch.zeros((), dtype=torch.float64), 0
    for rows in blocks:
        total, count = total + rows.sum(dim=0, dtype=torch.float64), count + len(rows)
    if not count:
        raise ValueError("there are no rows to average")
    return (total / count).float()
