"""Arrays of a published file, fitted to a network of ours by name and shape."""

import re
from collections.abc import Callable, Collection, Mapping
from typing import Any

import torch
from torch import Tensor


def tensors_of(content: Any) -> dict[str, Tensor] | None:
    """The arrays of a state dict, or of one within a training checkpoint; None if there are none.

    Complex, sparse and quantised ones are left out.

    >>> tensors_of({"epoch": 3, "state_dict": {"module.w": torch.zeros(1)}})
    {'w': tensor([0.])}
    """
    for key in ("state_dict", "model_state_dict", "model"):
        if isinstance(content, Mapping) and isinstance(content.get(key), Mapping):
            content = content[key]
            break
    if not isinstance(content, Mapping):
        return None
    found = {str(name): value for name, value in content.items() if isinstance(value, Tensor) and _is_plain(value)}
    return {re.sub(r"(^|\.)module\.", r"\1", name): value for name, value in found.items()} or None


def _is_plain(tensor: Tensor) -> bool:
    """Whether an array is of real numbers, all of them stored."""
    return tensor.layout is torch.strided and not tensor.is_quantized and not tensor.is_complex()


def count_of(names: Collection[str], pattern: str) -> int:
    """One more than the largest number in names that begin with this pattern, at most one for each name.

    >>> count_of(["block.0.a", "block.1.a"], r"block\\.(\\d+)\\.")
    2
    >>> count_of(["block.0.a", "block.999999.a"], r"block\\.(\\d+)\\.")  # numbers without gaps need no more
    2
    """
    found = (re.match(pattern, name) for name in names)
    return min(max((int(match[1]) + 1 for match in found if match is not None), default=0), len(names))


def number_of(names: Collection[str], pattern: str) -> int:
    """How many names have this pattern.

    >>> number_of(["block.0.a", "block.3.a", "block.3.ab"], r"block\\.\\d+\\.a")
    2
    """
    return sum(re.fullmatch(pattern, name) is not None for name in names)


def fitted_arrays(
    own: Mapping[str, Tensor],
    tensors: Mapping[str, Tensor],
    theirs: Callable[[str], str],
    *,
    unused: re.Pattern[str],
    optional: re.Pattern[str],
    adapted: Callable[[str, Tensor], Tensor] = lambda name, tensor: tensor,
) -> tuple[dict[str, Tensor], list[str]]:
    """The arrays by our names, and what is wrong with them.

    Args:
        own: our arrays; only shapes and types matter.
        tensors: those of the file.
        theirs: the file's name of one of ours.
        unused: names in the file that are not needed.
        optional: names of ours that the file may lack; they are then 0.
        adapted: converts an array, given our name; a ``ValueError`` says why it cannot.
    """
    state, missing, shapes = dict[str, Tensor](), list[str](), list[str]()
    left = {name for name in tensors if unused.search(name) is None}
    for name, wanted in own.items():
        named = theirs(name)
        left.discard(named)
        found = tensors.get(named)
        if found is None:
            if optional.search(name) is None:
                missing.append(named)
            state[name] = torch.zeros(wanted.shape, dtype=wanted.dtype)
            continue
        try:
            found = adapted(name, found)
        except ValueError as error:
            shapes.append(f"{named} ({error})")
            continue
        if [n for n in found.shape if n != 1] != [n for n in wanted.shape if n != 1]:
            shapes.append(f"{named} ({told_shape(found.shape)} instead of {told_shape(wanted.shape)})")
            continue
        state[name] = found.reshape(wanted.shape).to(wanted.dtype).contiguous()
    problems = (("lacks", missing), ("has in another shape", shapes), ("also holds", sorted(left)))
    return state, [f"it {how} {_first(names)}" for how, names in problems if names]


def told_shape(shape: torch.Size) -> str:
    """A shape in words.

    >>> told_shape(torch.Size([3, 4])), told_shape(torch.Size([]))
    ('3x4', 'a single number')
    """
    return "x".join(map(str, shape)) or "a single number"


def _first(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3:,} more" if len(names) > 3 else "")
