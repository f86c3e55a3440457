"""AnyCalib's network: image to the viewing ray of each pixel.

Sources: J. Tirado-Garin and J. Civera, "AnyCalib: on-manifold learning for model-agnostic single-view camera
calibration", ICCV 2025; for the decoder R. Ranftl, A. Bochkovskiy, V. Koltun, "Vision transformers for dense
prediction", ICCV 2021; for the upsampling Z. Teed and J. Deng, "RAFT", ECCV 2020.
"""

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.models.standardize import Standardize
from sextant.models.trunk import IMAGENET_MEAN, IMAGENET_STD
from sextant.models.vision_transformer import resampled_positions, vision_transformer

#: blocks of 24 whose cells are used, counted from 0
USED, OF = (4, 11, 17, 23), 24
#: cells are predicted at half the side of a patch
FINER = 2


class RayNet(nn.Module):
    """Images to rays, as AnyCalib predicts them before it fits a camera.

    Args:
        width, patch, depth: of the transformer, as DINOv2.
        side: rows of patches for which its positions were learnt.
        projected: channels of the four maps before they are joined.
        channels: of the joined map.

    Raises:
        UserError: timm is not installed.

    Example:
        >>> network = RayNet(width=64, patch=14, depth=4, side=3, projected=(8, 8, 8, 8), channels=8).eval()
        >>> network(torch.rand(1, 3, 28, 42)).shape
        torch.Size([1, 3, 28, 42])
    """

    def __init__(self, *, width: int, patch: int, depth: int, side: int, projected: Sequence[int], channels: int):
        super().__init__()
        self.standardize = Standardize(3, IMAGENET_MEAN, IMAGENET_STD)
        self.trunk = vision_transformer(width, patch, depth, (side * patch, side * patch))
        self.patch, self.finer = patch, patch // FINER
        self.used = [block * depth // OF for block in USED]
        self.project = nn.ModuleList(nn.Conv2d(width, each, 1) for each in projected)
        self.join = nn.ModuleList(nn.Conv2d(each, channels, 3, padding=1) for each in projected)
        self.beside = nn.ModuleList(_convolutions(channels) for _ in projected[1:])
        self.fused = nn.ModuleList(_convolutions(channels) for _ in projected)
        self.last = nn.Conv2d(channels, channels, 3, padding=1)
        self.tangent = _head(channels, 2)
        self.weights = _head(channels, 9 * self.finer**2)

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 3 h w"]:
        """Unit rays, right, down and forward, of images in [0, 1] whose sides are multiples of the patch."""
        x = [
            join(F.interpolate(project(cells), scale_factor=FINER, mode="bilinear"))
            for cells, project, join in zip(self._cells(images), self.project, self.join, strict=True)
        ]
        joined = _added(self.fused[0], x[-1])
        for beside, fused, each in zip(self.beside, self.fused[1:], x[-2::-1], strict=True):
            joined = _added(fused, _added(beside, each) + joined)
        joined = F.relu(self.last(joined))
        return rays_of_tangents(upsampled(self.tangent(joined), self.weights(joined), self.finer))

    def _cells(self, images: Tensor) -> list[Tensor]:
        """Maps of the transformer's patches after the blocks that are used."""
        grid = (images.shape[-2] // self.patch, images.shape[-1] // self.patch)
        trunk, found = self.trunk, []
        patches = trunk.patch_embed.proj(self.standardize(images)).flatten(2).mT  # type: ignore[union-attr, operator]
        x = torch.cat([trunk.cls_token.expand(len(patches), -1, -1), patches], 1)  # type: ignore[operator]
        x = x + resampled_positions(trunk.pos_embed, grid)  # type: ignore[arg-type]
        for k, block in enumerate(trunk.blocks):  # type: ignore[arg-type]
            x = block(x)
            if k in self.used:
                found.append(x[:, 1:].mT.unflatten(2, grid))
        return found


def upsampled(
    cells: Float[Tensor, "b c h w"], logits: Float[Tensor, "b k h w"], factor: int
) -> Float[Tensor, "b c _h _w"]:
    """Each finer pixel as a weighted mean of the 3x3 cells about its own; beyond the border, cells are 0.

    Args:
        cells: the map.
        logits: of the weights, ``9 factor²`` channels: cell, row and column of the finer pixel.
        factor: finer pixels per cell along each side.

    >>> upsampled(torch.ones(1, 2, 3, 3), torch.zeros(1, 36, 3, 3), 2)[0, 0, 2, 2]
    tensor(1.)
    """
    b, c, h, w = cells.shape
    weights = torch.softmax(logits.reshape(b, 9, factor, factor, h, w), 1)
    near = F.unfold(cells, 3, padding=1).reshape(b, c, 9, h, w)
    fine = torch.einsum("bkrshw,bckhw->bchrws", weights, near)
    return fine.reshape(b, c, factor * h, factor * w)


def rays_of_tangents(tangents: Float[Tensor, "b 2 h w"]) -> Float[Tensor, "b 3 h w"]:
    """Unit rays at the angle ``|t|`` from the optical axis, in the direction of t.

    >>> rays_of_tangents(torch.tensor([torch.pi / 2, 0.0]).reshape(1, 2, 1, 1)).flatten().round(decimals=3)
    tensor([1., 0., -0.])
    """
    angle = torch.linalg.vector_norm(tangents, dim=1, keepdim=True)
    return torch.cat([tangents * torch.sinc(angle / torch.pi), torch.cos(angle)], 1)


def _added(layers: nn.Module, x: Tensor) -> Tensor:
    found: Tensor = layers(x) + x
    return found


def _convolutions(channels: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(channels, channels, 3, padding=1), nn.ReLU(), nn.Conv2d(channels, channels, 3, padding=1), nn.ReLU()
    )


def _head(channels: int, out: int) -> nn.Sequential:
    half = channels // 2
    return nn.Sequential(nn.Conv2d(channels, half, 3, padding=1), nn.ReLU(), nn.Conv2d(half, out, 1))
