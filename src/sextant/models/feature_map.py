"""The feature map within a classification network, before its pooling and classifier.

The network runs unchanged, by its own code, up to the requested layer. Layers that are not reached are dropped, so that
they neither take memory nor appear among the trained weights.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.layers.network_stages import evaluating

#: where networks keep their last map: torchvision's and timm's ResNets, then most others
USUAL = ("layer4", "layer3", "features", "stages", "blocks")


class _ReachedError(Exception):
    def __init__(self, features: Tensor):
        self.features = features


class FeatureMap(nn.Module):
    """The output ``(b, c, h, w)`` of one layer of a network.

    Args:
        network: maps images to anything; its layers after ``layer`` are dropped, in place.
        in_channels: channels of the images.
        image_size: height and width of the images.
        layer: path of the layer, such as ``layer4`` or ``features.9``; None takes the first of the usual ones.

    Attributes:
        channels: c.
        size: h and w for images of ``image_size``.

    Raises:
        UserError: the layer does not exist or gives no map with height and width, or the images are too small for it.

    Example:
        >>> from sextant.models import ResNetCifar
        >>> features = FeatureMap(ResNetCifar(3, (32, 32), 10, depth=20), 3, (32, 32), layer="layer2")
        >>> features.channels, features.size
        (32, (16, 16))
    """

    def __init__(self, network: nn.Module, in_channels: int, image_size: tuple[int, int], *, layer: str | None = None):
        super().__init__()
        modules = dict(network.named_modules())
        children = ", ".join(name for name, _ in network.named_children())
        if layer is None:
            layer = next((name for name in USUAL if name in modules), None)
            if layer is None:
                raise UserError(
                    f"{type(network).__name__} has no layer named any of {', '.join(USUAL)}",
                    f"Name the layer to use, one of {children} or within one. A vision transformer has no map with "
                    "height and width: choose a network of convolutions.",
                )
        if layer not in modules or layer == "":
            raise UserError(f"layer={layer!r} is not a layer of {type(network).__name__}", f"Choose among {children}")
        self.network, self.layer = network, layer
        reached: set[nn.Module] = set()
        hooks = [
            module.register_forward_pre_hook(lambda module, inputs: reached.add(module)) for module in modules.values()
        ]
        try:
            with evaluating(network), torch.no_grad():
                features = self._run(torch.zeros(1, in_channels, *image_size))
        except (AssertionError, RuntimeError) as error:
            raise UserError(
                f"{type(network).__name__} cannot take images of {image_size[0]}x{image_size[1]} to {layer!r}: {error}",
                "Choose larger images, or an earlier layer.",
            ) from None
        finally:
            for hook in hooks:
                hook.remove()
        last = getattr(network, "output_fmt", "NCHW")  # of timm: Swin transformers keep channels last
        if features.ndim != 4 or last != "NCHW":
            raise UserError(
                f"layer={layer!r} of {type(network).__name__} gives {tuple(features.shape)}, not (b, c, h, w)",
                "A vision transformer has no map with height and width: choose a network of convolutions, such as "
                "mobilenetv3_small_100, or an earlier layer.",
            )
        _drop(network, layer, reached)
        self.channels = features.shape[1]
        self.size = (features.shape[2], features.shape[3])

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h2 w2"]:
        """The layer's output."""
        return self._run(x)

    def _run(self, x: Tensor) -> Tensor:
        if torch.compiler.is_exporting():
            return self._kept_on_the_way(x)
        # registered for each run: a hook that stayed would keep the layer from being replaced by one with inhibition
        hook = self.network.get_submodule(self.layer).register_forward_hook(_stop)
        try:
            self.network(x)
        except _ReachedError as reached:
            return reached.features
        finally:
            hook.remove()
        raise UserError(f"layer={self.layer!r} is not used by {type(self.network).__name__}", "Choose another layer.")

    def _kept_on_the_way(self, x: Tensor) -> Tensor:
        """The same for tracers, which do not follow exceptions: the whole network runs, and the rest is discarded."""
        kept: list[Tensor] = []
        layer = self.network.get_submodule(self.layer)
        hook = layer.register_forward_hook(lambda module, inputs, output: kept.append(output))
        try:
            self.network(x)
        finally:
            hook.remove()
        return kept[0]


def _stop(module: nn.Module, inputs: object, output: Tensor) -> None:
    raise _ReachedError(output)


def _drop(network: nn.Module, layer: str, reached: set[nn.Module]) -> None:
    """Replace by identities the modules beside the layer, or beside those that hold it, that were not reached."""
    parts = layer.split(".")
    for depth in range(len(parts)):
        outer = network.get_submodule(".".join(parts[:depth]))
        for name, module in list(outer.named_children()):
            if not any(inner in reached for inner in module.modules()):
                setattr(outer, name, nn.Identity())
