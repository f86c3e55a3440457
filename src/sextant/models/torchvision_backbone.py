"""Any torchvision classification network as a backbone."""

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

from torch import nn

from sextant.errors import ArgumentError, UserError
from sextant.models.weights_file import load_weights


def torchvision_backbone(
    name: str, in_channels: int, image_size: tuple[int, int], num_classes: int, *, weights: str | None = None
) -> nn.Module:
    """The torchvision network ``name`` with ``num_classes`` outputs and a first layer for ``in_channels``.

    Filters of the first layer for further channels start at zero, so that pretrained features are kept. A grey image is
    seen by pretrained filters as an image of three equal colours.

    Args:
        name: such as ``resnet18``, ``mobilenet_v3_small`` or ``densenet161``.
        in_channels: channels of the image: 1 for grey; otherwise the first three are its colours.
        image_size: not used: these networks pool over maps of any size.
        num_classes: outputs of the last layer.
        weights: None, ``imagenet`` (torchvision fetches them), or a safetensors or ``weights_only`` file.

    Raises:
        UserError: the network does not exist, or the weights are not available or do not fit.

    >>> import torch
    >>> network = torchvision_backbone("mobilenet_v3_small", in_channels=1, image_size=(32, 32), num_classes=7).eval()
    >>> network(torch.zeros(2, 1, 32, 32)).shape
    torch.Size([2, 7])
    """
    network = torchvision_classifier(name, weights)
    _replace_last(network, num_classes)
    if in_channels != 3:
        widen_first(network, in_channels, trained=weights is not None)
    return network


def torchvision_classifier(name: str, weights: str | None = None) -> nn.Module:
    """The torchvision network ``name`` as it is, for colour images, with its own classes.

    Args:
        name: such as ``alexnet``.
        weights: None, ``imagenet`` (torchvision fetches them), or a safetensors or ``weights_only`` file.

    Raises:
        UserError: the network does not exist, or the weights are not available or do not fit.
    """
    from torchvision import models

    if name not in models.list_models(models):
        near = [other for other in models.list_models(models) if other.startswith(name[:4])]
        raise ArgumentError(f"name={name!r} is not a torchvision network", f"For example {', '.join(near[:5])}")
    try:
        network: nn.Module = models.get_model(name, weights="DEFAULT" if weights == "imagenet" else None)
    except OSError as error:
        raise ArgumentError(
            f"the ImageNet weights of {name} could not be fetched: {error}",
            "Use weights=null, or the path of a file of weights.",
        ) from None
    if weights not in (None, "imagenet"):
        load_weights(network, Path(str(weights)).expanduser())
    return network


def resnet_stages(blocks: Sequence[int], *, bottleneck: bool) -> nn.Sequential:
    """The stem and the first stages of a ResNet, by torchvision's names, with new weights.

    Args:
        blocks: number of blocks of each stage.
        bottleneck: blocks of three convolutions, not of two.

    >>> [name for name, _ in resnet_stages([1, 1], bottleneck=False).named_children()]
    ['conv1', 'bn1', 'relu', 'maxpool', 'layer1', 'layer2']
    """
    from torchvision.models.resnet import BasicBlock, Bottleneck, ResNet

    whole = ResNet(Bottleneck if bottleneck else BasicBlock, [*blocks, 1, 1, 1, 1][:4])
    names = ["conv1", "bn1", "relu", "maxpool", *(f"layer{k + 1}" for k in range(len(blocks)))]
    return nn.Sequential(OrderedDict((name, getattr(whole, name)) for name in names))


def vgg16_map() -> nn.Sequential:
    """The convolutions of VGG-16 without the last activation and pooling, with new weights."""
    from torchvision.models.vgg import cfgs, make_layers

    layers: nn.Sequential = make_layers(cfgs["D"])
    return layers[:-2]


def _named_last(network: nn.Module, kind: type[nn.Module]) -> tuple[str, nn.Module]:
    return [(name, module) for name, module in network.named_modules() if isinstance(module, kind)][-1]


def _replace(network: nn.Module, name: str, module: nn.Module) -> None:
    parent, _, last = name.rpartition(".")
    setattr(network.get_submodule(parent) if parent else network, last, module)


def _replace_last(network: nn.Module, num_classes: int) -> None:
    if not any(isinstance(module, nn.Linear) for module in network.modules()):
        raise UserError(
            f"{type(network).__name__} does not end in a linear layer that could be replaced for other classes",
            "Choose another network, for example resnet18 or mobilenet_v3_small.",
        )
    name, last = _named_last(network, nn.Linear)
    assert isinstance(last, nn.Linear)
    _replace(network, name, nn.Linear(last.in_features, num_classes))


def widen_first(network: nn.Module, in_channels: int, *, trained: bool = True) -> None:
    """Change the first convolution's input channels, in place; filters of those after the colours start at zero.

    Trained filters for a single channel are the sums over the colours; random ones keep the spread of their draw.
    """
    first = next(module for module in network.modules() if isinstance(module, nn.Conv2d))
    wide = first.weight.new_zeros(first.out_channels, in_channels, *first.kernel_size)
    shared = min(3, in_channels)
    colours = first.weight.detach()
    wide[:, :shared] = colours.sum(1, keepdim=True) if trained and in_channels == 1 else colours[:, :shared]
    first.weight, first.in_channels = nn.Parameter(wide), in_channels
