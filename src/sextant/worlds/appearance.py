"""The appearance of a world as a vector of named factors: what changes between two visits to the same place."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from sextant.errors import UserError


@dataclass(frozen=True)
class Appearance:
    """Everything about a picture that is neither the place nor the camera. The default is a clear summer noon.

    Each factor can be set on its own (``replace(appearance, fog_per_m=0.02)``), so that a method's invariance can be
    measured against one cause at a time. Ranges are checked.

    Attributes:
        sun_elevation_deg: height of the sun above the horizon, -90 to 90; it casts the shadows.
        sun_azimuth_deg: direction to the sun, counter-clockwise from world x.
        cloud_cover: 0 clear to 1 overcast, which hides the sun and its shadows.
        exposure_ev: stops added to the camera's exposure.
        gamma: display gamma of the camera.
        temperature_k: white balance; 6500 is neutral, lower is warmer.
        fog_per_m: extinction beta of the fog, ``I e^(-beta d) + A (1 - e^(-beta d))``.
        snow: 0 to 1, snow cover of surfaces that face up.
        foliage_density: 0 bare to 1 full.
        foliage_autumn: 0 summer green to 1 autumn colours.
        wetness: 0 dry to 1 standing water; wet ground is darker and reflects.
        night: 0 day to 1 night; street lamps light up with it.
        lit_windows: share of windows with light behind them.
        facades_changed: share of facades that were repainted.
        cars_moved: share of parked cars that left or arrived.
        traffic_per_100m: moving cars and people in the way, per 100 metres of street.
        exposure_time_s: how long the shutter is open, for motion blur at the camera's speed.
        read_noise, shot_noise: sigma of the sensor noise, ``sigma^2 = read^2 + shot^2 I``, with I in [0, 1].
        vignetting: 0 to 1, darkening towards the corners.
        change_seed: which facades, cars and passers-by change.
    """

    sun_elevation_deg: float = 52.0
    sun_azimuth_deg: float = 250.0
    cloud_cover: float = 0.15
    exposure_ev: float = 0.0
    gamma: float = 2.2
    temperature_k: float = 6500.0
    fog_per_m: float = 0.0
    snow: float = 0.0
    foliage_density: float = 1.0
    foliage_autumn: float = 0.0
    wetness: float = 0.0
    night: float = 0.0
    lit_windows: float = 0.03
    facades_changed: float = 0.0
    cars_moved: float = 0.0
    traffic_per_100m: float = 0.0
    exposure_time_s: float = 0.0
    read_noise: float = 0.0
    shot_noise: float = 0.0
    vignetting: float = 0.0
    change_seed: int = 0

    def __post_init__(self) -> None:
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            if not (isinstance(value, int | float) and math.isfinite(value) and low <= value <= high):
                raise UserError(f"appearance.{name} is {value!r}; it must be a number from {low:g} to {high:g}")
        if self.change_seed != int(self.change_seed):
            raise UserError(f"appearance.change_seed is {self.change_seed!r}; it must be a whole number")
        object.__setattr__(self, "change_seed", int(self.change_seed))

    @property
    def structure(self) -> tuple[float | int, ...]:
        """The factors that change the geometry; two appearances that agree in these can share a scene."""
        return (self.foliage_density, self.facades_changed, self.cars_moved, self.traffic_per_100m, self.change_seed)


#: allowed values of every factor
RANGES: dict[str, tuple[float, float]] = {
    "sun_elevation_deg": (-90, 90),
    "sun_azimuth_deg": (-360, 360),
    "cloud_cover": (0, 1),
    "exposure_ev": (-8, 8),
    "gamma": (0.5, 4),
    "temperature_k": (1500, 20000),
    "fog_per_m": (0, 1),
    "snow": (0, 1),
    "foliage_density": (0, 1),
    "foliage_autumn": (0, 1),
    "wetness": (0, 1),
    "night": (0, 1),
    "lit_windows": (0, 1),
    "facades_changed": (0, 1),
    "cars_moved": (0, 1),
    "traffic_per_100m": (0, 20),
    "exposure_time_s": (0, 1),
    "read_noise": (0, 1),
    "shot_noise": (0, 1),
    "vignetting": (0, 1),
    "change_seed": (0, 2**31),
}

CONDITIONS: dict[str, Appearance] = {
    "summer_noon": Appearance(),
    "summer_evening": Appearance(
        sun_elevation_deg=11, sun_azimuth_deg=345, cloud_cover=0.25, temperature_k=5600, lit_windows=0.12,
        exposure_ev=0.3,
    ),
    "spring_overcast": Appearance(cloud_cover=1.0, foliage_density=0.65, sun_elevation_deg=35, exposure_ev=0.2),
    "autumn_morning": Appearance(
        sun_elevation_deg=17, sun_azimuth_deg=60, cloud_cover=0.35, foliage_density=0.7, foliage_autumn=0.9,
        fog_per_m=0.006, wetness=0.25,
    ),
    "autumn_rain": Appearance(
        sun_elevation_deg=20, cloud_cover=1.0, foliage_density=0.5, foliage_autumn=0.8, wetness=1.0, fog_per_m=0.004,
        lit_windows=0.2, exposure_ev=0.3,
    ),
    "winter_noon": Appearance(
        sun_elevation_deg=18, sun_azimuth_deg=230, cloud_cover=0.3, snow=0.9, foliage_density=0.0, foliage_autumn=0.6,
        exposure_ev=0.1,
    ),
    "winter_dusk": Appearance(
        sun_elevation_deg=-3, sun_azimuth_deg=330, cloud_cover=0.4, snow=0.75, foliage_density=0.0, foliage_autumn=0.6,
        night=0.45, lit_windows=0.45, exposure_ev=0.6,
    ),
    "fog": Appearance(cloud_cover=0.9, fog_per_m=0.035, sun_elevation_deg=25, foliage_density=0.85, foliage_autumn=0.2),
    "night_clear": Appearance(sun_elevation_deg=-30, night=1.0, lit_windows=0.35, cloud_cover=0.2, exposure_ev=1.3),
    "night_rain": Appearance(
        sun_elevation_deg=-30, night=1.0, lit_windows=0.3, cloud_cover=1.0, wetness=1.0, fog_per_m=0.004,
        exposure_ev=1.3,
    ),
}  # fmt: skip


def condition(name: str, **factors: float) -> Appearance:
    """The named condition, with some factors set to other values.

    Raises:
        UserError: there is no such condition or factor, or a value is out of range.

    >>> condition("fog", snow=0.5).fog_per_m
    0.035
    """
    if name not in CONDITIONS:
        raise UserError(f"there is no condition {name!r}", f"Choose one of: {', '.join(CONDITIONS)}.")
    return with_factors(CONDITIONS[name], factors)


def with_factors(appearance: Appearance, factors: Mapping[str, Any]) -> Appearance:
    """``appearance`` with some factors set to other values; unknown names are refused."""
    known = [field.name for field in fields(Appearance)]
    for name in factors:
        if name not in known:
            raise UserError(f"an appearance has no factor {name!r}", f"Its factors are: {', '.join(known)}.")
    return replace(appearance, **factors)
