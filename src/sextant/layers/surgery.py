"""Put inhibition into a network that was built without it, keeping its weights."""

from dataclasses import dataclass

from torch import nn

from sextant.layers.push_pull import PushPullConv2d


@dataclass(frozen=True)
class NoInhibition:
    """Leaves the network as it is: the control of every inhibition experiment."""

    def __call__(self, network: nn.Module) -> nn.Module:
        """Return ``network``."""
        return network


@dataclass(frozen=True)
class PushPullInhibition:
    """Replaces the first convolution of a network by a push-pull layer with the same weights.

    Args:
        scale: upsampling factor h of the pull kernel, at least 1.
        alpha: inhibition strength, at least 0; with ``scale=1, alpha=1`` the layer is exactly the convolution.
        train_alpha: learn one strength a channel instead.
    """

    scale: float = 2.0
    alpha: float = 1.0
    train_alpha: bool = False

    def __call__(self, network: nn.Module) -> nn.Module:
        """Change ``network`` in place and return it.

        Raises:
            ValueError: the network has no ``torch.nn.Conv2d``, or its first one has an even kernel and ``scale > 1``.
        """
        path, conv = first_conv(network)
        layer = PushPullConv2d.from_conv(conv, scale=self.scale, alpha=self.alpha, train_alpha=self.train_alpha)
        network.set_submodule(path, layer)
        return network


def first_conv(network: nn.Module) -> tuple[str, nn.Conv2d]:
    """Path and module of the first convolution, in registration order.

    Raises:
        ValueError: the network has none.
    """
    for path, module in network.named_modules():
        if path and isinstance(module, nn.Conv2d):
            return path, module
    raise ValueError(f"{type(network).__name__} has no Conv2d to put inhibition into")
