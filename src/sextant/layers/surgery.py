"""Replace layers of a network that was built without them, keeping its weights."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from torch import nn

from sextant.errors import UserError


@dataclass(frozen=True)
class Rule:
    """Which modules to replace, and by what.

    >>> rule = Rule("layer1.*", lambda old: nn.Identity(), nn.ReLU)
    >>> rule.matches(nn.ReLU(), ["layer1.0.relu"]), rule.matches(nn.ReLU(), ["layer2.0.relu"])
    (True, False)

    Args:
        pattern: shell-style pattern of module paths such as ``layer1.0.conv1``: ``*`` matches anything, dots included,
            ``?`` one character, ``[0-3]`` one of a range.
        kind: only modules of this class match.
        factory: makes the new module from the old one, whose parameters it may share or which it may wrap.
        objection: gives the reason why a matching module must be kept; None if there is none.
    """

    pattern: str
    factory: Callable[..., nn.Module]
    kind: type[nn.Module] = nn.Conv2d
    objection: Callable[[nn.Module], str | None] = lambda module: None

    def matches(self, module: nn.Module, paths: Iterable[str]) -> bool:
        """Whether ``module`` is of the kind and one of its ``paths`` fits the pattern."""
        return isinstance(module, self.kind) and any(fnmatchcase(path, self.pattern) for path in paths)


@dataclass(frozen=True)
class Conversion:
    """The result of :func:`convert`.

    Args:
        changed: paths whose module was replaced, in registration order; a shared module is listed at each of its paths.
        skipped: paths that match a pattern but are kept, with the reason.
    """

    changed: tuple[str, ...]
    skipped: dict[str, str]


def convert(network: nn.Module, rules: Iterable[Rule]) -> Conversion:
    """Replace modules of ``network``, in place.

    Each module follows the first rule that matches one of its paths and has no objection. A module that is used in
    several places is replaced by one new module in all of them. The submodules of a replaced module are left alone. The
    network itself cannot be replaced.

    >>> network = nn.Sequential(nn.Conv2d(3, 8, 3), nn.ReLU(), nn.Flatten())
    >>> conversion = convert(network, [Rule("1", lambda old: nn.GELU(), nn.ReLU)])
    >>> network[1]
    GELU(approximate='none')

    Raises:
        UserError: no module matches the pattern of a rule, or there are objections to all that do. The network is then
            unchanged.
    """
    rules = list(rules)
    paths: dict[nn.Module, list[str]] = {}
    for path, module in network.named_modules(remove_duplicate=False):
        if path:
            paths.setdefault(module, []).append(path)
    chosen: dict[nn.Module, Rule] = {}
    skipped: dict[str, str] = {}
    for rule in rules:
        objections: dict[str, str] = {}
        matching = [module for module, at in paths.items() if rule.matches(module, at)]
        for module in matching:
            reason = rule.objection(module)
            if reason is None:
                chosen.setdefault(module, rule)
            else:
                objections |= dict.fromkeys(paths[module], reason)
        if len(objections) == sum(len(paths[module]) for module in matching):
            raise _nothing_matches(network, rule, objections)
        skipped |= objections
    outermost = {path for module in chosen for path in paths[module]}
    chosen = {m: rule for m, rule in chosen.items() if not any(_within(path, outermost) for path in paths[m])}
    changed = {path for module in chosen for path in paths[module]}
    for module, rule in chosen.items():
        replacement = rule.factory(module)
        for path in paths[module]:
            network.set_submodule(path, replacement)
    order = [path for at in paths.values() for path in at if path in changed]
    return Conversion(tuple(order), {path: why for path, why in skipped.items() if path not in changed})


def first_conv(network: nn.Module) -> tuple[str, nn.Conv2d]:
    """Path and module of the first convolution, in registration order.

    >>> first_conv(nn.Sequential(nn.Identity(), nn.Conv2d(3, 8, 3)))[0]
    '1'

    Raises:
        ValueError: the network has none.
    """
    for path, module in network.named_modules():
        if path and isinstance(module, nn.Conv2d):
            return path, module
    raise ValueError(f"{type(network).__name__} has no Conv2d to put inhibition into")


def exactly(path: str) -> str:
    """The pattern that matches this path alone."""
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in path)


def candidates(
    network: nn.Module,
    kind: type[nn.Module] = nn.Conv2d,
    objection: Callable[[nn.Module], str | None] = lambda module: None,
) -> list[str]:
    """Paths of the modules within ``network`` that can be replaced: those of the class without an objection."""
    there = network.named_modules(remove_duplicate=False)
    return [path for path, module in there if path and isinstance(module, kind) and objection(module) is None]


def some(names: Sequence[str], most: int = 8) -> str:
    """The names, or the first of them and how many there are."""
    listed = ", ".join(names[:most])
    return f"{listed}, ... ({len(names)} in all)" if len(names) > most else listed


def _within(path: str, outer: set[str]) -> bool:
    parts = path.split(".")
    return any(".".join(parts[:n]) in outer for n in range(1, len(parts)))


def _nothing_matches(network: nn.Module, rule: Rule, objections: dict[str, str]) -> UserError:
    name, kind_name = type(network).__name__, rule.kind.__name__
    if objections:
        told = "; ".join(f"{path}: {reason}" for path, reason in list(objections.items())[:3])
        problem = f"the pattern {rule.pattern!r} matches no {kind_name} of {name} that can be replaced ({told})"
    else:
        problem = f"the pattern {rule.pattern!r} matches no {kind_name} of {name}"
    possible = candidates(network, rule.kind, rule.objection)
    if not possible:
        return UserError(problem, f"It has no {kind_name} that can be replaced: choose another network.")
    return UserError(problem, f"Choose among {some(possible)}; * stands for anything, dots included.")
