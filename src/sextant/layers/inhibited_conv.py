"""The base of convolutions with inhibition: their strength, and how they are made from a plain convolution."""

from collections.abc import Mapping
from typing import Any, NoReturn, Self

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.layers.strength import Strength, check_strength, strength_buffer


class InhibitedConv2d(nn.Conv2d):
    """A convolution with a strength of inhibition α.

    Its state dict has one more entry, ``alpha``, only if there is one strength per channel, trained or not. Loading a
    state dict without it (a plain convolution's, or one from a version that did not store fixed strengths) leaves fixed
    strengths as they are.
    """

    alpha: float | Tensor

    @classmethod
    def from_conv(cls, conv: nn.Conv2d, *, train_alpha: bool = False, alpha: Strength = 1.0, **settings: Any) -> Self:
        """Make a layer with the geometry of ``conv`` that shares its weight and bias parameters.

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
        """The effective α: trained strengths after their ReLU."""
        # not by the type of self.alpha, which differs while torch.fx traces
        return F.relu(self.alpha) if "alpha" in self._parameters else self.alpha  # type: ignore[arg-type]

    def __prepare_scriptable__(self) -> NoReturn:
        """The replacement that ``torch.jit.script`` asks for when it cannot compile a module.

        Raises:
            UserError: always. A folded layer could replace it, but in training its pull kernels would silently stop
                following the weights.
        """
        raise UserError(
            f"torch.jit.script cannot compile {type(self).__name__}",
            "Script a copy for inference, whose inhibition is plain convolutions: torch.jit.script(fold(network)), "
            "with fold of sextant.layers.",
        )

    def _load_from_state_dict(
        self,
        state_dict: Mapping[str, Any],
        prefix: str,
        local_metadata: Any,
        strict: bool,
        missing_keys: list[str],
        unexpected_keys: list[str],
        error_msgs: list[str],
    ) -> None:
        key, fixed = f"{prefix}alpha", self._buffers.get("alpha")
        if fixed is not None:
            state_dict = {key: fixed, **state_dict}
            try:
                check_strength(state_dict[key], self.out_channels)
            except ValueError as error:
                error_msgs.append(f"{key}: {error}")  # such as trained strengths, which act after a ReLU
        super()._load_from_state_dict(
            state_dict, prefix, local_metadata, strict, missing_keys, unexpected_keys, error_msgs
        )

    def _set_alpha(self, alpha: Strength) -> None:
        check_strength(alpha, self.out_channels)
        strength_buffer(self, alpha)

    def _train_alpha(self, low: float, high: float) -> None:
        start = torch.empty(self.out_channels, device=self.weight.device, dtype=self.weight.dtype)
        self.alpha = nn.Parameter(start.uniform_(low, high))

    def _described_alpha(self) -> str:
        fixed = "a channel" if isinstance(self.alpha, Tensor) else str(self.alpha)
        return "trained" if isinstance(self.alpha, nn.Parameter) else fixed
