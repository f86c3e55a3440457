"""Put inhibition into a network that was built without it: the choices for an experiment's ``inhibition``."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import torch
from annotated_types import Ge, Le
from torch import Tensor, nn

from sextant.layers.network_stages import evaluating, first_stage_convs
from sextant.layers.push_pull import Choice, PushPullConv2d
from sextant.layers.push_pull_avg import AvgChoice, PushPullAvgConv2d
from sextant.layers.surgery import Conversion, Rule, candidates, convert, exactly, first_conv, some
from sextant.ranges import NonNegative, checked

EVEN = "push-pull with scale > 1 needs odd kernel sides"
KEPT = "_convolutions_without_inhibition"  # attribute of a network: the convolutions that inhibit kept
#: attributes in which a module keeps hooks, which a replacement would lose, and the names of the hooks
HOOKS = {
    "_forward_pre_hooks": "forward pre",
    "_forward_hooks": "forward",
    "_backward_pre_hooks": "full backward pre",
    "_backward_hooks": "full backward",
    "_state_dict_hooks": "state dict",
    "_state_dict_pre_hooks": "state dict pre",
    "_load_state_dict_pre_hooks": "load state dict pre",
    "_load_state_dict_post_hooks": "load state dict post",
}


@dataclass(frozen=True)
class NoInhibition:
    """Leaves the network unchanged: the control of every inhibition experiment.

    >>> network = nn.Sequential(nn.Conv2d(1, 4, 3))
    >>> NoInhibition()(network) is network
    True
    """

    def __call__(self, network: nn.Module) -> nn.Module:
        """Return ``network``."""
        return network


@checked
@dataclass(frozen=True)
class PushPullInhibition:
    """Replaces convolutions of a network by push-pull layers with the same weights.

    >>> network = nn.Sequential(nn.Conv2d(1, 4, 3), nn.ReLU(), nn.Conv2d(4, 4, 3))
    >>> inhibited(PushPullInhibition(where="all")(network))
    ['0', '2']

    Args:
        scale: upsampling factor h of the pull kernel, at least 1.
        alpha: inhibition strength, at least 0; with ``scale=1, alpha=1`` the layer is exactly the convolution.
        train_alpha: learn one strength per channel instead.
        where: see :func:`inhibit`.
        impl: how the pull is computed, see :func:`sextant.layers.push_pull`.
    """

    scale: Annotated[float, Ge(1), Le(8)] = 2.0
    alpha: NonNegative = 1.0
    train_alpha: bool = False
    where: str | Sequence[str] = "first"
    impl: Choice = "auto"

    def __call__(self, network: nn.Module) -> nn.Module:
        """Change ``network`` in place and return it; :func:`skipped` lists what stayed; raises as :func:`inhibit`."""
        layer = partial(
            PushPullConv2d.from_conv, scale=self.scale, alpha=self.alpha, train_alpha=self.train_alpha, impl=self.impl
        )
        inhibit(network, self.where, layer, odd=self.scale > 1)
        return network


@checked
@dataclass(frozen=True)
class PushPullAvgInhibition:
    """Replaces convolutions of a network by the push-pull layers of 2024 with the same weights.

    >>> network = nn.Sequential(nn.Conv2d(1, 4, 3), nn.ReLU(), nn.Conv2d(4, 4, 3))
    >>> PushPullAvgInhibition(average=5)(network)[0]
    PushPullAvgConv2d(1, 4, kernel_size=(3, 3), stride=(1, 1), average=5, alpha=1.0)

    Args:
        average: side of the square over which the pull is averaged; odd.
        alpha: inhibition strength, at least 0.
        train_alpha: learn one strength per channel instead.
        where: see :func:`inhibit`.
        impl: ``box`` or ``direct``.
    """

    average: Annotated[int, Ge(1), Le(31)] = 3
    alpha: NonNegative = 1.0
    train_alpha: bool = False
    where: str | Sequence[str] = "first"
    impl: AvgChoice = "box"

    def __call__(self, network: nn.Module) -> nn.Module:
        """Change ``network`` in place and return it; :func:`skipped` lists what stayed; raises as :func:`inhibit`."""
        layer = partial(
            PushPullAvgConv2d.from_conv,
            average=self.average,
            alpha=self.alpha,
            train_alpha=self.train_alpha,
            impl=self.impl,
        )
        inhibit(network, self.where, layer)
        return network


def inhibit(
    network: nn.Module, where: str | Sequence[str], factory: Callable[[nn.Conv2d], nn.Module], *, odd: bool = False
) -> Conversion:
    """Replace convolutions of ``network`` by layers made from them, in place.

    >>> network = nn.Sequential(nn.Conv2d(3, 8, 3), nn.ReLU())
    >>> conversion = inhibit(network, "first", PushPullConv2d.from_conv)
    >>> inhibited(network)
    ['0']

    Args:
        where: ``first``, the first convolution in registration order; ``first_block``, those of the first stage after
            the stem (:func:`sextant.layers.first_stage_convs`), but not the stem; ``all``, every convolution; or one or
            several patterns of module paths as in :class:`sextant.layers.Rule`, such as ``layer1.*``. Except with
            ``first``, 1x1 convolutions are kept: they have no spatial pattern to inhibit.
        factory: makes the layer from a convolution.
        odd: keep even kernels, since they have no centre.

    Raises:
        ValueError: the network has no convolution, none after its stem, or its first one cannot be replaced; or
            ``where`` is neither a string nor several.
        UserError: a pattern matches no convolution that can be replaced; the message says why, and names some that can.
    """
    objection = partial(_objection, odd=odd)
    path, conv = first_conv(network)
    if where == "first":
        _require_first(network, path, objection(conv), partial(objection, pointwise=False))
    else:
        objection = partial(objection, pointwise=False)
    make: Callable[..., nn.Module] = factory
    rules = [Rule(pattern, make, objection=objection) for pattern in _patterns(network, where, path)]
    conversion = convert(network, rules)
    network.__dict__[KEPT] = network.__dict__.get(KEPT, {}) | conversion.skipped
    return conversion


def skipped(network: nn.Module) -> dict[str, str]:
    """Paths of the convolutions that were selected for :func:`inhibit` but kept, with the reason.

    >>> network = PushPullInhibition(where="all")(nn.Sequential(nn.Conv2d(1, 4, 3), nn.Conv2d(4, 4, 1)))
    >>> inhibited(network), skipped(network)
    (['0'], {'1': 'a 1x1 kernel has no pattern in space'})
    """
    told: dict[str, str] = network.__dict__.get(KEPT, {})
    later = set(inhibited(network))
    return {path: reason for path, reason in told.items() if path not in later}


def inhibited(network: nn.Module) -> list[str]:
    """Paths of the layers with inhibition.

    >>> inhibited(nn.Sequential(PushPullConv2d(1, 4, 3), nn.Conv2d(4, 4, 3)))
    ['0']
    """
    layers = (PushPullConv2d, PushPullAvgConv2d)
    return [path for path, module in network.named_modules() if isinstance(module, layers)]


def implementations(network: nn.Module, image: Tensor) -> dict[str, str]:
    """How each layer with inhibition computes its pull for ``image``, for a run to record.

    The network is run once on the image, in evaluation mode and without gradients.

    >>> sorted(implementations(nn.Sequential(PushPullConv2d(1, 4, 3)), torch.rand(1, 1, 28, 28)))
    ['0']
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


