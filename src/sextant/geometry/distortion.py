r"""Radial distortion by Brown's polynomial, and its exact inverse.

A ray at the undistorted radius ``r = tan(angle to the optical axis)`` is seen at
:math:`r_d = r(1 + k_1 r^2 + k_2 r^4)`, both in focal lengths. Where the polynomial stops rising the picture folds over;
all inversion is on the branch before. On that branch :math:`r \le \tfrac94 r_d` whatever the coefficients: the ratio
r_d / r is smallest, 4/9, at a double root of the slope.

Source: D. C. Brown, "Decentering distortion of lenses", 1966; the lens family is of M. Lopez-Antequera, R. Mari,
P. Gargallo, Y. Kuang, J. Gonzalez-Jimenez, G. Haro, "Deep single image camera calibration with radial distortion",
CVPR 2019.
"""

from typing import Any, Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from sextant.errors import UserError

K2Family = Literal["lopez", "zero", "free"]
SLOPE_FLOOR = 0.05  # gradients of the inverse are 1 / slope: this bounds them next to a fold
MAX_STEPS = 64  # Newton needs about 6; next to a fold bisection takes over
EXPORTED_STEPS = 16  # next to a fold an exported graph is right to 1e-5 only


def k2_of_k1(
    k1: Float[Tensor, "*#batch"], family: K2Family = "lopez", k2: Float[Tensor, "*#batch"] | None = None
) -> Float[Tensor, "*#batch"]:
    r"""The second coefficient of a lens family with first coefficient ``k1``.

    ``lopez``: :math:`k_2 = 0.019 k_1 + 0.805 k_1^2`, fitted to real calibrations (Lopez-Antequera et al. 2019). With it
    the polynomial rises everywhere for ``k1 >= 0`` and ``k1 < -0.0536``, and in between at least up to r = 3.26.
    ``zero``: :math:`k_2 = 0`, which for negative ``k1`` folds at :math:`r = 1/\sqrt{-3 k_1}`.
    ``free``: ``k2`` as given.

    >>> k2_of_k1(torch.tensor([-0.2, 0.0, 0.2]))
    tensor([0.0284, 0.0000, 0.0360])
    >>> k2_of_k1(torch.tensor(-0.2), "zero")
    tensor(0.)

    Raises:
        UserError: the family is unknown, is ``free`` without ``k2``, or is another with ``k2``.
    """
    if family not in get_args(K2Family):
        raise UserError(f"k2_of_k1 must be one of {', '.join(get_args(K2Family))}; got {family!r}", "k2_of_k1=lopez")
    if (family == "free") != (k2 is not None):
        raise UserError(
            f"k2_of_k1={family} {'needs a value of k2' if family == 'free' else 'fixes k2, which was given as well'}",
            "Give k2 together with k2_of_k1=free, and with no other family.",
        )
    if k2 is not None:
        return k2
    return 0.019 * k1 + 0.805 * k1 * k1 if family == "lopez" else torch.zeros_like(k1)


def distort_radius(
    radius: Float[Tensor, "*#batch"], k1: Float[Tensor, "*#batch"], k2: Float[Tensor, "*#batch"]
) -> Float[Tensor, "*#batch"]:
    """Distorted radius ``r (1 + k1 r^2 + k2 r^4)``, in focal lengths; odd in r, beyond the fold as well.

    >>> distort_radius(torch.tensor([0.0, 0.5, 1.0]), torch.tensor(-0.2), torch.tensor(0.03))
    tensor([0.0000, 0.4759, 0.8300])
    """
    return radius * distortion_factor(radius * radius, k1, k2)


def distortion_factor(
    square: Float[Tensor, "*#batch"], k1: Float[Tensor, "*#batch"], k2: Float[Tensor, "*#batch"]
) -> Float[Tensor, "*#batch"]:
    """The ratio ``r_d / r = 1 + k1 s + k2 s^2`` at the squared undistorted radius ``s = r^2``: smooth at the centre.

    >>> distortion_factor(torch.tensor(0.25), torch.tensor(-0.2), torch.tensor(0.0))
    tensor(0.9500)
    """
    return 1 + square * (k1 + k2 * square)


def max_radius(k1: Float[Tensor, "*#batch"], k2: Float[Tensor, "*#batch"]) -> Float[Tensor, "*#batch"]:
    """The fold radius: smallest r > 0 with slope ``1 + 3 k1 r^2 + 5 k2 r^4 = 0``; ``inf`` if the polynomial only rises.

    Differentiable where finite, except where the polynomial just touches slope 0; elsewhere its gradient is 0.

    >>> max_radius(torch.tensor([-0.2, 0.2]), torch.tensor(0.0))
    tensor([1.2910,    inf])
    """
    k1, k2 = torch.broadcast_tensors(k1, k2)
    discriminant = 9 * k1 * k1 - 20 * k2
    folds = (discriminant >= 0) & ((k1 < 0) | (k2 < 0))
    root = torch.where(folds, discriminant, 1).sqrt()
    # the smallest positive root of the quadratic in r^2, each sign of k1 by the form that does not cancel
    below = 2 / torch.where(folds & (k1 <= 0), root - 3 * k1, 1)
    above = (root + 3 * k1) / torch.where(folds & (k1 > 0), -10 * k2, 1)
    square = torch.where(k1 > 0, above, below)
    return torch.where(folds, torch.where(folds, square, 1).sqrt(), torch.inf)


