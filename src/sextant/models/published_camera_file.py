"""Reads networks for cameras from files of their authors: sizes follow from the names and shapes of the arrays.

Layouts, as the authors' repositories write them (cvg/GeoCalib, javrtg/AnyCalib; facebookresearch/dinov2 within):

========  =================================  ====================  =============================================
kind      encoder                            beside it             decoders
========  =================================  ====================  =============================================
geocalib  ``backbone.patch_embed<k>.``,      ``ll_enc.conv<k>.``   ``perspective_decoder.up_head.`` and
          ``backbone.block<k>.<n>.``                               ``perspective_decoder.latitude_head.``
anycalib  ``backbone.model.``                                      ``decoder.``, ``head.``
========  =================================  ====================  =============================================

Nothing in a file is executed. GeoCalib's own reader ignores arrays that it does not know, so they are only told here;
and it takes names with one more part after the first, such as ``backbone.<part>.patch_embed1.``, so both are read.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from torch import Tensor

from sextant.errors import ArgumentError, UserError
from sextant.models.field_net import FieldNet
from sextant.models.published_arrays import count_of, fitted_arrays, tensors_of, told_shape
from sextant.models.ray_net import RayNet
from sextant.models.weights_file import read_weights
from sextant.torch_file import require_finite

Kind = Literal["geocalib", "anycalib"]
USAGE = "Give network=geocalib:<file> or network=anycalib:<file>."
TITLES: dict[Kind, str] = {"geocalib": "GeoCalib", "anycalib": "AnyCalib"}
#: an array that only this kind has
MARKS: dict[Kind, str] = {
    "geocalib": "perspective_decoder.up_head.linear_pred_up.weight",
    "anycalib": "head.tangent_head.0.weight",
}
#: our names, and the authors'
RENAMED: dict[Kind, tuple[tuple[str, str | Callable[[re.Match[str]], str]], ...]] = {
    "geocalib": (
        (r"^encoder\.steps\.0\.", "backbone.patch_embed1.proj."),
        (r"^encoder\.steps\.(\d)\.0\.", lambda m: f"backbone.patch_embed{int(m[1]) + 1}.proj."),
        (r"^encoder\.steps\.(\d)\.1\.", lambda m: f"backbone.patch_embed{int(m[1]) + 1}.norm."),
        (r"^encoder\.norms\.(\d)\.", lambda m: f"backbone.norm{int(m[1]) + 1}."),
        (r"^encoder\.blocks\.(\d)\.", lambda m: f"backbone.block{int(m[1]) + 1}."),
        (r"\.first_norm\.", ".norm1."),
        (r"\.second_norm\.", ".norm2."),
        (r"\.first_scale$", ".layer_scale_1"),
        (r"\.second_scale$", ".layer_scale_2"),
        (r"\.attention\.before\.", ".attn.proj_1."),
        (r"\.attention\.after\.", ".attn.proj_2."),
        (r"\.attention\.near\.", ".attn.spatial_gating_unit.conv0."),
        (r"\.attention\.across\.(\d)\.", r".attn.spatial_gating_unit.conv\1_1."),
        (r"\.attention\.down\.(\d)\.", r".attn.spatial_gating_unit.conv\1_2."),
        (r"\.attention\.mix\.", ".attn.spatial_gating_unit.conv3."),
        (r"\.widen\.", ".mlp.fc1."),
        (r"\.narrow\.", ".mlp.fc2."),
        (r"(block.*)\.near\.", r"\1.mlp.dwconv.dwconv."),
        (r"^fine\.(\d)\.", lambda m: f"ll_enc.conv{int(m[1]) // 2 + 1}.conv."),
        (r"^(up|latitude)\.numbers\.", r"perspective_decoder.\1_head.linear_pred_\1."),
        (r"^(up|latitude)\.", r"perspective_decoder.\1_head.decoder."),
        (r"decoder\.before\.", "decoder.hamburger.ham_in.conv."),
        (r"decoder\.after\.", "decoder.hamburger.ham_out.conv."),
        (r"decoder\.(squeeze|align)\.", r"decoder.\1.conv."),
        (r"decoder\.smooth\.", "decoder.out_conv.conv."),
        (r"decoder\.confidence\.0\.", "decoder.linear_pred_uncertainty.0.conv."),
        (r"decoder\.confidence\.2\.", "decoder.linear_pred_uncertainty.1."),
        (r"decoder\.fine\.(\d)\.", lambda m: f"decoder.ll_fusion.resConfUnit1.conv{(int(m[1]) + 1) // 2}."),
        (r"decoder\.fused\.(\d)\.", lambda m: f"decoder.ll_fusion.resConfUnit2.conv{(int(m[1]) + 1) // 2}."),
    ),
    "anycalib": (
        (r"^trunk\.", "backbone.model."),
        (r"^project\.", "decoder.reassemble_blocks.projects."),
        (r"^join\.", "decoder.convs."),
        (r"^beside\.(\d)\.", lambda m: f"decoder.fusion_blocks.{int(m[1]) + 1}.res_conv_unit1.conv."),
        (r"^fused\.(\d)\.", r"decoder.fusion_blocks.\1.res_conv_unit2.conv."),
        (r"^last\.", "decoder.project.0."),
        (r"^tangent\.", "head.tangent_head."),
        (r"^weights\.", "head.upsampling_weights_head."),
    ),
}
#: arrays that a prediction does not need: counters, masked tokens, a norm that is not applied, ImageNet's statistics,
#: and what only the authors' training has
UNUSED = re.compile(
    r"num_batches_tracked$|mask_token$|^backbone\.model\.norm\.|^backbone\.image_(mean|std)$|^optimizer\.|^calibrator\."
)
OPTIONAL = re.compile(r"num_batches_tracked$")


@dataclass(frozen=True)
class PublishedCameraNet:
    """A network read from a file.

    Attributes:
        kind: its kind.
        network: in evaluation mode.
        unused: arrays of the file that it does not use.
    """

    kind: Kind
    network: FieldNet | RayNet
    unused: tuple[str, ...] = ()


def read_published_camera_net(kind: Kind, path: Path) -> PublishedCameraNet:
    """The network of an author's file.

    Raises:
        UserError: the file is missing, damaged or of another kind, lacks arrays, or has some of another shape or (for
            AnyCalib) beyond those of its kind; or timm is needed and not installed.
    """
    told = f"network={kind}:{path}"
    tensors = tensors_of(read_weights(path, told, USAGE))
    if tensors is None:
        raise UserError(f"{told} is not a state dict: a mapping of tensors by name is expected", USAGE)
    require_finite(tensors, path)
    shorter = {re.sub(r"^(\w+)\.\w+\.", r"\1.", name): value for name, value in tensors.items()}
    if kind == "geocalib" and MARKS[kind] not in tensors and MARKS[kind] in shorter:
        tensors = shorter
    if MARKS[kind] not in tensors:
        found = next((title for other, title in TITLES.items() if MARKS[other] in tensors), "")
        names = f"its arrays are those of {found}" if found else f"it holds {', '.join(list(tensors)[:3])}, ..."
        raise UserError(f"{told} is not a file of {TITLES[kind]}: {names}", USAGE)
    try:
        network = _sized(kind, tensors)
    except (ArgumentError, KeyError, ValueError, IndexError) as error:
        why = f"it lacks {error.args[0]}" if isinstance(error, KeyError) else str(error)
        raise _unfit(kind, told, why) from None
    known = {theirs(kind, name) for name in network.state_dict()}
    unused = tuple(name for name in tensors if name not in known and UNUSED.search(name) is None)
    if kind == "geocalib":
        tensors = {name: value for name, value in tensors.items() if name in known}
    state, problems = fitted_arrays(
        network.state_dict(), tensors, lambda name: theirs(kind, name), unused=UNUSED, optional=OPTIONAL
    )
    if problems:
        raise _unfit(kind, told, "; ".join(problems))
    network.load_state_dict(state)
    return PublishedCameraNet(kind, network.eval(), unused)


def theirs(kind: Kind, name: str) -> str:
    """The authors' name of one of our arrays.

    >>> theirs("geocalib", "encoder.blocks.2.4.attention.across.1.weight")
    'backbone.block3.4.attn.spatial_gating_unit.conv1_1.weight'
    """
    for pattern, replacement in RENAMED[kind]:
        name = re.sub(pattern, replacement, name)
    return name


def _sized(kind: Kind, tensors: Mapping[str, Tensor]) -> FieldNet | RayNet:
    """A network of the sizes of these arrays, with new weights."""
    if kind == "geocalib":
        widths = [_shape(tensors, f"backbone.norm{k}.weight", 1)[0] for k in range(1, 5)]
        depths = [count_of(tensors, rf"backbone\.block{k}\.(\d+)\.") for k in range(1, 5)]
        hidden = [_shape(tensors, f"backbone.block{k}.0.mlp.fc1.weight", 4)[0] for k in range(1, 5)]
        fine, ham = (
            _shape(tensors, name, 4)[0]
            for name in ("ll_enc.conv1.conv.weight", "perspective_decoder.up_head.decoder.squeeze.conv.weight")
        )
        return FieldNet(widths, depths, hidden, ham, fine)
    prefix = "backbone.model."
    width, _, patch, _ = _shape(tensors, f"{prefix}patch_embed.proj.weight", 4)
    side = max(1, round(max(_shape(tensors, f"{prefix}pos_embed", 3)[1] - 1, 0) ** 0.5))
    projected = [_shape(tensors, f"decoder.reassemble_blocks.projects.{k}.bias", 1)[0] for k in range(4)]
    channels = _shape(tensors, "decoder.project.0.bias", 1)[0]
    depth = count_of(tensors, re.escape(prefix) + r"blocks\.(\d+)\.")
    return RayNet(width=width, patch=patch, depth=depth, side=side, projected=projected, channels=channels)


def _shape(tensors: Mapping[str, Tensor], name: str, axes: int) -> tuple[int, ...]:
    found = tensors[name]
    if found.ndim != axes:
        raise ValueError(f"it has in another shape {name} ({told_shape(found.shape)} instead of {axes} axes)")
    return tuple(found.shape)


def _unfit(kind: Kind, told: str, how: str) -> UserError:
    return UserError(
        f"{told} looks like {TITLES[kind]} by {MARKS[kind]}, but does not fit it: {how}",
        "Copy the file again, or give one of the authors' files.",
    )
