"""Put inhibition into a network that was built without it: what an experiment's ``inhibition`` can be."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.layers.network_stages import evaluating, first_stage_convs
from sextant.layers.push_pull import Choice, PushPullConv2d
from sextant.layers.push_pull_avg import AvgChoice, PushPullAvgConv2d
from sextant.layers.surgery import Conversion, Rule, convert, exactly, first_conv


@dataclass(frozen=True)
class NoInhibition:
    """Leaves the network as it is: the control of every inhibition experiment."""

    def __call__(self, network: nn.Module) -> nn.Module:
        """Return ``network``."""
        return network


@dataclass(frozen=True)
class PushPullInhibition:
    """Replaces convolutions of a network by push-pull layers with the same weights.

    Args:
        scale: upsampling factor h of the pull kernel, at least 1.
        alpha: inhibition strength, at least 0; with ``scale=1, alpha=1`` the layer is exactly the convolution.
        train_alpha: learn one strength a channel instead.
        where: see :func:`inhibit`.
        impl: how the pull is computed, see :func:`sextant.layers.push_pull`.
    """

    scale: float = 2.0
    alpha: float = 1.0
    train_alpha: bool = False
    where: str = "first"
    impl: Choice = "auto"

    def __call__(self, network: nn.Module) -> nn.Module:
        """Change ``network`` in place and return it; see :func:`inhibit` for the errors."""

        def layer(conv: nn.Conv2d) -> nn.Module:
            return PushPullConv2d.from_conv(
                conv, scale=self.scale, alpha=self.alpha, train_alpha=self.train_alpha, impl=self.impl
            )

        inhibit(network, self.where, layer, odd=self.scale > 1)
        return network


@dataclass(frozen=True)
class PushPullAvgInhibition:
    """Replaces convolutions of a network by the push-pull layers of 2024 with the same weights.

    Args:
        average: side of the square over which the pull is averaged; odd.
        alpha: inhibition strength, at least 0.
        train_alpha: learn one strength a channel instead.
        where: see :func:`inhibit`.
        impl: ``box`` or ``direct``.
    """

    average: int = 3
    alpha: float = 1.0
    train_alpha: bool = False
    where: str = "first"
    impl: AvgChoice = "box"

    def __call__(self, network: nn.Module) -> nn.Module:
        """Change ``network`` in place and return it; see :func:`inhibit` for the errors."""

        def layer(conv: nn.Conv2d) -> nn.Module:
            return PushPullAvgConv2d.from_conv(
                conv, average=self.average, alpha=self.alpha, train_alpha=self.train_alpha, impl=self.impl
            )

        inhibit(network, self.where, layer)
        return network


def inhibit(
    network: nn.Module, where: str, factory: Callable[[nn.Conv2d], nn.Module], *, odd: bool = False
) -> Conversion:
    """Replace convolutions of ``network`` by layers made of them, in place.

    Args:
        where: ``first``, the first convolution in registration order; ``first_block``, those of the first stage after
            the stem (:func:`sextant.layers.first_stage_convs`), the stem left alone; ``all``, every convolution; or a
            pattern of module paths as in :class:`sextant.layers.Rule`, such as ``layer1.*``. But for ``first``,
            convolutions of 1x1 pixels stay as they are: they have no pattern in space that could be inhibited.
        factory: makes the layer.
        odd: even kernels stay as they are, since they have no centre.

    Raises:
        ValueError: the network has no convolution, none after its stem, or its first one cannot be replaced.
        UserError: the pattern matches no convolution that can be replaced; it tells why, and names some that can.
    """
    path, _ = first_conv(network)
    patterns = [where]
    if where == "first":
        patterns = [exactly(path)]
    elif where == "first_block":
        patterns = [exactly(path) for path in first_stage_convs(network)]
    elif where == "all":
        patterns = ["*"]
    objection = partial(_objection, odd=odd, pointwise=where == "first")
    make: Callable[..., nn.Module] = factory
    try:
        return convert(network, [Rule(pattern, make, objection=objection) for pattern in patterns])
    except UserError as error:
        if where == "first":
            raise ValueError(error.problem) from None
        raise


def inhibited(network: nn.Module) -> list[str]:
    """Paths of the layers with inhibition."""
    layers = (PushPullConv2d, PushPullAvgConv2d)
    return [path for path, module in network.named_modules() if isinstance(module, layers)]


def implementations(network: nn.Module, image: Tensor) -> dict[str, str]:
    """How each inhibiting layer computes its pull when the network is given ``image``; for a run to record.

    The network is run once on the image, in evaluation mode and without gradients.
    """
    taken: dict[str, str] = {}

    def record(path: str) -> Callable[[nn.Module, tuple[Tensor, ...]], None]:
        def hook(layer: nn.Module, inputs: tuple[Tensor, ...]) -> None:
            assert isinstance(layer, PushPullConv2d | PushPullAvgConv2d)
            height, width = inputs[0].shape[-2:]
            taken[path] = layer.implementation(height, width)

        return hook

    hooks = [network.get_submodule(path).register_forward_pre_hook(record(path)) for path in inhibited(network)]
    try:
        with evaluating(network), torch.no_grad():
            network(image)
    finally:
        for handle in hooks:
            handle.remove()
    return taken


def _objection(module: nn.Module, *, odd: bool, pointwise: bool) -> str | None:
    assert isinstance(module, nn.Conv2d)
    if type(module) is not nn.Conv2d:
        return f"{type(module).__name__} computes more than Conv2d, which would be lost"
    if module._forward_pre_hooks or module._forward_hooks:
        return "it has hooks, such as weight normalisation, which would be lost"
    if odd and any(side % 2 == 0 for side in module.kernel_size):
        return f"push-pull with scale > 1 needs odd kernel sides, not {module.kernel_size}"
    if not pointwise and module.kernel_size == (1, 1):
        return "a 1x1 kernel has no pattern in space"
    return None
