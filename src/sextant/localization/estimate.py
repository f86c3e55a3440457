r"""A pose estimate from a cloud of particles: the mean of the heaviest mode, and the number of modes.

The mean over all particles may lie between two plausible places, at neither of them. So the search starts at the box of
a grid over position and heading that is heaviest together with its neighbours. The mean is taken over the particles
within a radius of it, and the centre is moved to their mean a few times (mean shift with a flat kernel; Comaniciu &
Meer, PAMI 2002).

Means and covariances are weighted, with axes x, y of the map (metres) and heading (rad):

.. math:: \mu = \Big(\bar x, \bar y, \bar\theta\Big), \qquad \Sigma = \sum_i W_i\, d_i d_i^\top, \qquad
   d_i = (x_i - \bar x,\; y_i - \bar y,\; \mathrm{wrap}(\theta_i - \bar\theta)).

The mean describes the heaviest mode, the covariance the whole belief. Where other places are plausible too, the
reported pose may be off by the distance to them, which the covariance of the heaviest mode alone would not show. The
covariance is taken over the particles of that mode and those nearest to it, until they hold 99 % of the weight:
particles that a restart puts elsewhere count once they hold more than a hundredth.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float64, Int64
from torch import Tensor

from sextant.geometry.planar import wrap_angle
from sextant.localization.belief import Belief, picked
from sextant.localization.constants import HEADING_REACH, PLACE, RARE
from sextant.localization.kld_size import PoseBins

#: Mean-shift steps.
SHIFTS = 2
#: Mass above which a group is counted as a mode: a 95 % region may leave out less.
MODE = 1 - 0.95
#: Mass that a box must hold to be in a group: a mode at the corner of boxes is shared by eight of them.
BOX_MASS = MODE / 8
#: Number of boxes considered in each run, the heaviest ones.
BOXES = 64


@dataclass(frozen=True)
class Estimate:
    """The heaviest mode of each run's belief.

    Attributes:
        pose: mean of the mode.
        covariance: covariance about that mean of 99 % of the belief, the particles within the radius and the nearest
            others; axes x, y of the map and heading.
        mode_covariance: covariance of the particles within the radius only.
        mass: mass of the particles within the radius, the filter's confidence in the mode.
        modes: number of groups of neighbouring boxes that together hold more than 5 % of the mass; 0 if the belief is
            spread so widely that no box stands out.
    """

    pose: Float64[Tensor, "r 3"]
    covariance: Float64[Tensor, "r 3 3"]
    mode_covariance: Float64[Tensor, "r 3 3"]
    mass: Float64[Tensor, "r"]
    modes: Int64[Tensor, "r"]


def estimate(belief: Belief, radius: float, heading_radius: float = PLACE * HEADING_REACH) -> Estimate:
    """The mean of the dominant mode.

    Args:
        belief: belief of each run.
        radius: radius in metres; also the side of a box.
        heading_radius: radius in heading, in rad.

    Raises:
        ValueError: a radius is not above 0.

    Example:
        >>> poses = torch.tensor([[[0.0, 0, 0], [0.2, 0, 0], [0.4, 0, 0], [9, 0, 0]]], dtype=torch.float64)
        >>> found = estimate(Belief.uniform(poses), radius=1.0)
        >>> found.pose.round(decimals=4).tolist(), f"{found.mass[0]:.2f}", found.modes.tolist()  # 9 m is not included
        ([[0.2, 0.0, 0.0]], '0.75', [2])
        >>> found.covariance[0, 0, 0].sqrt().round(decimals=1).item()  # with the particle at 9 m
        4.4
    """
    if not (radius > 0 and heading_radius > 0):
        raise ValueError(f"radius={radius} and heading_radius={heading_radius} must be above 0")
    poses, weights = belief.poses, belief.weights
    boxes = _heaviest_boxes(poses, weights, PoseBins(radius, heading_radius))
    centre, chosen = boxes.middle, weights.masked_fill(~boxes.inside, 0.0)
    apart = _difference(poses, centre)
    for _ in range(SHIFTS):
        centre = _moved(centre, _mean(chosen, apart))
        apart = _difference(poses, centre)
        x, y, heading = apart.unbind(2)
        outside = (x * x + y * y > radius * radius) | (heading.abs() > heading_radius)
        nearer = weights.masked_fill(outside, 0.0)
        # the mean of a ring may have no particle near it: then the particles stay the same
        chosen = torch.where((nearer.sum(1) > 0)[:, None], nearer, chosen)
    shift = _mean(chosen, apart)
    within = _covariance(chosen, apart, shift)
    believed = _with_nearest(chosen, weights, apart / apart.new_tensor([radius, radius, heading_radius]))
    whole = within if believed is chosen else _covariance(believed, apart, shift)
    return Estimate(_moved(centre, shift), whole, within, chosen.sum(1), boxes.modes)


def _with_nearest(
    chosen: Float64[Tensor, "r p"], weights: Float64[Tensor, "r p"], apart: Float64[Tensor, "r p 3"]
) -> Float64[Tensor, "r p"]:
    """The weights of the chosen particles and of the nearest others, up to 99 % of the weight."""
    if bool((chosen.sum(1) >= 1 - RARE).all()):
        return chosen
    far = torch.maximum(torch.linalg.vector_norm(apart[..., :2], dim=2), apart[..., 2].abs())
    order = far.masked_fill(chosen > 0, -1.0).argsort(dim=1, stable=True)
    held = weights.gather(1, order)
    short = held.cumsum(1) - held < 1 - RARE  # the nearer particles do not hold enough
    return torch.maximum(chosen, torch.zeros_like(weights).scatter_(1, order, held * short))


@dataclass(frozen=True)
class _Boxes:
    """The heaviest box of each run: its particles, a pose near them, and the number of groups of heavy boxes."""

    inside: Bool[Tensor, "r p"]
    middle: Float64[Tensor, "r 3"]
    modes: Int64[Tensor, "r"]


def _heaviest_boxes(poses: Tensor, weights: Tensor, bins: PoseBins) -> _Boxes:
    cells = bins.cells(poses)
    keys = bins.keys(cells)
    ordered, order = keys.sort(1)
    group = torch.nn.functional.pad((ordered[:, 1:] != ordered[:, :-1]).cumsum(1), (1, 0))
    masses = torch.zeros_like(weights).scatter_add_(1, group, weights.gather(1, order))
    mass, box = masses.topk(min(BOXES, masses.shape[1]), dim=1)
    looked_at = int((mass > BOX_MASS).sum(1).max().clamp(min=1))
    mass, box = mass[:, :looked_at].contiguous(), box[:, :looked_at].contiguous()
    member = order.gather(1, torch.searchsorted(group, box).clamp(max=group.shape[1] - 1))
    near = _neighbours(picked(cells, member), bins.turns)
    heavy = mass > BOX_MASS
    heavy[:, 0] = True
    around = (near @ mass[..., None])[..., 0] + 1e-9 * mass  # among boxes with equal surroundings, prefer the heavier
    first = member.gather(1, around.masked_fill(~heavy, 0.0).argmax(1, keepdim=True))
    middle = picked(poses, first)[:, 0]
    return _Boxes(keys == keys.gather(1, first), middle, _modes(near, mass.masked_fill(mass <= BOX_MASS, 0.0)))


def _neighbours(cell: Int64[Tensor, "r b 3"], turns: int) -> Float64[Tensor, "r b b"]:
    apart = (cell[:, :, None] - cell[:, None]).abs()
    apart[..., 2] = torch.minimum(apart[..., 2], turns - apart[..., 2])
    return (apart <= 1).all(3).double()


def _modes(near: Float64[Tensor, "r b b"], mass: Float64[Tensor, "r b"]) -> Int64[Tensor, "r"]:
    """The number of connected heavy groups of boxes: each box counts as one over the size of its group."""
    some = (mass > 0).double()
    reach = near * some[:, :, None] * some[:, None]
    for _ in range(max(1, mass.shape[1] - 1).bit_length()):
        reach = (reach @ reach > 0).double()
    heavy = (reach @ mass[..., None])[..., 0] > MODE
    return (heavy * some / reach.sum(2).clamp(min=1)).sum(1).round().long()


def _difference(poses: Tensor, centre: Tensor) -> Tensor:
    apart = poses - centre[:, None]
    apart[..., 2] = wrap_angle(apart[..., 2])
    return apart


def _moved(pose: Tensor, by: Tensor) -> Tensor:
    pose = pose + by
    return torch.cat([pose[:, :2], wrap_angle(pose[:, 2:])], dim=1)


def _mean(weights: Float64[Tensor, "r p"], values: Float64[Tensor, "r p k"]) -> Float64[Tensor, "r k"]:
    return (weights[:, None] @ values)[:, 0] / weights.sum(1, keepdim=True)


def _covariance(
    weights: Float64[Tensor, "r p"], apart: Float64[Tensor, "r p 3"], mean: Float64[Tensor, "r 3"]
) -> Float64[Tensor, "r 3 3"]:
    from_mean = apart - mean[:, None]
    share = weights / weights.sum(1, keepdim=True)
    return (from_mean * share[..., None]).transpose(1, 2) @ from_mean
