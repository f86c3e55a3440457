"""DINOv2's vision transformer, by timm, and the conversion of its authors' arrays.

Source: M. Oquab et al., "DINOv2: learning robust visual features without supervision", TMLR 2024; with registers
T. Darcet et al., "Vision transformers need registers", ICLR 2024.
"""

from collections.abc import Mapping
from typing import Any

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import UserError, how_to_install

#: channels of one attention head
HEAD = 64
#: arrays of gated layers (SwiGLU, as in ViT-g), by the authors and by timm
GATED = {"mlp.w12.": "mlp.fc1.", "mlp.w3.": "mlp.fc2."}


def vision_transformer(
    width: int,
    patch: int,
    depth: int,
    size: tuple[int, int],
    *,
    normed: bool = False,
    registers: int = 0,
    gated: int = 0,
) -> nn.Module:
    """A transformer as DINOv2's, with new weights and without a classifier.

    Args:
        width: channels of a token.
        patch: side of a patch in pixels.
        depth: number of blocks.
        size: of the images.
        normed: apply the norm after the last block.
        registers: number of register tokens.
        gated: rows of the first of two gated layers; 0 for ordinary ones of four times the width.

    Raises:
        UserError: timm is not installed.
    """
    try:
        from timm.layers.mlp import SwiGLUPacked
        from timm.models.vision_transformer import VisionTransformer
    except ImportError:
        raise UserError("networks with a vision transformer need the package timm", how_to_install("timm")) from None
    more: dict[str, Any] = {"reg_tokens": registers, "no_embed_class": True} if registers else {}
    if gated:
        more |= {"mlp_ratio": gated / width, "mlp_layer": SwiGLUPacked, "act_layer": nn.SiLU}
    network: nn.Module = VisionTransformer(
        img_size=size, patch_size=patch, embed_dim=width, depth=depth, num_heads=max(1, width // HEAD),
        init_values=1.0, num_classes=0, global_pool="", **more,
    )  # fmt: skip
    if not normed:
        network.norm = nn.Identity()
    return network


def with_registers_folded(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """Arrays by timm's names of a transformer with registers, if this is one: only patches have positions.

    DINOv2 adds a position to the class token as well, a constant, which becomes part of it.
    """
    found = dict(tensors)
    registers = found.pop(f"{prefix}register_tokens", None)
    if registers is not None:
        found[f"{prefix}reg_token"] = registers
        token, positions = found.get(f"{prefix}cls_token"), found.get(f"{prefix}pos_embed")
        if token is not None and positions is not None and positions.ndim == token.ndim == 3:
            found[f"{prefix}cls_token"] = token + positions[:, :1]
    return found


def resampled_positions(
    positions: Float[Tensor, "1 n d"], grid: tuple[int, int], *, registers: bool = False
) -> Float[Tensor, "1 m d"]:
    """The learnt positions of a square grid of patches, for another grid, as DINOv2 does it.

    Bicubic; without registers, 0.1 too many patches and no low-pass filter, and the class token's position is kept;
    with registers, by the number of patches and filtered, and the class token's position is left out.

    Raises:
        ValueError: these are not the positions of one token and a square of patches.
    """
    side = round(max(positions.shape[1] - 1, 0) ** 0.5)
    if positions.ndim != 3 or not side or positions.shape[1] != side * side + 1:
        raise ValueError(f"{tuple(positions.shape)} are not positions of one token and a square of patches")
    if grid == (side, side):
        return positions[:, 1:] if registers else positions
    square = positions[:, 1:].float().unflatten(1, (side, side)).permute(0, 3, 1, 2)
    if registers:
        return F.interpolate(square, size=grid, mode="bicubic", antialias=True).flatten(2).transpose(1, 2)
    factors = [(wanted + 0.1) / side for wanted in grid]
    found = F.interpolate(square, scale_factor=factors, mode="bicubic").flatten(2).transpose(1, 2)
    return torch.cat([positions[:, :1].float(), found], 1)
