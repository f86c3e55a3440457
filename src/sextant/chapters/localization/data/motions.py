"""Motions between the frames of a drive: increments of SE(2) in the frame of the robot, as NumPy arrays.

Row ``i`` of the motions of a drive is ``b_from_c`` with b the pose of frame ``i - 1`` and c that of frame ``i``, so
that ``pose[i] = pose[i-1] ∘ motion[i]``; row 0 is zero. A row of nan is a motion that was not measured.
"""

import numpy as np
import torch
from jaxtyping import Float64, Int64
from numpy import ndarray

from sextant.geometry.planar import se2_between, se2_compose


def between(a: Float64[ndarray, "n 3"], b: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
    """``A⁻¹ B`` of poses: the pose of b relative to a."""
    return _numpy(se2_between(_torch(a), _torch(b)))


def compose(a: Float64[ndarray, "n 3"], b: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
    """``A B``: the motion a followed by the motion b."""
    return _numpy(se2_compose(_torch(a), _torch(b)))


def motions_along(poses: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
    """The motions between consecutive poses, as ``Localizer.step`` takes them; the first is zero.

    Args:
        poses: x and y in metres and headings in rad, counter-clockwise, in any frame of reference.

    Example:
        >>> motions_along(np.array([[0, 0, 0], [2, 0, np.pi / 2], [2, 1, np.pi / 2]])).round(2)
        array([[0.  , 0.  , 0.  ],
               [2.  , 0.  , 1.57],
               [1.  , 0.  , 0.  ]])
    """
    return np.concatenate([np.zeros((min(1, len(poses)), 3)), between(poses[:-1], poses[1:])])


def compose_over(motion: Float64[ndarray, "n 3"], rows: Int64[ndarray, "k"]) -> Float64[ndarray, "k 3"]:
    """The motions between some of the frames, composed over the frames left out between them.

    Args:
        motion: of a drive.
        rows: the frames that are kept, in increasing order.
    """
    before, gap = rows[:-1], np.diff(rows)
    total = motion[before + 1]
    for further in range(2, int(gap.max(initial=1)) + 1):
        longer = gap >= further
        total[longer] = compose(total[longer], motion[before[longer] + further])
    return np.concatenate([np.zeros((1, 3)), total])


def _torch(poses: ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(poses, np.float64))


def _numpy(poses: torch.Tensor) -> ndarray:
    return np.asarray(poses.numpy())
