r"""Distributions of the cameras of crops: tilt, roll, focal length, distortion, heading and the shape of the image.

Each quantity is drawn independently, in the terms in which a distribution was published: the horizon's offset or the
tilt, the focal length in millimetres or the field of view, k1 or the apparent :math:`k_1/f^2`. The rest follows.

A draw is a function of (seed, panorama, number of the draw) alone. Two kinds of camera are drawn again: impossible
ones, with an image corner or the horizon beyond the fold of the distortion, and those that point almost straight up or
down. The others keep their distribution.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
import torch
from annotated_types import Ge, Le
from jaxtyping import Float, Float64, Int64
from numpy import ndarray
from scipy.special import ndtr, ndtri
from torch import Tensor

from sextant.data.counters import uniforms
from sextant.errors import ArgumentError, UserError
from sextant.geometry import (
    CameraParameters,
    K2Family,
    focal_from_vfov,
    k2_of_k1,
    max_distorted_radius,
    tilt_from_rho,
    tilt_from_tau,
)
from sextant.ranges import Positive, checked

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

    Truncation is exact: a uniform number is mapped to the part of the distribution inside the interval.

    ======================= ==================================================================
    ``constant``            always ``value``
    ``uniform``             uniform between ``low`` and ``high``
    ``log_uniform``         its logarithm uniform between those of ``low`` and ``high``
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


TiltQuantity = Literal["rho", "tau", "tilt_deg"]
RollQuantity = Literal["roll_rad", "roll_deg"]
FocalQuantity = Literal["heights", "long_sides", "mm", "vfov_deg"]
BendQuantity = Literal["k1", "k1_hat", "sphere"]

STEEPEST = math.radians(85)
ATTEMPTS = 200
#: uniform numbers per camera
NUMBERS = 11


@dataclass(frozen=True)
class CameraDraw:
    """Cameras, their headings and their aspects.

    Attributes:
        cameras: tilt, roll, focal length and k1, float64.
        yaw: heading in the panorama, radians: the longitude at the image centre, positive to the right.
        aspect: width over height of the image.
    """

    cameras: CameraParameters
    yaw: Float[Tensor, "b"]
    aspect: Float[Tensor, "b"]


@checked
@dataclass(frozen=True)
class CameraDistribution:
    """Distributions of a camera's parameters; ``conf/sampling`` has those of the literature with their sources.

    ``tilt``, ``roll``, ``focal`` and ``k1`` are each a mapping with the keys of
    :class:`~sextant.chapters.calibration.data.camera_distributions.Variate`, or a list of such mappings with a
    ``weight`` each: a mixture.

    Args:
        tilt: distribution of the quantity that ``tilt_as`` names.
        roll: distribution of the quantity that ``roll_as`` names.
        focal: distribution of the quantity that ``focal_as`` names.
        k1: distribution of the quantity that ``k1_as`` names.
        aspect: weights of aspects, width over height, keyed by strings such as ``"4:3"``.
        tilt_as: ``rho`` or ``tau`` (offset of the distorted or the undistorted horizon, image heights) or ``tilt_deg``.
        roll_as: ``roll_rad`` or ``roll_deg``.
        focal_as: ``heights``, ``long_sides`` (of the image), ``mm`` (of a frame ``frame_height_mm`` high) or
            ``vfov_deg`` (nominal vertical field of view).
        k1_as: ``k1``, ``k1_hat`` (apparent: k1 / f²) or ``sphere``: ξ of the unified sphere model, of which
            -ξ / (2 + 2ξ) is the first coefficient.
        k2_of_k1: the lens family, ``lopez`` or ``zero``.
        portrait: share of portrait images, whose aspect is inverted.
        frame_height_mm: see ``focal_as``.
        name: name of the distribution in messages.

    Raises:
        UserError: a value is invalid; the message names its key.
    """

    tilt: Any
    roll: Any
    focal: Any
    k1: Any
    aspect: Mapping[str, float]
    tilt_as: TiltQuantity = "rho"
    roll_as: RollQuantity = "roll_rad"
    focal_as: FocalQuantity = "mm"
    k1_as: BendQuantity = "k1"
    k2_of_k1: K2Family = "lopez"
    portrait: Annotated[float, Ge(0), Le(1)] = 0.0
    frame_height_mm: Positive = 27.0
    name: str = ""
    _mixtures: Mapping[str, Mixture] = field(init=False, repr=False, compare=False)
    _landscape: Float64[ndarray, "a"] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.k2_of_k1 not in ("lopez", "zero"):
            raise ArgumentError(f"k2_of_k1={self.k2_of_k1!r} must be lopez or zero")
        weights = list(self.aspect.values())
        if not weights or min(weights) < 0 or sum(weights) <= 0:
            raise ArgumentError(
                f"aspect={dict(self.aspect)} needs a weight above 0", 'For example aspect: {"4:3": 0.7, "3:2": 0.3}'
            )
        mixtures = {}
        for key in ("tilt", "roll", "focal", "k1"):
            try:
                mixtures[key] = Mixture.of(getattr(self, key))
            except UserError as error:
                raise ArgumentError(f"{key}={getattr(self, key)!r}: {error.problem}", error.fix) from None
            except (TypeError, ValueError, AttributeError):
                raise ArgumentError(
                    f"{key}={getattr(self, key)!r} is not a distribution",
                    "It is a mapping such as {kind: uniform, low: 0.1, high: 0.9}, or a list of them, with weights.",
                ) from None
        object.__setattr__(self, "_mixtures", mixtures)
        object.__setattr__(self, "_landscape", np.array([_ratio(name) for name in self.aspect]))

    @property
    def aspects(self) -> tuple[float, ...]:
        """All values of width over height, in increasing order."""
        landscape = [ratio for ratio, weight in zip(self._landscape, self.aspect.values(), strict=True) if weight > 0]
        upright = [1 / ratio for ratio in landscape] if self.portrait > 0 else []
        return tuple(sorted({round(float(ratio), 12) for ratio in [*landscape, *upright]}))

    def draw(self, n: int, seed: int) -> CameraDraw:
        """The first ``n`` draws of panorama 0."""
        return self.draw_for(np.zeros(n, np.int64), np.arange(n), seed)

    def draw_for(self, panoramas: Int64[ndarray, "b"], draws: Int64[ndarray, "b"], seed: int) -> CameraDraw:
        """Draw number ``draws`` of each panorama; the same whatever else is requested with it.

        Raises:
            UserError: hardly any camera of this distribution is possible.
        """
        panoramas, draws = np.asarray(panoramas, np.int64), np.asarray(draws, np.int64)
        drawn = torch.empty(6, len(panoramas), dtype=torch.float64)
        left = np.arange(len(panoramas))
        for attempt in range(ATTEMPTS):
            values, legal = self._attempt(uniforms(panoramas[left], draws[left], attempt, seed, NUMBERS))
            drawn[:, torch.from_numpy(left)] = values  # those that are not legal are overwritten by the next attempt
            left = left[~legal.numpy()]
            if not len(left):
                return CameraDraw(CameraParameters(*drawn[:4]), drawn[4], drawn[5])
        raise UserError(
            f"of {ATTEMPTS} cameras drawn in a row from the distribution {self.name}, none has its corners and "
            "its horizon inside the fold of the distortion and a tilt below 85 degrees",
            "Choose a longer focal, a k1 nearer to 0, or k2_of_k1=lopez.",
        )

    def _attempt(self, u: Float64[ndarray, "k b"]) -> tuple[Float64[Tensor, "6 b"], Tensor]:
        """Tilt, roll, focal, k1, yaw and aspect, and which of these cameras are possible."""
        tilt, roll, focal, k1 = (
            torch.from_numpy(self._mixtures[key].at(u[2 * i], u[2 * i + 1]))
            for i, key in enumerate(("tilt", "roll", "focal", "k1"))
        )
        ratio = self._landscape[chosen(tuple(self.aspect.values()), u[8])]
        aspect = torch.from_numpy(np.where(u[9] < self.portrait, 1 / ratio, ratio))
        yaw = torch.from_numpy(2 * math.pi * u[10] - math.pi)
        focal = self._focal(focal, aspect)
        k1 = self._k1(k1, focal)
        k2 = k2_of_k1(k1, self.k2_of_k1)
        reach = focal * max_distorted_radius(k1, k2)  # image heights
        legal = (focal > 0) & (torch.hypot(aspect, torch.ones_like(aspect)) / 2 < reach)
        if self.tilt_as == "rho":
            legal &= tilt.abs() < reach
            tilt = tilt_from_rho(tilt, focal, k1, k2)
        elif self.tilt_as == "tau":
            tilt = tilt_from_tau(tilt, focal)
        else:
            tilt = torch.deg2rad(tilt)
        roll = torch.deg2rad(roll) if self.roll_as == "roll_deg" else roll
        legal &= tilt.abs() <= STEEPEST
        return torch.stack([tilt, roll, focal, k1, yaw, aspect]), legal

    def _focal(self, drawn: Tensor, aspect: Tensor) -> Tensor:
        """Focal length in image heights."""
        if self.focal_as == "mm":
            return drawn / self.frame_height_mm
        if self.focal_as == "long_sides":
            return drawn * aspect.clamp(min=1)
        return drawn if self.focal_as == "heights" else focal_from_vfov(torch.deg2rad(drawn))

    def _k1(self, drawn: Tensor, focal: Tensor) -> Tensor:
        if self.k1_as == "k1_hat":
            return drawn * focal.square()
        return drawn if self.k1_as == "k1" else -drawn / (2 + 2 * drawn)


def _ratio(name: str) -> float:
    """``"4:3"`` as a number."""
    try:
        width, height = (float(part) for part in str(name).split(":"))
        if width > 0 and height > 0 and math.isfinite(width / height):
            return width / height
    except ValueError:
        pass
    raise ArgumentError(f'aspect={name!r} is not the shape of an image, such as "4:3"')
