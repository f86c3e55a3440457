"""Univariate distributions, sampled by the inverse of their distribution function and truncated to an interval.

Truncation is exact: a uniform number is mapped to the part of the distribution inside the interval.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.special import ndtr, ndtri

from sextant.errors import UserError

Function = Callable[[ndarray], ndarray]

#: the keys of each kind besides ``low`` and ``high``
KINDS: Mapping[str, tuple[str, ...]] = {
    "constant": ("value",),
    "uniform": (),
    "log_uniform": (),
    "triangular": ("mode",),
    "normal": ("mean", "std"),
    "cauchy": ("location", "scale"),
    "log_normal": ("location", "scale", "sigma"),
}
BOUNDED = ("uniform", "log_uniform", "triangular")


@dataclass(frozen=True)
class Variate:
    r"""A random number.

    ======================= ==================================================================
    ``constant``            always ``value``
    ``uniform``             evenly between ``low`` and ``high``
    ``log_uniform``         its logarithm evenly between those of ``low`` and ``high``
    ``triangular``          density rising from ``low`` to ``mode``, falling to ``high``
    ``normal``              ``mean``, ``std``
    ``cauchy``              ``location``, ``scale``: half of it within ``location`` ± ``scale``
    ``log_normal``          ``location + scale exp(sigma z)``, z standard normal
    ======================= ==================================================================

    The last three are truncated at ``low`` and ``high`` if these are given.

    Args:
        kind: see the table.
        parameters: keys of the table.
        low: lower end.
        high: upper end.

    Raises:
        UserError: a key is missing or not of this kind, or the interval is empty.
    """

    kind: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UserError(f"kind={self.kind!r} of a distribution must be one of {', '.join(KINDS)}")
        wanted, given = set(KINDS[self.kind]), set(self.parameters)
        if wanted != given:
            raise UserError(
                f"kind={self.kind} has the keys {sorted(wanted)}, got {sorted(given)}",
                "Every kind also takes low and high.",
            )
        ends = np.isfinite([self.low, self.high]).all()
        if self.kind in BOUNDED and not ends:
            raise UserError(f"kind={self.kind} needs low and high")
        if not self.low < self.high:
            raise UserError(f"low={self.low:g} must be below high={self.high:g}")
        for key in ("std", "scale", "sigma"):
            if self.parameters.get(key, 1.0) <= 0:
                raise UserError(f"{key}={self.parameters[key]:g} must be above 0")
        if self.kind == "log_uniform" and self.low <= 0:
            raise UserError(f"kind=log_uniform needs low above 0, got low={self.low:g}")
        if self.kind == "triangular" and not self.low <= self.parameters["mode"] <= self.high:
            raise UserError(f"mode={self.parameters['mode']:g} must lie between low and high")

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> "Variate":
        """A variate from the keys of a config: ``kind``, ``low``, ``high`` and the kind's own."""
        rest = {str(key): float(value) for key, value in entry.items() if key not in ("kind", "low", "high")}
        low, high = entry.get("low"), entry.get("high")
        ends = {key: float(value) for key, value in (("low", low), ("high", high)) if value is not None}
        return cls(str(entry.get("kind")), rest, **ends)

    def at(self, quantile: Float64[ndarray, "n"]) -> Float64[ndarray, "n"]:
        """The values below which a share ``quantile`` in (0, 1) of the numbers lies."""
        p, low, high = self.parameters, self.low, self.high
        if self.kind == "constant":
            return np.full_like(quantile, p["value"])
        if self.kind == "uniform":
            return low + (high - low) * quantile
        if self.kind == "log_uniform":
            return np.asarray(low * (high / low) ** quantile)
        if self.kind == "triangular":
            return _triangular(quantile, low, p["mode"], high)
        if self.kind == "normal":
            values = p["mean"] + p["std"] * self._cut(quantile, ndtr, ndtri, lambda x: (x - p["mean"]) / p["std"])
        elif self.kind == "cauchy":
            inside = self._cut(quantile, _cauchy, _cauchy_inverse, lambda x: (x - p["location"]) / p["scale"])
            values = p["location"] + p["scale"] * inside
        else:
            inside = self._cut(quantile, ndtr, ndtri, self._log_score)
            values = p["location"] + p["scale"] * np.exp(p["sigma"] * inside)
        return np.clip(values, low, high)  # rounding must not push a value out of the interval

    def _cut(self, quantile: ndarray, share: Function, inverse: Function, score: Function) -> ndarray:
        """The standardised value at a quantile of the part between ``low`` and ``high``."""
        below, up_to = (share(score(np.array(end))) for end in (self.low, self.high))
        return inverse(below + (up_to - below) * quantile)

    def _log_score(self, value: ndarray) -> ndarray:
        relative = (value - self.parameters["location"]) / self.parameters["scale"]
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(np.maximum(relative, 0)) / self.parameters["sigma"])


@dataclass(frozen=True)
class Mixture:
    """Several variates, one of which is chosen with a probability proportional to its weight.

    Args:
        parts: the variates.
        weights: how often each is chosen; they need not add up to 1.
    """

    parts: tuple[Variate, ...]
    weights: tuple[float, ...]

    @classmethod
    def of(cls, entry: Mapping[str, Any] | list[Mapping[str, Any]]) -> "Mixture":
        """A mixture from the keys of one variate, or from a list of such mappings with a ``weight`` each."""
        entries = [entry] if isinstance(entry, Mapping) else list(entry)
        weights = tuple(float(part.get("weight", 1.0)) for part in entries)
        if not entries or min(weights) < 0 or sum(weights) <= 0:
            raise UserError(f"weights of a mixture must be positive, got {list(weights)}", "For example weight: 0.5")
        stripped = [{key: value for key, value in part.items() if key != "weight"} for part in entries]
        return cls(tuple(map(Variate.of, stripped)), weights)

    def at(self, choice: Float64[ndarray, "n"], quantile: Float64[ndarray, "n"]) -> Float64[ndarray, "n"]:
        """Numbers from two independent uniform ones: ``choice`` selects the part, ``quantile`` the value in it."""
        which = chosen(self.weights, choice)
        return np.asarray(np.choose(which, [part.at(quantile) for part in self.parts]))


def chosen(weights: tuple[float, ...], choice: Float64[ndarray, "n"]) -> ndarray:
    """Indices drawn in proportion to ``weights``, from uniform numbers."""
    ends = np.cumsum(weights) / sum(weights)
    return np.minimum(np.searchsorted(ends, choice, side="right"), len(weights) - 1)


def _cauchy(x: ndarray) -> ndarray:
    return np.asarray(0.5 + np.arctan(x) / np.pi)


def _cauchy_inverse(q: ndarray) -> ndarray:
    return np.asarray(np.tan(np.pi * (q - 0.5)))


def _triangular(q: ndarray, low: float, mode: float, high: float) -> ndarray:
    share = (mode - low) / (high - low)
    rising = low + np.sqrt(q * (high - low) * (mode - low))
    falling = high - np.sqrt((1 - q) * (high - low) * (high - mode))
    return np.where(q < share, rising, falling)
