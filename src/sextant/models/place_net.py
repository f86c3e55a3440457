"""From an image to a short vector that is similar for images of one place: backbone, pooling, linear layer, norm."""

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.models.pooling import NetVLAD, Pooling
from sextant.models.standardize import Standardize
from sextant.models.trunk import standardized_before


class PlaceNet(nn.Module):
    """A place descriptor: ``norm(W pool(backbone(standardise(image))) + b)``.

    Args:
        backbone: maps ``(b, c, h, w)`` to a feature map, such as :class:`~sextant.models.FeatureMap`.
        pooling: pooling for that map.
        dimension: length of a descriptor.
        normalise: scale descriptors to unit length. The ratio loss does not need this; most others do.
        project: add the linear layer; without it the pooling itself must have ``dimension`` outputs.
        in_channels: channels of the images.
        mean, std: statistics of the images by channel; by default 0.5 each, which maps [0, 1] to [-1, 1].

    Raises:
        ValueError: the dimension is below 1, or without projection not that of the pooling.

    Example:
        >>> import torch
        >>> from sextant.models import FeatureMap, PlaceCNN
        >>> from sextant.models.pooling import GeM
        >>> backbone = FeatureMap(PlaceCNN(3, (32, 48), 1), 3, (32, 48))
        >>> network = PlaceNet(backbone, GeM(backbone.channels, backbone.size), dimension=64)
        >>> network(torch.rand(2, 3, 32, 48)).shape
        torch.Size([2, 64])
    """

    def __init__(
        self,
        backbone: nn.Module,
        pooling: Pooling,
        dimension: int = 128,
        *,
        normalise: bool = True,
        project: bool = True,
        in_channels: int = 3,
        mean: Sequence[float] | None = None,
        std: Sequence[float] | None = None,
    ):
        super().__init__()
        if dimension < 1:
            raise ValueError(f"dimension must be at least 1, got {dimension}")
        if not project and pooling.features != dimension:
            raise ValueError(
                f"the pooling gives {pooling.features} numbers, not {dimension}, and there is no projection"
            )
        half = (0.5,) * in_channels
        self.standardize = Standardize(in_channels, mean or half, std or half)
        self.backbone = backbone.to(memory_format=torch.channels_last)  # faster on CPUs
        standardized_before(self.backbone, mean or half, std or half)
        self.pooling = pooling
        self.projection = nn.Linear(pooling.features, dimension) if project else nn.Identity()
        self.dimension, self.normalise = dimension, normalise

    def forward(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Descriptors of images in [0, 1]."""
        descriptors = self.projection(self.pooling(self.feature_map(images)))
        return F.normalize(descriptors, dim=1) if self.normalise else descriptors

    def feature_map(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h2 w2"]:
        """The backbone's feature map of images in [0, 1]."""
        x = self.standardize(images).contiguous(memory_format=torch.channels_last)
        return self.backbone(x)  # type: ignore[no-any-return]

    @torch.no_grad()
    def initialise_pooling(
        self, images: Float[Tensor, "b c h w"], generator: torch.Generator, most: int = 10_000
    ) -> bool:
        """Initialise a pooling that starts from features of images; return whether there was anything to do.

        Args:
            images: some hundreds of the training images, in [0, 1].
            generator: on the CPU; draws the features and seeds the clustering.
            most: largest number of features considered.
        """
        if not isinstance(self.pooling, NetVLAD):
            return False
        cells = torch.cat(
            [self.feature_map(some).flatten(2).transpose(1, 2).flatten(0, 1) for some in images.split(64)]
        )
        chosen = torch.randperm(len(cells), generator=generator)[:most].to(cells.device)
        seed = int(torch.randint(2**31, (1,), generator=generator))
        self.pooling.initialise(cells[chosen], seed)
        return True
