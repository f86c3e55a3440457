"""The strength α of inhibition: one number, one per channel, or trained; and how to introduce it gradually."""

from collections.abc import Sequence
from typing import TypeAlias

import torch
from torch import Tensor, nn

Strength: TypeAlias = float | Sequence[float]


def check_strength(alpha: Strength, channels: int) -> None:
    """Refuse an invalid strength.

    Raises:
        ValueError: it is negative or not finite, or neither one number nor one per channel.
    """
    values = torch.as_tensor(alpha, dtype=torch.float64)
    if not bool((values >= 0).all() and values.isfinite().all()) or values.shape not in ((), (channels,)):
        raise ValueError(f"alpha must be >= 0, one number or one for each of {channels} channels; got {alpha}")


def strength_buffer(layer: nn.Conv2d, alpha: Strength) -> None:
    """Set ``layer.alpha``: a number as it is, one per channel as a buffer, a trained one in place.

    A number is a setting, like the stride; strengths per channel are data, which the state dict has to hold.
    """
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
