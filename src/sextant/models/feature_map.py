"""The feature map within a classification network, before its pooling and classifier.

The network runs unchanged, by its own code, up to the requested layer. Layers that are not reached are dropped, so that
they neither take memory nor appear among the trained weights.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.layers.network_stages import evaluating

#: where transformers of timm keep their tokens, normalised; they have a ``num_prefix_tokens``
TOKENS = "norm"
#: where networks keep their last map: torchvision's and timm's ResNets, then most others
USUAL = ("layer4", "layer3", "features", "stages", "blocks", "layers", "norm")


class _ReachedError(Exception):
    def __init__(self, features: Tensor):
        self.features = features


class FeatureMap(nn.Module):
    """The output ``(b, c, h, w)`` of one layer of a network.

    The tokens of timm's transformers and mixers, ``(b, prefix + h w, c)`` or ``(b, h, w, c)``, become such a map too;
    class and register tokens, which come first, are left out.

    Args:
        network: maps images to anything; its layers after ``layer`` are dropped, in place.
        in_channels: channels of the images.
        image_size: height and width of the images.
        layer: path of the layer, such as ``layer4`` or ``features.9``; None takes the first of the usual ones, and of
            a network of tokens the last norm.

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
            usual = (TOKENS, *USUAL) if hasattr(network, "num_prefix_tokens") else USUAL
            lists = {name for name, module in modules.items() if isinstance(module, nn.ModuleList)}  # never run as such
            layer = next((name for name in usual if name in modules and name not in lists), None)
            if layer is None:
                raise UserError(
                    f"{type(network).__name__} has no layer named any of {', '.join(USUAL)}",
                    f"Name the layer to use, one of {children} or within one.",
                )
        if layer not in modules or layer == "":
            raise UserError(f"layer={layer!r} is not a layer of {type(network).__name__}", f"Choose among {children}")
        self.network, self.layer = network, layer
        # of timm: Swin transformers keep channels last
        self.channels_last = getattr(network, "output_fmt", "NCHW") == "NHWC"
        self.tokens: tuple[int, tuple[int, int]] | None = None  # those before the map's, and the size of the map
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
        if features.ndim == 3 and (found := _tokens(network, features.shape[1], image_size)) is not None:
            self.tokens = found
            features = self._as_map(features)
        if features.ndim != 4:
            raise UserError(
                f"layer={layer!r} of {type(network).__name__} gives {tuple(features.shape)}, not (b, c, h, w)",
                "Choose an earlier layer, or a network of convolutions, such as mobilenetv3_small_100.",
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
            return self._as_map(reached.features)
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
        return self._as_map(kept[0])

    def _as_map(self, x: Tensor) -> Tensor:
        """Tokens as a map; a map as it is."""
        if x.ndim == 4 and self.channels_last:
            return x.permute(0, 3, 1, 2)
        if self.tokens is None:
            return x
        before, grid = self.tokens
        found: Tensor = x[:, before:].transpose(1, 2).unflatten(2, grid)
        return found


def _stop(module: nn.Module, inputs: object, output: Tensor) -> None:
    raise _ReachedError(output)


def _tokens(network: nn.Module, count: int, image_size: tuple[int, int]) -> tuple[int, tuple[int, int]] | None:
    """How many of ``count`` tokens come before those of the map, and its size, in the proportions of the image.

    >>> _tokens(nn.Identity(), 1 + 4 * 6, (64, 96))
    (1, (4, 6))
    """
    if count < 4:
        return None
    told = getattr(network, "num_prefix_tokens", None)
    for before in (0, 1) if told is None else (int(told),):
        rows = round(((count - before) * image_size[0] / image_size[1]) ** 0.5)
        columns = (count - before) // max(rows, 1)
        if rows * columns == count - before and round(rows * image_size[1] / image_size[0]) == columns:
            return before, (rows, columns)
    return None


def _drop(network: nn.Module, layer: str, reached: set[nn.Module]) -> None:
    """Replace by identities the modules beside the layer, or beside those that hold it, that were not reached.

    Those without weights stay: a transformer's rotary positions are computed without a call that could be seen.
    """
    parts = layer.split(".")
    for depth in range(len(parts)):
        outer = network.get_submodule(".".join(parts[:depth]))
        for name, module in list(outer.named_children()):
            if not any(inner in reached for inner in module.modules()) and module.state_dict():
                setattr(outer, name, nn.Identity())
