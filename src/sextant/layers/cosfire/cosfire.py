r"""COSFIRE: filters that are configured from one example, and answer where its parts are arranged alike.

.. math:: R(x) = \Big(\prod_i s_i(x)^{w_i}\Big)^{1/\sum w_i},\qquad
    s_i(x) = \operatorname{blur}_{\sigma(\rho_i)}(r_{c_i})\big(x + \rho_i (\cos\varphi_i, -\sin\varphi_i)\big)

with :math:`r_c` the maps of a bank, and the maximum over the moves a filter tolerates.

Source: G. Azzopardi, N. Petkov, "Trainable COSFIRE filters for keypoint detection and pattern recognition", PAMI 35,
2013; on feature maps: M. Lopez-Antequera, M. Leyva Vallina, N. Strisciuglio, N. Petkov, "Place and object recognition
by CNN-based COSFIRE filters", IEEE Access 7, 2019.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal, Self

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.layers.cosfire.bank import Bank
from sextant.layers.cosfire.blur import Blur
from sextant.layers.cosfire.border import Border, padded
from sextant.layers.cosfire.concentric_circles import ConcentricCircles
from sextant.layers.cosfire.maxima import log_maxima
from sextant.layers.cosfire.mean import Mean, safe_log
from sextant.layers.cosfire.moved_image import moved_image
from sextant.layers.cosfire.plan import Plan
from sextant.layers.cosfire.responses import bilinear_responses, log_responses, whole_responses
from sextant.layers.cosfire.strategy import Strategy
from sextant.layers.cosfire.tolerance import Move, Tolerance
from sextant.layers.cosfire.tuples import Tuples, part_weights

#: arrays of the parts in a state dict: rows of all filters' forms one after the other
PARTS = ("channels", "rho", "phi", "weights", "form", "filter_of_form")


class Cosfire(nn.Module):
    """COSFIRE filters over one bank; :meth:`configure` adds one, calling it gives the responses of all.

    >>> filters = Cosfire(GaborBank()).configure(example, point=(20, 31))
    >>> response = filters(images)  # (b, 1, h, w)

    Bank, blur and logarithm of a map are worked out once for all filters, parts and moves that share it.

    Args:
        bank: what the filters look through.
        strategy: how parts are found in an example.
        blur: how far parts may be off.
        mean: how parts are put together.
        least_weight: of the outermost part against the centre, in (0, 1]; 1 weighs all alike.
        tolerance: moves that a filter answers to. What the bank cannot move is configured from the moved example.
        t1: responses of the bank below this share of the image's strongest count as none.
        t3: responses of a filter below this share of its strongest in the image are none.
        floor: the least a part counts, in units of the bank: with 0 a single missing part silences a filter.
        shift: to whole pixels, or ``bilinear`` between them (differentiable in ρ and φ).
        border: what lies beyond the border of the maps: nothing, or the opposite side (published MATLAB programs), ...

    Attributes:
        channels, rho, phi, weights: of the parts of all filters, one after the other.
        form: the number of the form (a filter under one move) that each part belongs to.
        filter_of_form: the number of its filter.

    Raises:
        ValueError: ``least_weight``, ``t1``, ``t3`` or ``floor`` is out of range.
    """

    channels: Tensor
    rho: Tensor
    phi: Tensor
    weights: Tensor
    form: Tensor
    filter_of_form: Tensor

    def __init__(
        self,
        bank: Bank,
        strategy: Strategy | None = None,
        *,
        blur: Blur | None = None,
        mean: Mean = "geometric",
        least_weight: float = 0.5,
        tolerance: Tolerance | None = None,
        t1: float = 0.0,
        t3: float = 0.0,
        floor: float = 0.0,
        shift: Literal["whole", "bilinear"] = "whole",
        border: Border = "zeros",
    ):
        super().__init__()
        if not 0 < least_weight <= 1 or not 0 <= t1 <= 1 or not 0 <= t3 <= 1 or floor < 0:
            raise ValueError(
                f"least_weight must be in (0, 1], t1 and t3 in [0, 1] and floor >= 0; got "
                f"{least_weight}, {t1}, {t3}, {floor}"
            )
        self.bank, self.strategy = bank, strategy or ConcentricCircles()
        self.blur, self.tolerance = blur or Blur(), tolerance or Tolerance()
        self.mean: Mean = mean
        self.least_weight, self.t1, self.t3, self.floor = least_weight, t1, t3, floor
        self.shift, self.border = shift, border
        for name in ("rho", "phi", "weights"):
            self.register_buffer(name, torch.zeros(0, dtype=torch.float64))
        self.register_buffer("channels", torch.zeros(0, bank.grid().shape[1], dtype=torch.float64))
        self.register_buffer("form", torch.zeros(0, dtype=torch.int64))
        self.register_buffer("filter_of_form", torch.zeros(0, dtype=torch.int64))
        self._kept_plan: Plan | None = None

    def __len__(self) -> int:
        return int(self.filter_of_form.max()) + 1 if len(self.filter_of_form) else 0

    def configure(self, example: Float[Tensor, "*one c h w"], point: tuple[float, float] | None = None) -> Self:
        """Add a filter that answers to what ``example`` shows at ``point``.

        Args:
            example: one image.
            point: x and y in its pixels; None is its middle.

        Raises:
            UserError: the point lies outside, or there is nothing at it that a filter could be made of.
        """
        image = example.reshape(-1, *example.shape[-2:])[None]
        height, width = image.shape[-2:]
        x, y = ((width - 1) / 2, (height - 1) / 2) if point is None else point
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            raise UserError(
                f"point=({x:g},{y:g}) lies outside the prototype of {width}x{height} pixels",
                f"Choose x from 0 to {width - 1} and y from 0 to {height - 1}.",
            )
        if float(image.min()) == float(image.max()):
            raise UserError(
                "the prototype is of one colour: there is nothing to configure a filter from", "Choose another image."
            )
        with torch.no_grad():
            forms = list(self._forms(image, (x, y)))
        self._append(forms)
        return self

    def forward(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b n y x"]:
        """Responses of all n filters; y and x are those of the bank's maps.

        Raises:
            UserError: no filter is configured.
            ValueError: the bank takes images of another number of channels.
        """
        plan = self._plan()
        forms = self._forms_of(images, plan)
        response = torch.stack([_strongest(forms, len(own)) for own in plan.forms], 1)
        if self._logarithmic:
            response = response.exp()
        return _from_share(response, response.amax((2, 3)), self.t3)

    def maxima(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b n"]:
        """The strongest response of each filter anywhere in an image: the feature vector of chapter 6.

        The same numbers as ``forward(images).amax((2, 3))`` up to rounding; without gradients and on a processor the
        responses are never written to memory.

        Raises:
            UserError, ValueError: as :meth:`forward`.
        """
        plan = self._plan()
        trained = torch.is_grad_enabled() and (images.requires_grad or any(p.requires_grad for p in self.parameters()))
        if trained or not self._logarithmic or images.device.type != "cpu":
            return self(images).amax((2, 3))  # type: ignore[no-any-return]
        with torch.no_grad():
            found = log_maxima(self._log_maps(images, plan), self.weights, plan)
        return found.exp()

    def keep(self, wanted: Callable[[Tuples], Bool[Tensor, "n"]]) -> Self:
        """Take away the parts of the last filter's prototype that ``wanted`` does not tell to keep, in all its forms.

        Raises:
            UserError: no part is left.
        """
        number = len(self) - 1
        chosen = wanted(self.tuples(number))
        if not chosen.any():
            raise UserError("no part of the filter is left", "Keep at least one.")
        forms = (self.filter_of_form == number).nonzero()[:, 0].tolist()
        last = torch.isin(self.form, torch.tensor(forms))
        left = ~last
        left[last] = chosen.repeat(len(forms))
        for name in ("channels", "rho", "phi", "weights", "form"):
            setattr(self, name, getattr(self, name)[left])
        for form in forms:
            own = self.form == form
            self.weights[own] = part_weights(self.rho[own], self.least_weight)
        self._kept_plan = None
        return self

    def tuples(self, number: int) -> Tuples:
        """The parts of filter ``number`` as its prototype shows them."""
        first = int((self.filter_of_form == number).nonzero()[0, 0])
        own = self.form == first
        return Tuples(self.channels[own], self.rho[own], self.phi[own])

    def train_parts(self) -> Self:
        """Make weights, and what else has a gradient, parameters: of networks' vectors their directions, and with
        ``shift="bilinear"`` the places of the parts. Returns the layer."""
        names = ["weights"]
        if self.shift == "bilinear":
            names += ["rho", "phi"]
        if self.channels.shape[1] > 2:
            names.append("channels")
        for name in names:
            value = self._buffers.pop(name, None)
            if value is not None:
                self.register_parameter(name, nn.Parameter(value.float()))
        self._kept_plan = None
        return self

    def options(self) -> dict[str, Any]:
        """The numbers among the constructor's arguments, as plain values."""
        names = ("mean", "least_weight", "t1", "t3", "floor", "shift", "border")
        return {name: getattr(self, name) for name in names}

    def _load_from_state_dict(self, state_dict: Mapping[str, Any], prefix: str, *rest: Any) -> None:
        # filters come with the state, so arrays take its sizes
        for name in PARTS:
            value = state_dict.get(prefix + name)
            if value is not None:
                own = getattr(self, name)
                own.data = torch.empty_like(value, dtype=own.dtype, device=own.device)
        self._kept_plan = None
        super()._load_from_state_dict(state_dict, prefix, *rest)

    def _forms(self, image: Tensor, point: tuple[float, float]) -> "list[Tuples]":
        """The parts under each move."""
        original = self._found(image, point)
        if len(original) == 0:
            raise UserError(
                f"nothing in the prototype's neighbourhood of point=({point[0]:g},{point[1]:g}) is strong enough "
                "for a filter",
                "Choose a point on or near an edge, a corner or a line, or lower t1.",
            )
        forms = []
        for move in self.tolerance.moves():
            if move.nothing:
                forms.append(original)
            elif self.bank.steerable:
                forms.append(self._moved(original, move))
            else:
                forms.append(self._found(*moved_image(image, point, move)))
        return [form for form in forms if len(form)]

    def _found(self, image: Tensor, point: tuple[float, float]) -> Tuples:
        maps = self.bank.describe(image)
        maps = _from_share(maps, maps.amax((1, 2, 3))[:, None], self.t1)[0]
        height, width = image.shape[-2:]
        row = int((point[1] + 0.5) * maps.shape[1] / height)
        column = int((point[0] + 0.5) * maps.shape[2] / width)
        at = (min(row, maps.shape[1] - 1), min(column, maps.shape[2] - 1))
        return self.strategy.tuples(maps, self.bank.grid(), at)

    def _moved(self, tuples: Tuples, move: Move) -> Tuples:
        phi = torch.pi - tuples.phi if move.mirrored else tuples.phi
        return Tuples(self.bank.moved(tuples.channels, move), tuples.rho * move.scale, phi + move.rotation_rad)

    def _append(self, forms: "list[Tuples]") -> None:
        first, number = len(self.filter_of_form), len(self)
        added = {
            "channels": torch.cat([form.channels for form in forms]),
            "rho": torch.cat([form.rho for form in forms]),
            "phi": torch.cat([form.phi for form in forms]),
            "weights": torch.cat([part_weights(form.rho, self.least_weight) for form in forms]),
            "form": torch.cat([torch.full((len(form),), first + index) for index, form in enumerate(forms)]),
            "filter_of_form": torch.full((len(forms),), number),
        }
        for name, rows in added.items():
            known = getattr(self, name)
            known.data = torch.cat([known.data, rows.to(known)])
        self._kept_plan = None

    def _plan(self) -> Plan:
        if len(self) == 0:
            raise UserError("no COSFIRE filter is configured", "Call configure(example, point) first.")
        if self._kept_plan is not None:
            return self._kept_plan
        plan = Plan.of(self.channels, self.rho, self.phi, self.form, self.filter_of_form, self.blur)
        if not any(isinstance(getattr(self, name), nn.Parameter) for name in ("rho", "phi", "channels")):
            self._kept_plan = plan
        return plan

    def _blurred(self, images: Tensor, plan: Plan) -> Tensor:
        """Every map that some part looks at, (b, u, y, x)."""
        maps = self.bank(images, self.channels[plan.channels.to(self.channels.device)])
        if self.t1 > 0:
            strongest = self.bank.describe(images).amax((1, 2, 3))
            maps = _from_share(maps, strongest[:, None].expand(-1, maps.shape[1]), self.t1)
        found = torch.cat([self.blur(maps[:, which], sigma) for sigma, which in plan.blurred], 1)
        return found.clamp(min=self.floor) if self.floor else found

    def _log_maps(self, images: Tensor, plan: Plan) -> Tensor:
        nothing = math.log(self.floor) if self.floor else -math.inf
        return padded(safe_log(self._blurred(images, plan)), (plan.margin,) * 4, self.border, nothing)

    def _forms_of(self, images: Tensor, plan: Plan) -> Iterator[Tensor]:
        """Responses of one form after the other; of geometric means of whole shifts their logarithms."""
        if self._logarithmic:
            return log_responses(self._log_maps(images, plan), self.weights, plan)
        maps = self._blurred(images, plan)
        if self.shift == "whole":
            wide = padded(maps, (plan.margin,) * 4, self.border, self.floor)
            return whole_responses(wide, self.weights, plan, self.mean)
        return bilinear_responses(maps, self.weights, self.rho, self.phi, plan, self.mean, self.border, self.floor)

    @property
    def _logarithmic(self) -> bool:
        return self.mean == "geometric" and self.shift == "whole"


def _from_share(maps: Tensor, strongest: Tensor, share: float) -> Tensor:
    """Maps (b, k, y, x) with all below ``share`` of ``strongest`` (b, k) set to zero."""
    return torch.where(maps >= share * strongest[..., None, None], maps, 0.0) if share > 0 else maps


def _strongest(maps: Iterator[Tensor], count: int) -> Tensor:
    """Pixelwise maximum of the next ``count`` maps."""
    best = next(maps)
    for _ in range(count - 1):
        best = torch.maximum(best, next(maps))
    return best
