"""The feature map of a network as a bank: its channels one by one, or the directions of its vectors."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.layers.cosfire.bank import Bank


class FeatureBank(Bank):
    """Each channel of a feature map, rectified; named by its number.

    >>> bank = FeatureBank(nn.Conv2d(3, 8, 3, padding=1), size=8)
    >>> maps = bank.describe(torch.rand(2, 3, 16, 16))
    >>> maps.shape, maps.amax((1, 2, 3)).tolist()  # shares of each image's strongest
    (torch.Size([2, 8, 16, 16]), [1.0, 1.0])

    Args:
        features: maps images to ``(b, k, y, x)``, such as ``sextant.models.FeatureMap`` of any layer of any network.
        size: k.
        normalise: divide by the strongest response of the image, so that thresholds and floors are shares of it.
    """

    def __init__(self, features: nn.Module, size: int, *, normalise: bool = True):
        super().__init__()
        self.features, self.size, self.normalise = features, size, normalise

    def grid(self) -> Float[Tensor, "k 1"]:
        """Numbers of the channels."""
        return torch.arange(self.size, dtype=torch.float64)[:, None]

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k y x"]:
        """The rectified feature map; see :meth:`Bank.describe`."""
        maps = _rectified(self.features, images, self.size)
        return _shared_out(maps, maps.amax((1, 2, 3), keepdim=True)) if self.normalise else maps

    def strongest(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b"]:
        """See :meth:`Bank.strongest`."""
        return images.new_ones(len(images)) if self.normalise else super().strongest(images)

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u 1"]) -> Float[Tensor, "b u y x"]:
        """Channels of the feature map; see :meth:`Bank.forward`."""
        return self.describe(images)[:, channels[:, 0].long().to(images.device)]


class VectorBank(Bank):
    r"""How well a feature vector points in a direction w: :math:`\max(0, \cos(w, F(y, x)))`.

    >>> bank = VectorBank(nn.Identity(), size=2)  # images are their own features
    >>> image = torch.tensor([3.0, 4.0]).view(1, 2, 1, 1)
    >>> bank(image, torch.tensor([[1.0, 0.0], [0.6, 0.8]])).flatten()
    tensor([0.6000, 1.0000])

    Args:
        features: maps images to ``(b, k, y, x)``.
        size: k.
        least: vectors shorter than this share of the image's longest respond less, so that empty places do not respond.
    """

    learnable = True

    def __init__(self, features: nn.Module, size: int, *, least: float = 0.05):
        super().__init__()
        self.features, self.size, self.least = features, size, least

    def grid(self) -> Float[Tensor, "k k"]:
        """The axes."""
        return torch.eye(self.size, dtype=torch.float64)

    def describe(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k y x"]:
        """The rectified feature map; see :meth:`Bank.describe`."""
        return _rectified(self.features, images, self.size)

    def strength(self, maps: Float[Tensor, "b k y x"]) -> Float[Tensor, "b 1 y x"]:
        """Lengths of the vectors: a vector with only some of its components would point elsewhere."""
        length: Tensor = maps.norm(dim=1, keepdim=True)
        return length

    def strongest(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b"]:
        """1, the cosine of a vector that points exactly in a direction."""
        return images.new_ones(len(images))

    def forward(self, images: Float[Tensor, "b c h w"], channels: Float[Tensor, "u k"]) -> Float[Tensor, "b u y x"]:
        """Cosines; see :meth:`Bank.forward`."""
        maps = self.describe(images)
        length = maps.norm(dim=1, keepdim=True)
        length = torch.maximum(length, self.least * length.amax((2, 3), keepdim=True))
        directions = F.normalize(channels, dim=1).to(maps)
        return torch.einsum("uk,bkyx->buyx", directions, _shared_out(maps, length)).clamp(min=0)


def _rectified(features: nn.Module, images: Tensor, size: int) -> Tensor:
    """The network's feature map with negative values set to 0.

    Raises:
        UserError: the network cannot take the images.
        ValueError: it gives another number of channels than ``size``.
    """
    try:
        maps: Tensor = features(images)
    except torch.cuda.OutOfMemoryError:
        raise
    except RuntimeError as error:
        raise UserError(
            f"the network of the COSFIRE bank cannot take images (b, c, h, w) of {tuple(images.shape)}: "
            f"{str(error).splitlines()[0]}",
            "Give images with the channels it was made for, and not smaller than it can take.",
        ) from error
    if maps.ndim != 4 or maps.shape[1] != size:
        raise ValueError(f"the features are {tuple(maps.shape)}, the bank expects (b, {size}, y, x)")
    return maps.clamp(min=0)


def _shared_out(maps: Tensor, whole: Tensor) -> Tensor:
    """Maps as shares of ``whole``; left as they are where ``whole`` is 0."""
    return maps / whole.masked_fill(whole <= 0, 1.0)
