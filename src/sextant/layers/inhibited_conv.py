"""What convolutions with inhibition have in common: a strength, and that they can be made of a plain convolution."""

from typing import Any, Self

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.layers.strength import Strength, check_strength, strength_buffer


class InhibitedConv2d(nn.Conv2d):
    """A convolution with a strength of inhibition α; its state dict has one more entry only if α is trained."""

    alpha: float | Tensor

    @classmethod
    def from_conv(cls, conv: nn.Conv2d, *, train_alpha: bool = False, alpha: Strength = 1.0, **settings: Any) -> Self:
        """The layer with the geometry of ``conv``, sharing its weight and bias parameters.

        Args:
            train_alpha, alpha, settings: as in the constructor of the layer.
        """
        settings |= {"alpha": alpha, "train_alpha": train_alpha}
        layer = cls(
            conv.in_channels,
            conv.out_channels,
            conv.kernel_size,  # type: ignore[arg-type]
            conv.stride,  # type: ignore[arg-type]
            conv.padding,  # type: ignore[arg-type]
            conv.dilation,  # type: ignore[arg-type]
            conv.groups,
            conv.bias is not None,
            conv.padding_mode,
            device="meta" if not train_alpha else conv.weight.device,
            dtype=conv.weight.dtype,
            **settings,
        )
        layer.weight, layer.bias = conv.weight, conv.bias
        if not train_alpha:
            layer._set_alpha(alpha)  # on the device of the weights
        return layer.train(conv.training)

    def strengths(self) -> float | Float[Tensor, "co"]:
        """α as it acts: trained ones after their ReLU."""
        return F.relu(self.alpha) if isinstance(self.alpha, nn.Parameter) else self.alpha

    def _set_alpha(self, alpha: Strength) -> None:
        check_strength(alpha, self.out_channels)
        strength_buffer(self, alpha)

    def _train_alpha(self, low: float, high: float) -> None:
        start = torch.empty(self.out_channels, device=self.weight.device, dtype=self.weight.dtype)
        self.alpha = nn.Parameter(start.uniform_(low, high))

    def _described_alpha(self) -> str:
        fixed = "a channel" if isinstance(self.alpha, Tensor) else str(self.alpha)
        return "trained" if isinstance(self.alpha, nn.Parameter) else fixed
