"""The channels of a network's feature map as a bank."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sextant.layers.cosfire.bank import Bank


class FeatureBank(Bank):
    """Each channel of a feature map, rectified; named by its number.

    Args:
        features: maps images to ``(b, k, y, x)``, such as ``sextant.models.FeatureMap`` of any layer of any network.
        size: k.
        normalise: divide by the strongest response of the image, so that thresholds and floors mean shares.
    """

    def __init__(self, features: nn.Module, size: int, *, normalise: bool = True):
        super().__init__()
        self.features, self.size, self.normalise = features, size, normalise

    def grid(self) -> Float[Tensor, "k 1"]:
        """Numbers of the channels."""
        return torch.arange(self.size, dtype=torch.float64)[:, None]

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k y x"]:
        """The rectified feature map; see :meth:`Bank.describe`."""
        maps = self.features(images).clamp(min=0)
        if maps.shape[1] != self.size:
            raise ValueError(f"the feature map has {maps.shape[1]} channels, the bank was told {self.size}")
        if not self.normalise:
            return maps  # type: ignore[no-any-return]
        return maps / maps.amax((1, 2, 3), keepdim=True).clamp(min=torch.finfo(maps.dtype).tiny)  # type: ignore[no-any-return]

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u 1"]) -> Float[Tensor, "b u y x"]:
        """Channels of the feature map; see :meth:`Bank.forward`."""
        return self.describe(images)[:, channels[:, 0].long().to(images.device)]


class VectorBank(Bank):
    r"""How well a feature vector points in a direction w: :math:`\max(0, \cos(w, F(y, x)))`.

    Args:
        features: maps images to ``(b, k, y, x)``.
        size: k.
        least: vectors shorter than this share of the image's longest answer less, so that empty places do not.
    """

    def __init__(self, features: nn.Module, size: int, *, least: float = 0.05):
        super().__init__()
        self.features, self.size, self.least = features, size, least

    def grid(self) -> Float[Tensor, "k k"]:
        """The axes."""
        return torch.eye(self.size, dtype=torch.float64)

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k y x"]:
        """The rectified feature map; see :meth:`Bank.describe`."""
        maps = self.features(images).clamp(min=0)
        if maps.shape[1] != self.size:
            raise ValueError(f"the feature map has {maps.shape[1]} channels, the bank was told {self.size}")
        return maps  # type: ignore[no-any-return]

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u k"]) -> Float[Tensor, "b u y x"]:
        """Cosines; see :meth:`Bank.forward`."""
        maps = self.describe(images)
        length = maps.norm(dim=1, keepdim=True)
        tiny = torch.finfo(maps.dtype).tiny
        length = torch.maximum(length, self.least * length.amax((2, 3), keepdim=True)).clamp(min=tiny)
        return torch.einsum("uk,bkyx->buyx", channels.to(maps), maps / length).clamp(min=0)
