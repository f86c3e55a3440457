"""The pull: its kernel, stretched from the push's, and its strength α, one number, one per channel, or trained."""

import math
from collections.abc import Sequence
from functools import cache
from numbers import Real
from typing import TypeAlias

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import shown
from sextant.ranges import NonNegative, fits


def pull_kernel_size(size: int, scale: float) -> int:
    """Side of the pull kernel: ``size * scale`` rounded down, plus one if that is even.

    ``K = floor(s h) + 1 - (floor(s h) mod 2)``; for ``h = 2`` sizes 3, 5, 7 give 7, 11, 15. ``h = 1`` keeps the size,
    and a 1x1 kernel has no pattern to stretch: ``h = 2`` makes it a 3x3 box.

    >>> [pull_kernel_size(size, 2.0) for size in (1, 3, 5, 7)]
    [3, 7, 11, 15]
    """
    if scale == 1:
        return size
    stretched = math.floor(size * scale)
    return stretched + 1 - stretched % 2


def interpolation_matrix(
    size: int, pull_size: int, *, dtype: torch.dtype | None = None, device: torch.device | str | None = None
) -> Float[Tensor, "K s"]:
    """The matrix A that stretches ``size`` taps to ``pull_size``, bilinearly and with aligned corners.

    Every row sums to one; ``size = 1`` gives a column of ones.

    >>> interpolation_matrix(2, 3)
    tensor([[1.0000, 0.0000],
            [0.5000, 0.5000],
            [0.0000, 1.0000]])
    """
    return torch.tensor(hats(size, pull_size), dtype=dtype or torch.get_default_dtype(), device=device)


@cache
def hats(size: int, pull_size: int) -> Float[np.ndarray, "K s"]:
    """The values of :func:`interpolation_matrix`; cached, so do not write to them."""
    positions = np.linspace(0, size - 1, pull_size)
    return np.asarray(np.maximum(0, 1 - np.abs(positions[:, None] - np.arange(size))))


def upsample_kernel(weight: Float[Tensor, "o c kh kw"], scale: float) -> Float[Tensor, "o c KH KW"]:
    r"""The pull kernel ``k ↑ h`` before its sign is flipped: ``weight`` stretched bilinearly with its corners aligned.

    Stretching is linear and separable. With corners aligned, a kernel of :math:`s` rows becomes one of :math:`K` rows
    by the matrix :math:`A` (:math:`K \times s`) of hat functions, :math:`A_{ti} = \max(0, 1 - |t (s-1)/(K-1) - i|)`, so
    that

    .. math:: U(W) = A_v \, W \, A_h^\top .

    For :math:`s = 3, K = 7` the columns of A are (1, 2/3, 1/3, 0, 0, 0, 0), (0, 1/3, 2/3, 1, 2/3, 1/3, 0) and the
    mirror of the first: whole hats inside, half hats at both ends.

    Source: N. Strisciuglio, M. Lopez-Antequera, N. Petkov, "Enhanced robustness of convolutional networks with a
    push-pull inhibition layer", Neural Computing and Applications 32, 2020, section 3.1; the matrix form follows from
    it.

    There is no renormalisation, as in the paper's code: the L1 norm grows about 3.9 times for size 3 and ``h = 2``.

    >>> upsample_kernel(torch.ones(8, 3, 5, 5), 2.0).shape
    torch.Size([8, 3, 11, 11])
    """
    size = (pull_kernel_size(weight.shape[2], scale), pull_kernel_size(weight.shape[3], scale))
    if size == weight.shape[2:]:
        return weight
    return F.interpolate(weight, size=size, mode="bilinear", align_corners=True)


Strength: TypeAlias = float | Sequence[float] | np.ndarray | Tensor


def check_strength(alpha: Strength, channels: int) -> None:
    """Refuse an invalid strength.

    Raises:
        ValueError: it is negative or not finite, or neither one number nor one per channel.
    """
    several = fits(Sequence[NonNegative], alpha) and len(alpha) == channels  # type: ignore[arg-type]
    if not several and not fits(NonNegative, alpha):
        raise _refusal(alpha, channels)


def strength_factor(alpha: float | Tensor, channels: int) -> float | Tensor:
    """α as a factor of responses ``(co, h, w)``. Values of a tensor are not read, which would wait for the GPU.

    Raises:
        ValueError: it is negative or not finite, or neither one number nor a tensor of one per channel.
    """
    if isinstance(alpha, Tensor):
        if alpha.shape not in ((), (channels,)):
            raise _refusal(alpha, channels)
        return alpha.view(-1, 1, 1)
    if isinstance(alpha, bool) or not isinstance(alpha, Real) or not 0 <= alpha < math.inf:
        raise _refusal(alpha, channels)
    return alpha


def _refusal(alpha: object, channels: int) -> ValueError:
    got = shown(alpha)
    return ValueError(f"alpha must be >= 0 and finite, one number or one for each of {channels} channels; got {got}")


def strength_buffer(layer: nn.Conv2d, alpha: Strength) -> None:
    """Set ``layer.alpha``: a number as it is, one per channel as a buffer, a trained one in place.

    A number is a setting, like the stride; strengths per channel are data, which the state dict has to hold.
    """
    alpha = alpha.tolist() if isinstance(alpha, np.ndarray) else alpha
    present = layer._parameters.get("alpha")
    if present is not None:
        with torch.no_grad():
            present.copy_(torch.as_tensor(alpha, dtype=present.dtype))
        return
    layer._buffers.pop("alpha", None)
    layer.__dict__.pop("alpha", None)
    if isinstance(alpha, Sequence | Tensor):
        values = torch.as_tensor(alpha, dtype=layer.weight.dtype, device=layer.weight.device)
        layer.register_buffer("alpha", values.expand(layer.out_channels).clone())
    else:
        layer.alpha = alpha  # type: ignore[assignment]


def strength_path(progress: float, *, alpha: float, scale: float) -> tuple[float, float]:
    """Strength and scale on a continuous path from the convolution (h = 1, α = 1) to inhibition (h, α).

    Kernel sizes are odd integers, so raising h makes the response jump unless α is zero. In the first half α falls
    from 1 to 0 with h = 1: a leaky ReLU that becomes a ReLU. At α = 0 h changes without effect, and in the second half
    α rises to its final value.

    >>> [strength_path(progress, alpha=1.0, scale=2.0) for progress in (0.0, 0.5, 1.0)]
    [(1.0, 1.0), (0.0, 2.0), (1.0, 2.0)]

    Args:
        progress: from 0 to 1; clamped beyond.
        alpha: the strength at the end.
        scale: h in the second half.

    Returns:
        ``(alpha, scale)`` for ``PushPullConv2d.set_strength``.
    """
    progress = min(max(progress, 0.0), 1.0)
    if progress < 0.5:
        return 1 - 2 * progress, 1.0
    return (2 * progress - 1) * alpha, scale
