"""Any timm network as a backbone; timm is an extra: ``pip install sextant-vision[timm]``."""

import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from sextant.errors import ArgumentError, UserError, how_to_install
from sextant.layers.network_stages import evaluating
from sextant.models.torchvision_backbone import widen_first
from sextant.models.trunk import IMAGENET_MEAN, IMAGENET_STD
from sextant.models.weights_file import load_weights


def timm_backbone(
    name: str,
    in_channels: int,
    image_size: tuple[int, int],
    num_classes: int,
    *,
    pretrained: bool = False,
    weights: str | None = None,
) -> nn.Module:
    """The timm network ``name`` with ``num_classes`` outputs and a first layer for ``in_channels``.

    Args:
        name: such as ``convnext_atto`` or ``mobilenetv3_small_100``.
        in_channels: channels of the image.
        image_size: height and width; networks of a fixed input size are built for it.
        num_classes: outputs of the last layer.
        pretrained: fetch the weights that timm has for it.
        weights: a safetensors or ``weights_only`` file of the network with timm's own classes, for colour images; the
            positions of a transformer are resampled for the image's size.

    Raises:
        UserError: timm is not installed, the network does not exist, its weights cannot be fetched, or it cannot take
            images of this size, for example as its patches need sides that are multiples of 16.

    >>> import torch
    >>> network = timm_backbone("mobilenetv3_small_050", in_channels=1, image_size=(32, 32), num_classes=7).eval()
    >>> network(torch.zeros(2, 1, 32, 32)).shape
    torch.Size([2, 7])
    """
    try:
        import timm
    except ImportError:
        raise UserError("timm networks need the package timm", how_to_install("timm")) from None
    if not timm.is_model(name):
        near = timm.list_models(f"{name[:6]}*")[:5] or timm.list_models("resnet1*")[:5]
        raise ArgumentError(f"name={name!r} is not a timm network", f"For example {', '.join(near)}")
    settings: dict[str, Any] = {} if weights is not None else {"num_classes": num_classes, "in_chans": in_channels}
    try:
        try:
            network: nn.Module = timm.create_model(name, pretrained=pretrained, img_size=image_size, **settings)
        except TypeError:  # a network for images of any size
            network = timm.create_model(name, pretrained=pretrained, **settings)
    except (OSError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise ArgumentError(f"the weights of {name} could not be fetched: {reason}", "Use pretrained=false") from None
    except (AssertionError, ValueError) as error:
        raise _cannot_take(name, image_size, error) from None
    if weights is not None:
        load_weights(network, Path(weights).expanduser(), adapt=partial(_adapted, network))
        network.reset_classifier(num_classes)  # type: ignore[operator]
        if in_channels != 3:
            widen_first(network, in_channels)
    try:
        with evaluating(network), torch.no_grad():
            network(torch.zeros(1, in_channels, *image_size))
    except (AssertionError, RuntimeError, ValueError) as error:
        raise _cannot_take(name, image_size, error) from None
    return network


def _cannot_take(name: str, image_size: tuple[int, int], error: Exception) -> ArgumentError:
    reason = " ".join(str(error).split())
    return ArgumentError(
        f"name={name} cannot take images of {image_size[0]}x{image_size[1]}: {reason}",
        "Choose a network of convolutions, such as mobilenetv3_small_100, or images of another size.",
    )


def timm_statistics(name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Mean and deviation, by colour, of the images on which timm's weights of a network were trained.

    >>> timm_statistics("vit_base_patch16_224.augreg_in21k")[0]
    (0.5, 0.5, 0.5)
    """
    import timm

    settings = timm.get_pretrained_cfg(name)
    return (IMAGENET_MEAN, IMAGENET_STD) if settings is None else (tuple(settings.mean), tuple(settings.std))


def _adapted(network: nn.Module, state: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
    """A file's weights for images of another size, or under former names, as timm adapts those that it fetches."""
    adapt = getattr(sys.modules[type(network).__module__], "checkpoint_filter_fn", None)
    return state if adapt is None else adapt(dict(state), network)
