r"""COSFIRE: filters that are configured from one example and respond where its parts recur in the same arrangement.

.. math:: R(x) = \Big(\prod_i s_i(x)^{w_i}\Big)^{1/\sum w_i},\qquad
    s_i(x) = \operatorname{blur}_{\sigma(\rho_i)}(r_{c_i})\big(x + \rho_i (\cos\varphi_i, -\sin\varphi_i)\big)

with :math:`r_c` the maps of a bank; the maximum is taken over the moves that a filter tolerates.

Source: G. Azzopardi, N. Petkov, "Trainable COSFIRE filters for keypoint detection and pattern recognition", PAMI 35,
2013; on feature maps: M. Lopez-Antequera, M. Leyva Vallina, N. Strisciuglio, N. Petkov, "Place and object recognition
by CNN-based COSFIRE filters", IEEE Access 7, 2019.
"""

import math
from collections.abc import Callable, Iterator
from functools import reduce
from itertools import chain, islice
from pathlib import Path
from typing import Any, Literal, Self, get_args

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.layers.cosfire.banks import Bank, SteerableBank
from sextant.layers.cosfire.blur import Blur, Border, padded
from sextant.layers.cosfire.filter_parts import FilterParts
from sextant.layers.cosfire.plan import Plan
from sextant.layers.cosfire.responses import bilinear_responses, log_maxima, log_responses, tile_maxima, whole_responses
from sextant.layers.cosfire.saved_filters import load_filters, save_filters
from sextant.layers.cosfire.strategies import ConcentricCircles, Strategy
from sextant.layers.cosfire.tolerance import Move, Tolerance, moved_image
from sextant.layers.cosfire.tuples import Mean, Tuples, part_weights, safe_log
from sextant.layers.floating import require_floating

Shift = Literal["whole", "bilinear"]


