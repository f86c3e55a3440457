"""The conversion of a task's images to the inputs that a pretrained network was trained on."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

#: statistics of the images that most ImageNet classifiers are trained on, by channel
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


class TrunkInput(nn.Module):
    r"""Applies :math:`(x_c - \mu_c) / \sigma_c` to the colours of an image; constants, not in the state dict.

    One channel becomes three equal ones; channels after the third, such as coordinates, are passed on. A task that has
    standardised the images before says so with :func:`standardized_before`.

    Args:
        in_channels: channels of the images: 1, 3 or more.
        mean, std: statistics of the three colours, for images in [0, 1].

    Attributes:
        out_channels: number of output channels, at least 3.

    Raises:
        ValueError: there are two channels, which are not colours, or none.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, in_channels: int, mean: Sequence[float], std: Sequence[float]):
        super().__init__()
        if in_channels == 2 or in_channels < 1:
            raise ValueError(f"images of {in_channels} channels have no colours: 1, 3 or more are needed")
        self.out_channels = max(3, in_channels)
        self.register_buffer("mean", torch.tensor(tuple(mean)).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(tuple(std)).view(3, 1, 1), persistent=False)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h w"]:
        """The inputs that the network expects."""
        colours = (x[:, :3] - self.mean) / self.std
        return torch.cat([colours, x[:, 3:]], 1) if x.shape[1] > 3 else colours


def standardized_before(network: nn.Module, mean: Sequence[float], std: Sequence[float]) -> None:
    """Tell a pretrained network, in place, that it is fed ``(image - mean) / std``; any other is left as it is.

    Args:
        network: a backbone, or a module that holds one.
        mean, std: statistics of as many channels as the images have colours.
    """
    for module in network.modules():
        if isinstance(module, TrunkInput):
            before, spread = (torch.tensor(tuple(values)).view(-1, 1, 1) for values in (mean, std))
            module.mean.copy_((module.mean - before) / spread)
            module.std.copy_(module.std / spread)
