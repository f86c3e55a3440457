"""The parts of filters as arrays of a module, which grow and shrink and are restored from a state dict."""

from collections.abc import Callable, Mapping
from typing import Any, Self

import torch
from torch import Tensor, nn

from sextant.layers.cosfire.plan import Plan
from sextant.layers.cosfire.tuples import Tuples, part_weights, shares

#: arrays over the parts of all forms of all filters, one after the other
PARTS = ("channels", "rho", "phi", "weights", "form")
#: what a state dict holds of the filters
ARRAYS = (*PARTS, "filter_of_form")


class FilterParts(nn.Module):
    """Filters, each of several forms (the filter under one move), each of several parts.

    Args:
        numbers: how many numbers name a channel.

    Attributes:
        channels, rho, phi, weights: those of the parts of all filters, one after the other. They stay in float64 when
            the layer is moved to another dtype: they are not activations, and half precision would move parts.
        form: the number of the form (a filter under one move) that each part belongs to.
        filter_of_form: the number of the filter that each form belongs to.
    """

    channels: Tensor
    rho: Tensor
    phi: Tensor
    weights: Tensor
    form: Tensor
    filter_of_form: Tensor

    def __init__(self, numbers: int):
        super().__init__()
        for name in ("rho", "phi", "weights"):
            self.register_buffer(name, torch.zeros(0, dtype=torch.float64))
        self.register_buffer("channels", torch.zeros(0, numbers, dtype=torch.float64))
        self.register_buffer("form", torch.zeros(0, dtype=torch.int64))
        self.register_buffer("filter_of_form", torch.zeros(0, dtype=torch.int64))
        self._kept_plan: Plan | None = None

    def __len__(self) -> int:
        return int(self.filter_of_form.max()) + 1 if len(self.filter_of_form) else 0

    def clear(self) -> Self:
        """Remove all filters."""
        return self._keep_filters(0)

    def drop_last(self) -> Self:
        """Remove the filter that was configured last."""
        return self._keep_filters(len(self) - 1)

    def _keep_filters(self, count: int) -> Self:
        forms = int((self.filter_of_form < count).sum())
        self.filter_of_form = self.filter_of_form[:forms]
        return self._keep_parts(self.form < forms)

    def _keep_parts(self, left: Tensor) -> Self:
        for name in PARTS:
            array = getattr(self, name)
            array.data = array.data[left]
        self._kept_plan = None
        return self

    def tuples(self, number: int) -> Tuples:
        """The parts of filter ``number`` as its prototype shows them, or under the first move if none is the identity.

        Raises:
            IndexError: there is no such filter.
        """
        first = int((self.filter_of_form == number).nonzero()[0, 0])
        own = self.form == first
        return Tuples(*(getattr(self, name).detach()[own] for name in ("channels", "rho", "phi")))

    def _append(self, forms: list[Tuples], least_weight: float) -> None:
        """Add a filter of these forms, whose outermost part has ``least_weight`` times the weight of the centre."""
        first, number = len(self.filter_of_form), len(self)
        added = {
            "channels": torch.cat([form.channels for form in forms]),
            "rho": torch.cat([form.rho for form in forms]),
            "phi": torch.cat([form.phi for form in forms]),
            "weights": torch.cat([part_weights(form.rho, least_weight) for form in forms]),
            "form": torch.cat([torch.full((len(form),), first + index) for index, form in enumerate(forms)]),
            "filter_of_form": torch.full((len(forms),), number),
        }
        for name, rows in added.items():
            known = getattr(self, name)
            known.data = torch.cat([known.data, rows.to(known)])
        self._kept_plan = None

    def _shares(self) -> Tensor:
        return shares(self.weights, self.form, len(self.filter_of_form))

    def _load_from_state_dict(self, state_dict: Mapping[str, Any], prefix: str, *rest: Any) -> None:
        # filters come with the state, so arrays take its sizes; channels of more or fewer numbers are another bank's
        for name in ARRAYS:
            own, value = getattr(self, name), state_dict.get(prefix + name)
            if value is not None and value.shape[1:] == own.shape[1:]:
                own.data = torch.empty_like(value, dtype=own.dtype, device=own.device)
        self._kept_plan = None
        super()._load_from_state_dict(state_dict, prefix, *rest)

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Self:
        exact = {name: array for name in ARRAYS if (array := self._buffers.get(name)) is not None}
        super()._apply(fn, recurse)
        for name, array in exact.items():
            setattr(self, name, array.to(getattr(self, name).device))
        return self
