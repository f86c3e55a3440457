"""Standardisation of images as the first layer of a network, so that every network takes images in [0, 1]."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

#: statistics of CIFAR-10's training images, as the push-pull paper uses them
CIFAR10_MEAN = (125.3 / 255, 123.0 / 255, 113.9 / 255)
CIFAR10_STD = (63.0 / 255, 62.1 / 255, 66.7 / 255)


class Standardize(nn.Module):
    r"""Applies :math:`(x_c - \mu_c) / \sigma_c` to each channel of images in [0, 1]; constants, not in the state dict.

    Args:
        in_channels: channels of the image.
        mean, std: one per channel. By default those of CIFAR-10 for three channels, else 0.5 and 0.25.

    Raises:
        ValueError: there is not one mean and one positive std per channel.

    Example:
        >>> Standardize(in_channels=1, mean=[0.5], std=[0.25])(torch.tensor([[[[0.5, 1.0]]]]))
        tensor([[[[0., 2.]]]])
    """

    mean: Tensor
    std: Tensor

    def __init__(self, in_channels: int, mean: Sequence[float] | None = None, std: Sequence[float] | None = None):
        super().__init__()
        colour = in_channels == 3
        means = tuple(mean if mean is not None else CIFAR10_MEAN if colour else (0.5,) * in_channels)
        stds = tuple(std if std is not None else CIFAR10_STD if colour else (0.25,) * in_channels)
        if not len(means) == len(stds) == in_channels or min(stds) <= 0:
            raise ValueError(f"{in_channels} channels need as many means and positive stds, got {means} and {stds}")
        self.register_buffer("mean", torch.tensor(means).view(-1, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(stds).view(-1, 1, 1), persistent=False)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        """Standardised images."""
        return (x - self.mean) / self.std

    def extra_repr(self) -> str:
        """The constants."""
        return f"mean={self.mean.flatten().tolist()}, std={self.std.flatten().tolist()}"
