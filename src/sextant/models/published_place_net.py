"""Networks for places that others published, as one module each: trunk, aggregation, last layer, norm."""

from collections.abc import Mapping, Sequence
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.models.bag_of_queries import BagOfQueries
from sextant.models.pooling import FeatureMixer, GeM, NetVLAD
from sextant.models.standardize import Standardize
from sextant.models.torchvision_backbone import resnet_stages, vgg16_map
from sextant.models.transported_features import TransportedFeatures
from sextant.models.trunk import IMAGENET_MEAN, IMAGENET_STD
from sextant.models.vision_transformer import vision_transformer
from sextant.ranges import Count, checked

Kind = Literal["boq", "salad", "megaloc", "mixvpr", "cosplace", "netvlad"]
Trunk = Literal["vit", "resnet_basic", "resnet_bottleneck", "vgg16"]
#: images described at once, which bounds the memory
MOST = 8


class PublishedPlaceNet(nn.Module):
    r"""Image to descriptor, in the architecture of one of the published networks.

    =========  ==============================================================  ====================================
    kind       what it does with the trunk's map                               source
    =========  ==============================================================  ====================================
    boq        :class:`~sextant.models.bag_of_queries.BagOfQueries`             Ali-bey et al., CVPR 2024
    salad      :class:`~sextant.models.transported_features.TransportedFeatures`  Izquierdo and Civera, CVPR 2024
    megaloc    as salad, then a linear layer                                   Berton and Masone, CVPRW 2025
    mixvpr     :class:`~sextant.models.pooling.FeatureMixer`                    Ali-bey et al., WACV 2023
    cosplace   cells of unit length, :class:`~sextant.models.pooling.GeM`, a     Berton et al., CVPR 2022; EigenPlaces:
               linear layer; EigenPlaces too                                   ICCV 2023
    netvlad    :class:`~sextant.models.pooling.NetVLAD`, a linear layer or none  Arandjelovic et al., CVPR 2016
    =========  ==============================================================  ====================================

    Images in [0, 1] are standardised by ImageNet's statistics, descriptors scaled to unit length.

    Args:
        in_channels: 3.
        image_size: height and width.
        num_classes: not used: ``sizes`` has the length of a descriptor.
        kind: see above.
        trunk: a vision transformer as DINOv2 (timm), a ResNet with one or the other kind of block, or VGG-16 without
            its last activation (torchvision).
        blocks: of the transformer, or of each stage of the ResNet; empty for VGG-16.
        sizes: numbers of the aggregation, and ``width`` and ``patch`` of a transformer; ``registers`` and ``gated`` if
            it has any (:func:`~sextant.models.vision_transformer.vision_transformer`).

    Attributes:
        dimension: length of a descriptor.

    Raises:
        UserError: timm is needed and not installed, or the images do not fit the network.
        KeyError: a size is missing.

    Example:
        >>> import torch
        >>> network = PublishedPlaceNet(
        ...     3, (64, 96), 0, kind="cosplace", trunk="resnet_basic", blocks=[1, 1, 1, 1], sizes={"dimension": 32}
        ... ).eval()
        >>> network(torch.rand(2, 3, 64, 96)).shape
        torch.Size([2, 32])
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        kind: Kind,
        trunk: Trunk,
        blocks: Sequence[Count],
        sizes: Mapping[str, int],
    ):
        super().__init__()
        if in_channels != 3:
            raise ArgumentError(f"published networks take colour images, not {in_channels} channels", "channels=3")
        self.standardize = Standardize(3, IMAGENET_MEAN, IMAGENET_STD)
        self.tokens = kind in ("salad", "megaloc")
        self.unit_cells = kind == "cosplace"
        self.grid: tuple[int, int] | None = None  # of a transformer's patches
        channels, size = self._set_trunk(trunk, blocks, sizes, image_size, normed=self.tokens)
        self.aggregator: nn.Module = _aggregator(kind, channels, size, sizes)
        pooled = int(self.aggregator.features)  # type: ignore[arg-type]
        self.dimension = sizes.get("dimension", pooled)
        self.head = nn.Linear(pooled, self.dimension) if "dimension" in sizes else nn.Identity()

    def _set_trunk(
        self, trunk: Trunk, blocks: Sequence[int], sizes: Mapping[str, int], size: tuple[int, int], *, normed: bool
    ) -> tuple[int, tuple[int, int]]:
        """Build the trunk; returns the channels and the size of its map."""
        if trunk == "vit":
            patch, width = sizes["patch"], sizes["width"]
            if size[0] % patch or size[1] % patch:
                raise ArgumentError(
                    f"images of {size[0]}x{size[1]} do not divide into patches of {patch}", f"Multiples of {patch}."
                )
            more = {name: sizes.get(name, 0) for name in ("registers", "gated")}
            self.trunk: nn.Module = vision_transformer(width, patch, blocks[0], size, normed=normed, **more)
            self.registers = more["registers"]
            self.grid = (size[0] // patch, size[1] // patch)
            return width, self.grid
        self.trunk = vgg16_map() if trunk == "vgg16" else resnet_stages(blocks, bottleneck=trunk == "resnet_bottleneck")
        step, channels = 16, 512
        if trunk != "vgg16":
            step, channels = 2 ** (1 + len(blocks)), 64 * 2 ** (len(blocks) - 1)
            channels *= 4 if trunk == "resnet_bottleneck" else 1
        # VGG rounds down when it halves, ResNets round up
        return channels, tuple(side // step if trunk == "vgg16" else -(-side // step) for side in size)  # type: ignore[return-value]

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b k"]:
        """Descriptors, of unit length, of images in [0, 1]."""
        if torch.compiler.is_exporting() or len(images) <= MOST:
            return self._described(images)
        return torch.cat([self._described(some) for some in images.split(MOST)])

    def _described(self, images: Tensor) -> Tensor:
        x = self.standardize(images)
        if self.grid is None:
            features = self.trunk(x)
            pooled = self.aggregator(F.normalize(features, dim=1) if self.unit_cells else features)
        else:
            tokens = self.trunk.forward_features(x)  # type: ignore[operator]
            features = tokens[:, 1 + self.registers :].transpose(1, 2).unflatten(2, self.grid)
            pooled = self.aggregator(features, tokens[:, 0]) if self.tokens else self.aggregator(features)
        return F.normalize(self.head(pooled), dim=1)


def _aggregator(kind: Kind, channels: int, size: tuple[int, int], sizes: Mapping[str, int]) -> nn.Module:
    def of(*names: str) -> dict[str, int]:
        return {name: sizes[name] for name in names}

    if kind == "boq":
        numbers = of("queries", "layers", "rows")
        return BagOfQueries(channels, size, width=sizes["queries_width"], **numbers)
    if kind in ("salad", "megaloc"):
        numbers = of("clusters", "cluster_width", "token_width", "hidden")
        return TransportedFeatures(channels, size[0] * size[1], **numbers)
    if kind == "mixvpr":
        ratio = sizes["hidden"] / (size[0] * size[1])
        return FeatureMixer(channels, size, **of("out_channels", "out_rows", "depth"), ratio=ratio)
    if kind == "netvlad":
        return NetVLAD(channels, size, **of("clusters"))
    return GeM(channels, size)