def max_distorted_radius(k1: Float[Tensor, "*#batch"], k2: Float[Tensor, "*#batch"]) -> Float[Tensor, "*#batch"]:
    """The largest distorted radius that a ray is seen at, that of the fold; ``inf`` if the polynomial only rises.

    >>> max_distorted_radius(torch.tensor([-0.2, 0.2]), torch.tensor(0.0))
    tensor([0.8607,    inf])
    """
    fold = max_radius(k1, k2)
    return torch.where(fold.isinf(), torch.inf, distort_radius(torch.where(fold.isinf(), 0, fold), k1, k2))


def undistort_radius(
    distorted: Float[Tensor, "*#batch"], k1: Float[Tensor, "*#batch"], k2: Float[Tensor, "*#batch"]
) -> Float[Tensor, "*#batch"]:
    r"""The undistorted radius r with :math:`r(1 + k_1 r^2 + k_2 r^4) = r_d`, exact to rounding, on the rising branch.

    Newton's method inside a bracket that always holds the root, so it cannot diverge. Radii that the lens does not
    reach (beyond the image of the fold) give the fold radius. Odd in ``distorted``.

    Gradients, of any order, are those of the implicit function: with :math:`S = 1 + 3 k_1 r^2 + 5 k_2 r^4`,
    :math:`\partial r/\partial r_d = 1/S`, :math:`\partial r/\partial k_1 = -r^3/S`,
    :math:`\partial r/\partial k_2 = -r^5/S`.
    S is taken as at least 0.05, next to the fold and beyond it, so that they are finite and keep their direction.

    >>> k1, k2 = torch.tensor(-0.2), torch.tensor(0.03)
    >>> undistort_radius(distort_radius(torch.tensor(0.5), k1, k2), k1, k2)
    tensor(0.5000)
    """
    distorted, k1, k2 = torch.broadcast_tensors(distorted, k1, k2)
    radius: Tensor = _Undistort.apply(distorted, k1, k2)
    return radius


def _slope(square: Tensor, k1: Tensor, k2: Tensor) -> Tensor:
    return 1 + square * (3 * k1 + 5 * k2 * square)


def _solve(distorted: Tensor, k1: Tensor, k2: Tensor) -> Tensor:
    """The root for ``distorted >= 0``. Entries stop one by one, so no result depends on the rest of the batch."""
    fold = max_radius(k1, k2)
    out_of_reach = distorted >= max_distorted_radius(k1, k2)
    low, high = torch.zeros_like(distorted), torch.minimum(fold, 2.25 * distorted)
    # exact for weak distortion, and of the right power for strong
    start = distorted / distortion_factor(distorted * distorted, k1, k2).clamp(min=1) ** 0.2
    radius = torch.minimum(start, high)
    small = torch.finfo(distorted.dtype).eps ** (2 / 3)  # after such a step of Newton's the error is below rounding
    done = out_of_reach
    exporting = torch.compiler.is_exporting()  # of a graph every step is a part, and none asks whether to go on
    for _ in range(EXPORTED_STEPS if exporting else MAX_STEPS):
        excess = distort_radius(radius, k1, k2) - distorted
        low, high = torch.where(excess < 0, radius, low), torch.where(excess > 0, radius, high)
        newton = radius - excess / _slope(radius * radius, k1, k2)
        inside = (newton >= low) & (newton <= high)
        proposal = torch.where(inside, newton, (low + high) / 2)
        last = (inside & ((newton - radius).abs() <= small * radius)) | newton.isnan()
        radius = torch.where(done, radius, proposal)
        done = done | last
        if not exporting and done.all():
            break
    return torch.where(out_of_reach, fold, radius)


class _Undistort(torch.autograd.Function):
    """The root with gradients by the implicit function theorem; no step of the solver enters the graph."""

    @staticmethod
    def forward(distorted: Tensor, k1: Tensor, k2: Tensor) -> Tensor:
        return torch.copysign(_solve(distorted.abs(), k1, k2), distorted)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, Tensor, Tensor], output: Tensor) -> None:
        ctx.save_for_backward(output, inputs[1], inputs[2])

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        radius, k1, k2 = ctx.saved_tensors  # the radius is this function's output, so that gradients have gradients
        square = radius * radius
        by_distorted = grads[0] / _slope(square, k1, k2).clamp(min=SLOPE_FLOOR)
        by_k1 = -by_distorted * radius * square
        return by_distorted, by_k1, by_k1 * square
