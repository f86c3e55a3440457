"""The maps that the filters of a bank share, so that each is computed once."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.layers.cosfire.blur import Blur
from sextant.layers.cosfire.tuples import whole_offsets


@dataclass(frozen=True)
class Plan:
    """Which maps are needed, which of them each part uses, and at what offset.

    Args:
        channels: an index into the parts' channels for each distinct one.
        blurred: each σ with the channels (positions in ``channels``) that it blurs; maps come in this order.
        source: position of each part's map among the blurred maps.
        dx, dy: offset of each part, in whole pixels.
        parts: the parts of each form.
        forms: the forms of each filter.
        blur: the blur that the plan was made for.
    """

    channels: Int64[Tensor, "c"]
    blurred: list[tuple[float, list[int]]]
    source: list[int]
    dx: list[int]
    dy: list[int]
    parts: list[range]
    forms: list[range]
    blur: Blur

    @classmethod
    def of(
        cls,
        channels: Float[Tensor, "n p"],
        rho: Float[Tensor, "n"],
        phi: Float[Tensor, "n"],
        form: Int64[Tensor, "n"],
        filter_of_form: Int64[Tensor, "f"],
        blur: Blur,
    ) -> Self:
        """The plan for parts that belong to ``form``, of filters ``filter_of_form``; both ascend from 0."""
        rho, phi, rows = (values.detach().double().cpu() for values in (rho, phi, channels))
        # trained channels are kept apart even where they are equal, so that each has a gradient of its own
        keys = torch.arange(len(rows))[:, None] if channels.requires_grad else torch.round(rows, decimals=9)
        distinct, channel = torch.unique(keys, dim=0, return_inverse=True)
        chosen = torch.zeros(len(distinct), dtype=torch.int64).scatter_(0, channel, torch.arange(len(rows)))
        sigma = torch.round(blur.sigma0 + blur.alpha * rho, decimals=9)
        wanted, source = torch.unique(torch.stack([sigma, channel.double()], 1), dim=0, return_inverse=True)
        blurred: list[tuple[float, list[int]]] = []
        for width, which in wanted.tolist():
            if not blurred or blurred[-1][0] != width:
                blurred.append((width, []))
            blurred[-1][1].append(int(which))
        dx, dy = whole_offsets(rho, phi)
        return cls(chosen, blurred, source.tolist(), dx, dy, _runs(form.tolist()), _runs(filter_of_form.tolist()), blur)

    @cached_property
    def margin(self) -> int:
        """The largest offset of a part along an axis, in pixels."""
        return max(*map(abs, self.dx), *map(abs, self.dy))


def _runs(numbers: list[int]) -> list[range]:
    """Where each of 0, 1, 2, ... stands in an ascending list."""
    ends = [index for index in range(1, len(numbers)) if numbers[index] != numbers[index - 1]]
    return [range(*bounds) for bounds in zip([0, *ends], [*ends, len(numbers)], strict=True)]