class Cosfire(FilterParts):
    """COSFIRE filters over one bank; :meth:`configure` adds one, calling it gives the responses of all.

    >>> from sextant.layers.cosfire import GaborBank
    >>> example = torch.zeros(1, 48, 64)
    >>> example[:, 16:32, 12:28] = 1  # a square
    >>> filters = Cosfire(GaborBank()).configure(example, point=(20, 24))
    >>> filters(example[None]).shape  # of images (b, 1, h, w)
    torch.Size([1, 1, 48, 64])

    Bank, blur and logarithm of a map are computed once for all filters, parts and moves that share it.

    Args:
        bank: the maps that the filters are built on.
        strategy: how parts are found in an example.
        blur: tolerance to the position of parts.
        mean: how the responses of parts are combined.
        least_weight: weight of the outermost part relative to the centre, in (0, 1]; 1 weights all alike.
        tolerance: moves that a filter responds to; if the bank is not steerable, learnt from moved examples.
        t1: responses of the bank below this share of the image's strongest count as 0; for vectors, this concerns
            their lengths in an example and their cosines in an image.
        t3: responses of a filter below this share of its strongest in the image count as 0.
        floor: the least value of a part, in units of the bank: with 0 a single missing part silences a filter.
        shift: ``whole`` pixels, or ``bilinear`` between them (differentiable in ρ and φ).
        border: what lies beyond the border of the maps: nothing, or the opposite side (published MATLAB programs), ...

    Raises:
        ValueError: ``least_weight``, ``t1``, ``t3`` or ``floor`` is out of range, or ``mean``, ``shift`` or ``border``
            is unknown.
    """

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
        shift: Shift = "whole",
        border: Border = "zeros",
    ):
        super().__init__(bank.grid().shape[1])
        if not 0 < least_weight <= 1 or not 0 <= t1 <= 1 or not 0 <= t3 <= 1 or not 0 <= floor < math.inf:
            raise ValueError(
                f"least_weight must be in (0, 1], t1 and t3 in [0, 1], floor >= 0 and finite; got "
                f"least_weight={least_weight}, t1={t1}, t3={t3}, floor={floor}"
            )
        for name, value, known in (("mean", mean, Mean), ("shift", shift, Shift), ("border", border, Border)):
            if value not in get_args(known):
                raise ValueError(f"{name} must be one of {', '.join(get_args(known))}; got {value!r}")
        self.bank, self.strategy = bank, strategy or ConcentricCircles()
        self.blur, self.tolerance = blur or Blur(), tolerance or Tolerance()
        self.mean: Mean = mean
        self.least_weight, self.t1, self.t3, self.floor = least_weight, t1, t3, floor
        self.shift, self.border = shift, border

    def configure(self, example: Float[Tensor, "*one c h w"], point: tuple[float, float] | None = None) -> Self:
        """Add a filter that responds to what ``example`` shows at ``point``.

        Args:
            example: one image.
            point: x and y in its pixels; None is the pixel in its middle.

        Raises:
            UserError: the point lies outside, there is nothing there to make a filter of, or the bank cannot take such
                an image.
        """
        if example.shape[:-3].numel() != 1:
            raise UserError(f"a prototype is one image, got {tuple(example.shape)}", "Call configure once per image.")
        image = require_floating(example.reshape(1, -1, *example.shape[-2:]))
        height, width = image.shape[-2:]
        x, y = (width // 2, height // 2) if point is None else point
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            raise UserError(
                f"point=({x:g},{y:g}) lies outside the prototype of {width}x{height} pixels",
                f"Choose x from 0 to {width - 1} and y from 0 to {height - 1}.",
            )
        if not image.isfinite().all():
            raise UserError("the prototype has values that are not finite", "Choose another image, or replace them.")
        if (image.amin((2, 3)) == image.amax((2, 3))).all():
            raise UserError(
                "the prototype has a single colour: there is nothing to configure a filter from",
                "Choose another image.",
            )
        with torch.no_grad():
            forms = list(self._forms(image, (x, y)))
        self._append(forms, self.least_weight)
        return self

    def forward(self, images: Float[Tensor, "b c h w"]) -> Float[Tensor, "b n y x"]:
        """Responses of all n filters; y and x are those of the bank's maps.

        Raises:
            UserError: no filter is configured, or the bank cannot take such images.
        """
        plan = self._plan()
        response = _strongest(self._forms_of(require_floating(images), plan), plan)
        if self._logarithmic:
            response = response.exp() if response.requires_grad else response.exp_()
        return _from_share(response, response.amax((2, 3)), self.t3) if self.t3 > 0 else response

    def maxima(self, images: Float[Tensor, "b c h w"], tiles: int = 1) -> Float[Tensor, "b m"]:
        """The strongest response of each filter anywhere in an image: the feature vector of chapter 6.

        With ``tiles`` above 1, the strongest in each of ``tiles`` x ``tiles`` parts of the image, filter after filter
        and row by row, so that positions count too. The numbers are those of
        ``adaptive_max_pool2d(forward(images), tiles)`` up to rounding. On a CPU and without gradients, the responses
        are never written to memory, and a single nan makes all numbers of its image nan.

        Raises:
            ValueError: ``tiles`` is below 1.
            UserError: as :meth:`forward`.
        """
        if tiles < 1:
            raise ValueError(f"maxima need at least one tile per side, got {tiles}")
        plan = self._plan()
        trained = torch.is_grad_enabled() and (images.requires_grad or any(p.requires_grad for p in self.parameters()))
        compiled = images.device.type == "cpu" and images.dtype in (torch.float32, torch.float64)
        cut = tiles > 1 and self.t3 > 0  # a share of the strongest of all tiles
        if trained or not self._logarithmic or not compiled or cut:
            return tile_maxima(self(images), tiles)
        with torch.no_grad():
            return log_maxima(self._log_maps(images, plan), self._shares(), plan, tiles).exp()

    def keep(self, wanted: Callable[[Tuples], Bool[Tensor, "n"]]) -> Self:
        """Keep only those parts of the last filter's prototype that ``wanted`` selects, in all its forms.

        Raises:
            UserError: no part is left, or the forms come from moved prototypes (the bank is not steerable), so that
                their parts cannot be matched.
        """
        number = len(self) - 1
        chosen = wanted(self.tuples(number))
        forms = (self.filter_of_form == number).nonzero()[:, 0].tolist()
        if not chosen.any():
            raise UserError("no part of the filter is left", "Keep at least one.")
        if len(forms) > 1 and not isinstance(self.bank, SteerableBank):
            raise UserError(
                f"each of the filter's {len(forms)} forms has its own parts, from a transformed prototype",
                "Use no tolerance, or a bank that is steerable.",
            )
        last = self.filter_of_form[self.form] == number
        left = ~last
        left[last] = chosen.repeat(len(forms))
        self._keep_parts(left)
        for form in forms:
            own = self.form == form
            self.weights.data[own] = part_weights(self.rho[own].detach(), self.least_weight).to(self.weights)
        return self

    def train_parts(self) -> Self:
        """Make parameters of the weights and of all else that has a gradient.

        These are the directions of a network's vectors and, with ``shift="bilinear"``, the positions of the parts (σ of
        their blur follows ρ without a gradient).
        """
        names = ["weights"]
        if self.shift == "bilinear":
            names += ["rho", "phi"]
        if self.bank.learnable:
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

    def save(self, path: Path) -> None:
        """Write the filters, and all options but a network's weights, to a safetensors file.

        Raises:
            UserError: the strategy is one of the user's own, which a file cannot hold.
            OSError: the file cannot be written.
        """
        save_filters(self, path)

    @classmethod
    def load(cls, path: Path, bank: Bank | None = None) -> "Cosfire":
        """Filters that :meth:`save` wrote.

        Args:
            path: the file.
            bank: the bank of the filters; None builds it anew, unless it holds a network.

        Raises:
            UserError: the file is missing, damaged, not one of filters, or was written for another bank.
        """
        return load_filters(path, bank, cls)

    def _forms(self, image: Tensor, point: tuple[float, float]) -> "list[Tuples]":
        """The parts under each move."""
        original = self._found(image, point)
        if len(original) == 0:
            raise UserError(
                f"nothing in the prototype's neighbourhood of point=({point[0]:g},{point[1]:g}) is strong enough "
                "for a filter",
                "Choose a point on or near an edge, a corner or a line, or lower t1 and the strategy's thresholds.",
            )
        forms = []
        for move in self.tolerance.moves():
            if move.nothing:
                forms.append(original)
            elif isinstance(self.bank, SteerableBank):
                forms.append(_moved(original, move, self.bank))
            else:
                forms.append(self._found(*moved_image(image, point, move)))
        return [form for form in forms if len(form)]

    def _found(self, image: Tensor, point: tuple[float, float]) -> Tuples:
        maps = self.bank.describe(image)[0]
        strength = self.bank.strength(maps[None])[0]
        maps = maps.masked_fill(strength < self.t1 * strength.amax(), 0.0)
        height, width = image.shape[-2:]
        row = int((point[1] + 0.5) * maps.shape[1] / height)
        column = int((point[0] + 0.5) * maps.shape[2] / width)
        at = (min(row, maps.shape[1] - 1), min(column, maps.shape[2] - 1))
        grid = self.bank.grid()
        found = self.strategy.tuples(maps, grid, at)
        if found.channels.shape[1] != grid.shape[1]:
            raise UserError(
                f"{type(self.strategy).__name__} names channels by {found.channels.shape[1]} numbers, "
                f"{type(self.bank).__name__} by {grid.shape[1]}",
                "VectorKeypoints needs a VectorBank; the other strategies work with every bank.",
            )
        return found

    def _plan(self) -> Plan:
        if len(self) == 0:
            raise UserError("no COSFIRE filter is configured", "Call configure(example, point) first.")
        if self._kept_plan is not None and self._kept_plan.blur == self.blur:
            return self._kept_plan
        plan = Plan.of(self.channels, self.rho, self.phi, self.form, self.filter_of_form, self.blur)
        if not any(isinstance(getattr(self, name), nn.Parameter) for name in ("rho", "phi", "channels")):
            self._kept_plan = plan
        return plan

    def _blurred(self, images: Tensor, plan: Plan) -> Tensor:
        """Every map that some part uses, (b, u, y, x)."""
        maps = self.bank(images, self.channels[plan.channels.to(self.channels.device)])
        if self.t1 > 0:
            maps = _from_share(maps, self.bank.strongest(images)[:, None], self.t1)
        found = torch.cat([self.blur(maps[:, which], sigma) for sigma, which in plan.blurred], 1)
        return found.clamp(min=self.floor) if self.floor else found

    def _log_maps(self, images: Tensor, plan: Plan) -> Tensor:
        nothing = math.log(self.floor) if self.floor else -math.inf
        return padded(safe_log(self._blurred(images, plan)), plan.margin, self.border, nothing)

    def _forms_of(self, images: Tensor, plan: Plan) -> Iterator[Tensor]:
        """Responses of one form after the other; for geometric means and whole shifts, their logarithms."""
        weights = self._shares()
        if self._logarithmic:
            return log_responses(self._log_maps(images, plan), weights, plan)
        maps = self._blurred(images, plan)
        if self.shift == "whole":
            return whole_responses(padded(maps, plan.margin, self.border, self.floor), weights, plan, self.mean)
        return bilinear_responses(maps, weights, self.rho, self.phi, plan, self.mean, self.border, self.floor)

    @property
    def _logarithmic(self) -> bool:
        return self.mean == "geometric" and self.shift == "whole"


def _from_share(maps: Tensor, strongest: Tensor, share: float) -> Tensor:
    """Maps (b, k, y, x) with all below ``share`` of ``strongest``, (b, k) or (b, 1), set to zero; nan stays."""
    return maps.masked_fill(maps < share * strongest[..., None, None], 0.0) if share > 0 else maps


def _strongest(forms: Iterator[Tensor], plan: Plan) -> Tensor:
    """Pixelwise maximum over the forms (b, h, w) of each filter: (b, n, h, w)."""
    first = next(forms)
    forms = chain([first], forms)
    if first.requires_grad:
        return torch.stack([reduce(torch.maximum, islice(forms, len(own))) for own in plan.forms], 1)
    # written in place: allocating memory for every form takes longer than the sums
    found = first.new_empty(len(first), len(plan.forms), *first.shape[1:])
    for number, own in enumerate(plan.forms):
        best = found[:, number].copy_(next(forms))
        for form in islice(forms, len(own) - 1):
            torch.maximum(best, form, out=best)
    return found


def _moved(tuples: Tuples, move: Move, bank: SteerableBank) -> Tuples:
    phi = torch.pi - tuples.phi if move.mirrored else tuples.phi
    return Tuples(bank.moved(tuples.channels, move), tuples.rho * move.scale, phi + move.rotation_rad)
