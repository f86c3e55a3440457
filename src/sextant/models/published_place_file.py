"""Reads networks for places from files of their authors: the kind is found from the names and shapes of the arrays.

Layouts, as the authors' repositories write them (amaralibey/Bag-of-Queries and MixVPR, serizba/salad, gmberton/MegaLoc,
CosPlace and EigenPlaces, Nanne/pytorch-NetVlad and QVPR/Patch-NetVLAD; facebookresearch/dinov2 and torchvision within):

========  =====================================  ==============================  =====================
kind      trunk                                  aggregation                     last layer
========  =====================================  ==============================  =====================
boq       ``backbone.dino.`` or ``.net.<n>.``    ``aggregator.``
salad     ``backbone.model.``                    ``aggregator.``
megaloc   ``backbone.`` or ``backbone.model.``   ``aggregator.agg.``             ``aggregator.linear.``
mixvpr    ``backbone.model.``                    ``aggregator.``
cosplace  ``backbone.<n>.``                      ``aggregation.1.``              ``aggregation.3.``
netvlad   ``encoder.<n>.``                       ``pool.``                       ``WPCA.0.`` or none
========  =====================================  ==============================  =====================

CosPlace and EigenPlaces have one layout. Nothing in a file is executed.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import torch
from torch import Tensor

from sextant.errors import ArgumentError, UserError
from sextant.models.published_arrays import count_of, fitted_arrays, told_shape
from sextant.models.published_place_net import Kind, PublishedPlaceNet, Trunk
from sextant.models.vision_transformer import GATED, resampled_positions, with_registers_folded


@dataclass(frozen=True)
class Layout:
    """What is known of a kind.

    Attributes:
        title: its name.
        mark: an array that only this kind has.
        side: of the images on which the authors report results, by the trunk's family; None: 480 x 640, as the photos
            of their test sets.
        own: prefix of the arrays of the aggregation.
        last: prefix of the arrays of the last layer.
    """

    title: str
    mark: str
    side: Mapping[str, int] | None
    own: str
    last: str = ""


LAYOUTS: dict[Kind, Layout] = {
    "boq": Layout("BoQ", "aggregator.boqs.0.queries", {"vit": 322, "resnet": 384}, "aggregator."),
    "megaloc": Layout("MegaLoc", "aggregator.agg.dust_bin", {"vit": 322}, "aggregator.agg.", "aggregator.linear."),
    "salad": Layout("SALAD", "aggregator.dust_bin", {"vit": 322}, "aggregator."),
    "mixvpr": Layout("MixVPR", "aggregator.channel_proj.weight", {}, "aggregator."),
    "cosplace": Layout("CosPlace or EigenPlaces", "aggregation.1.p", None, "aggregation.1.", "aggregation.3."),
    "netvlad": Layout("NetVLAD", "pool.centroids", None, "pool.", "WPCA.0."),
}
KNOWN = ", ".join(layout.title for layout in LAYOUTS.values())
USUAL_SIZE = (480, 640)
#: our name of an array of the aggregation, and the authors'
RENAMED: dict[str, tuple[tuple[str, str], ...]] = {
    "mixvpr": (
        (r"^mix\.(\d+)\.norm\.", r"mix.\1.mix.0."),
        (r"^mix\.(\d+)\.widen\.", r"mix.\1.mix.1."),
        (r"^mix\.(\d+)\.narrow\.", r"mix.\1.mix.3."),
        (r"^project_channels\.", "channel_proj."),
        (r"^project_cells\.", "row_proj."),
    ),
    "netvlad": ((r"^centres$", "centroids"), (r"^assignment\.", "conv.")),
}
#: places of a ResNet's parts in a sequence
PLACES = {"conv1": "0", "bn1": "1", "layer1": "4", "layer2": "5", "layer3": "6", "layer4": "7"}
#: arrays that describing an image does not need: masked tokens, the classifier, a norm that is not applied
UNUSED = re.compile(
    r"(^|\.)(mask_token|fc\.(weight|bias)|head\.(weight|bias)|norm\.(weight|bias)|num_batches_tracked)$"
)
#: arrays that a file may lack, and then are zero
OPTIONAL = re.compile(r"num_batches_tracked$|^aggregator\.assignment\.bias$")


@dataclass(frozen=True)
class PublishedPlaces:
    """A network read from a file.

    Attributes:
        kind: its kind.
        title: the kind's name.
        settings: ``kind``, ``trunk``, ``blocks`` and ``sizes`` of :class:`PublishedPlaceNet`.
        image_size: height and width of its images.
        dimension: length of a descriptor.
        state: its arrays, by the names of :class:`PublishedPlaceNet`.
    """

    kind: Kind
    title: str
    settings: dict[str, Any]
    image_size: tuple[int, int]
    dimension: int
    state: dict[str, Tensor]


def kind_of(tensors: Mapping[str, Any]) -> Kind | None:
    """The kind of network that has arrays of these names."""
    return next((kind for kind in get_args(Kind) if LAYOUTS[kind].mark in tensors), None)


def read_published_places(tensors: Mapping[str, Tensor], file: str) -> PublishedPlaces:
    """The network of a state dict.

    Args:
        tensors: from :func:`tensors_of`.
        file: its name, for messages.

    Raises:
        UserError: it is of no known kind, lacks arrays, or has some of another shape or beyond those of its kind.
    """
    kind = kind_of(tensors)
    if kind is None:
        names = ", ".join(list(tensors)[:3])
        raise UserError(
            f"{file} holds {len(tensors):,} arrays ({names}, ...), which are not those of a place network that Sextant "
            f"knows",
            f"Known: {KNOWN}. Or describe the photos there: descriptors=<file>.npy, or run=onnx:<file>.onnx",
        )
    return _Reading(kind, tensors, file).network()


class _Reading:
    """The arrays of a file of a known kind."""

    def __init__(self, kind: Kind, tensors: Mapping[str, Tensor], file: str):
        self.kind, self.layout, self.tensors, self.file = kind, LAYOUTS[kind], tensors, file
        self.prefix, self.sequence, self.trunk = self._trunk()
        self.tensors = with_registers_folded(tensors, self.prefix) if self.trunk == "vit" else tensors
        self.gated = f"{self.prefix}blocks.0.mlp.w12.bias" in tensors

    def network(self) -> PublishedPlaces:
        blocks, sizes = self._blocks(), self._trunk_sizes() | self._sizes()
        settings: dict[str, Any] = {"kind": self.kind, "trunk": self.trunk, "blocks": blocks, "sizes": sizes}
        size = self._image_size(blocks, sizes)
        try:
            with torch.device("meta"):
                network = PublishedPlaceNet(3, size, 0, **settings)
        except (ArgumentError, ValueError) as error:
            raise self._unfit(str(error)) from None
        return PublishedPlaces(
            self.kind,
            self.layout.title,
            settings,
            size,
            network.dimension,
            self._fitted(network.state_dict(), size, sizes),
        )

    def _trunk(self) -> tuple[str, bool, Trunk]:
        """The prefix of the trunk's arrays, whether they are numbered as in a sequence, and its kind."""
        token = next((name for name in self.tensors if name.endswith("cls_token")), None)
        if token is not None:
            return token.removesuffix("cls_token"), False, "vit"
        for prefix in ("backbone.model.", "backbone.net.", "backbone.", "encoder."):
            for first, sequence in (("conv1.weight", False), ("0.weight", True)):
                weight = self.tensors.get(prefix + first)
                if weight is None or weight.ndim != 4:
                    continue
                if weight.shape[2] == 3:
                    return prefix, False, "vgg16"
                third = prefix + ("4" if sequence else "layer1") + ".0.conv3.weight"
                return prefix, sequence, "resnet_bottleneck" if third in self.tensors else "resnet_basic"
        raise self._unfit("it has no trunk that is known: DINOv2, ResNet or VGG-16")

    def _blocks(self) -> list[int]:
        if self.trunk == "vgg16":
            return []
        if self.trunk == "vit":
            return [self._count(re.escape(self.prefix) + r"blocks\.(\d+)\.")]
        stages = [PLACES[f"layer{k}"] if self.sequence else f"layer{k}" for k in range(1, 5)]
        counts = [self._count(re.escape(f"{self.prefix}{stage}.") + r"(\d+)\.") for stage in stages]
        return counts[: counts.index(0)] if 0 in counts else counts

    def _trunk_sizes(self) -> dict[str, int]:
        if self.trunk != "vit":
            return {}
        width, _, patch, _ = self._shape(f"{self.prefix}patch_embed.proj.weight", 4)
        sizes = {"width": width, "patch": patch}
        if f"{self.prefix}reg_token" in self.tensors:
            sizes["registers"] = self._shape(f"{self.prefix}reg_token", 3)[1]
        if self.gated:
            sizes["gated"] = self._shape(f"{self.prefix}blocks.0.mlp.w12.bias", 1)[0]
        return sizes

    def _sizes(self) -> dict[str, int]:
        """The numbers of the aggregation and of the last layer."""
        own = self.layout.own
        if self.kind == "boq":
            _, queries, width = self._shape(f"{own}boqs.0.queries", 3)
            layers = self._count(re.escape(own) + r"boqs\.(\d+)\.queries$")
            return {
                "queries": queries,
                "queries_width": width,
                "layers": layers,
                "rows": self._shape(f"{own}fc.weight", 2)[0],
            }
        if self.kind in ("salad", "megaloc"):
            hidden = self._shape(f"{own}score.0.weight", 4)[0]
            ends = {"clusters": "score.3", "cluster_width": "cluster_features.3", "token_width": "token_features.2"}
            sizes = {name: self._shape(f"{own}{end}.bias", 1)[0] for name, end in ends.items()} | {"hidden": hidden}
            return sizes | (self._last() if self.kind == "megaloc" else {})
        if self.kind == "mixvpr":
            rows, columns = self._shape(f"{own}row_proj.weight", 2)[0], self._shape(f"{own}channel_proj.weight", 2)[0]
            depth, hidden = self._count(re.escape(own) + r"mix\.(\d+)\."), self._shape(f"{own}mix.0.mix.1.weight", 2)[0]
            return {"out_rows": rows, "out_channels": columns, "depth": depth, "hidden": hidden}
        if self.kind == "netvlad":
            whitened = any(name.startswith(self.layout.last) for name in self.tensors)
            return {"clusters": self._shape(f"{own}centroids", 2)[0]} | (self._last() if whitened else {})
        return self._last()

    def _last(self) -> dict[str, int]:
        return {"dimension": self._shape(f"{self.layout.last}bias", 1)[0]}

    def _image_size(self, blocks: list[int], sizes: Mapping[str, int]) -> tuple[int, int]:
        if self.layout.side is None:
            return USUAL_SIZE
        if self.kind == "mixvpr":  # the only one that takes maps of one size
            cells = self._shape(f"{self.layout.own}row_proj.weight", 2)[1]
            side = round(cells**0.5) * 2 ** (1 + len(blocks))
            return side, side
        side = self.layout.side.get(self.trunk.partition("_")[0], 0)
        if not side:
            raise self._unfit(
                f"its trunk is a {self.trunk}, and {self.layout.title} has {' or '.join(self.layout.side)}"
            )
        side = side // sizes.get("patch", 1) * sizes.get("patch", 1)
        return side, side

    def _theirs(self, name: str) -> str:
        """The authors' name of one of our arrays."""
        part, _, rest = name.partition(".")
        if part == "trunk":
            first, _, inner = rest.partition(".")
            if self.gated:
                for theirs, ours in GATED.items():
                    rest = rest.replace(ours, theirs)
            return self.prefix + (f"{PLACES[first]}.{inner}" if self.sequence else rest)
        if part == "head":
            return self.layout.last + rest
        for pattern, theirs in RENAMED.get(self.kind, ()):
            rest = re.sub(pattern, theirs, rest)
        return self.layout.own + rest

    def _fitted(self, own: Mapping[str, Tensor], size: tuple[int, int], sizes: Mapping[str, int]) -> dict[str, Tensor]:
        """The arrays by our names; raises a ``UserError`` unless the file has exactly those, in their shapes."""

        def adapted(name: str, found: Tensor) -> Tensor:
            if name != "trunk.pos_embed":
                return found
            grid = size[0] // sizes["patch"], size[1] // sizes["patch"]
            return resampled_positions(found, grid, registers="registers" in sizes)

        state, problems = fitted_arrays(
            own, self.tensors, self._theirs, unused=UNUSED, optional=OPTIONAL, adapted=adapted
        )
        if problems:
            raise self._unfit("; ".join(problems))
        return state

    def _shape(self, name: str, axes: int) -> tuple[int, ...]:
        found = self.tensors.get(name)
        if found is None:
            raise self._unfit(f"it lacks {name}")
        if found.ndim != axes:
            raise self._unfit(f"it has in another shape {name} ({told_shape(found.shape)} instead of {axes} axes)")
        return tuple(found.shape)

    def _count(self, pattern: str) -> int:
        return count_of(self.tensors, pattern)

    def _unfit(self, how: str) -> UserError:
        return UserError(
            f"{self.file} looks like {self.layout.title} by {self.layout.mark}, but does not fit it: {how}",
            f"Copy the file again, or give one of the authors' files. Known: {KNOWN}",
        )
