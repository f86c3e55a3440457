"""Fine-tuning of a pretrained network: layers that are frozen, and layers that learn more slowly."""

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

from torch import nn

FACTOR = "learning_rate_factor"


def freeze(network: nn.Module, paths: Sequence[str]) -> None:
    """Freeze some modules of a network: their weights and their batch statistics.

    Args:
        network: changed in place; each time it runs, the modules are put in evaluation mode.
        paths: paths of the modules, such as ``stem`` or ``layer1.0``.
    """
    for path in paths:
        network.get_submodule(path).requires_grad_(False)
    if paths:
        network.register_forward_pre_hook(partial(_keep_evaluating, tuple(paths)))


def set_rate_factors(network: nn.Module, paths: Sequence[str], decay: float) -> None:
    """Lower the learning rates of modules, the more the nearer they are to the image.

    Args:
        network: the network whose parameters are marked, in place.
        paths: paths of its modules in the order in which they run; the last learns at ``decay`` times the full rate,
            the one before it at ``decay^2`` times, and so on. All others learn at the full rate.
        decay: above 0 and at most 1, at which all have the same rate.
    """
    if decay < 1:
        for power, path in enumerate(reversed(paths), start=1):
            for parameter in network.get_submodule(path).parameters():
                setattr(parameter, FACTOR, decay**power)


def parameter_groups(parameters: Iterable[nn.Parameter], rate: float) -> list[dict[str, Any]]:
    """Parameter groups for an optimiser, one for each learning rate, the full rate first.

    Args:
        parameters: the parameters of a module.
        rate: the full learning rate, of those that were not marked by :func:`set_rate_factors`.
    """
    groups: dict[float, list[nn.Parameter]] = {1.0: []}
    for parameter in parameters:
        groups.setdefault(getattr(parameter, FACTOR, 1.0), []).append(parameter)
    return [{"params": found, "lr": rate * factor} for factor, found in sorted(groups.items(), reverse=True) if found]


def _keep_evaluating(paths: Sequence[str], network: nn.Module, inputs: Any) -> None:
    for path in paths:
        network.get_submodule(path).eval()