def _patterns(network: nn.Module, where: str | Sequence[str], first: str) -> list[str]:
    if not isinstance(where, str):
        if not isinstance(where, Sequence) or not where or not all(isinstance(pattern, str) for pattern in where):
            raise ValueError(f"where must be first, first_block, all, a pattern of paths or several, not {where!r}")
        return [pattern for one in where for pattern in _patterns(network, one, first)]
    if where == "first_block":
        return [exactly(path) for path in first_stage_convs(network)]
    return {"first": [exactly(first)], "all": ["*"]}.get(where, [where])


def _require_first(
    network: nn.Module, path: str, reason: str | None, objection: Callable[[nn.Module], str | None]
) -> None:
    """Raise a ``ValueError`` with alternatives if the first convolution cannot be replaced."""
    if reason is None:
        return
    possible = candidates(network, objection=objection)
    ways = [f"where={exactly(possible[0])!r}, or another of {some(possible)}"] if possible else []
    ways += ["PushPullAvgInhibition, which also accepts even kernels"] if reason.startswith(EVEN) else []
    advice = f"Alternatives: {'; '.join(ways)}" if ways else "It has no convolution that can be replaced"
    raise ValueError(
        f"the first convolution of {type(network).__name__}, {path}, cannot be replaced: {reason}. {advice}"
    )


def _objection(module: nn.Module, *, odd: bool, pointwise: bool = True) -> str | None:
    assert isinstance(module, nn.Conv2d)
    if type(module) is not nn.Conv2d:
        return f"{type(module).__name__} computes more than Conv2d, which would be lost"
    if "weight" not in module._parameters:  # weight or spectral normalisation, or pruning, of torch.nn.utils
        by = next((type(hook).__name__ for hook in module._forward_pre_hooks.values()), "something else")
        return f"{by} computes its weight anew each time, which would be lost"
    hook = next((name for kind, name in HOOKS.items() if getattr(module, kind)), None)
    if hook is not None:
        return f"it has a {hook} hook, which would be lost: remove it, and register it on the new layer"
    if odd and any(side % 2 == 0 for side in module.kernel_size):
        return f"{EVEN}, not {module.kernel_size}"
    if not pointwise and module.kernel_size == (1, 1):
        return "a 1x1 kernel has no pattern in space"
    return None
