"""An appearance as the numbers that the shading kernels read: colours of sun, sky and fog, and strengths."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.worlds.appearance import Appearance

(
    SUN_X, SUN_Y, SUN_Z, SUN_R, SUN_G, SUN_B, ZENITH_R, ZENITH_G, ZENITH_B, HORIZON_R, HORIZON_G, HORIZON_B,
    BOUNCE_R, BOUNCE_G, BOUNCE_B, FOG_R, FOG_G, FOG_B, FOG, SNOW, AUTUMN, WET, NIGHT, LIT, CLOUD, FOLIAGE, SEED, LAMPS,
    STARS, INDOOR,
) = range(30)  # fmt: skip
LENGTH = 32

#: sun elevation in degrees -> linear RGB of the sun, the zenith and the horizon of a clear sky; a white wall in the
#: noon sun has radiance near 1
_ELEVATION = np.array([-18.0, -6.0, -1.0, 3.0, 12.0, 30.0, 60.0])
_SUN = np.array([
    (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.1, 0.03, 0.01), (0.75, 0.35, 0.13), (1.35, 0.93, 0.56), (1.72, 1.5, 1.18),
    (1.9, 1.75, 1.52),
])  # fmt: skip
_ZENITH = np.array([
    (0.005, 0.008, 0.02), (0.025, 0.045, 0.12), (0.06, 0.10, 0.22), (0.10, 0.17, 0.34), (0.13, 0.25, 0.5),
    (0.13, 0.28, 0.62), (0.12, 0.28, 0.64),
])  # fmt: skip
_HORIZON = np.array([
    (0.018, 0.016, 0.022), (0.16, 0.13, 0.18), (0.5, 0.28, 0.18), (0.72, 0.46, 0.26), (0.68, 0.62, 0.52),
    (0.56, 0.68, 0.8), (0.55, 0.7, 0.86),
])  # fmt: skip


def _at(table: Float64[ndarray, "k 3"], elevation: float) -> Float64[ndarray, "3"]:
    return np.array([np.interp(elevation, _ELEVATION, table[:, c]) for c in range(3)])


def white_balance(temperature_k: float) -> Float64[ndarray, "3"]:
    """Gains of red, green and blue that a camera set to daylight applies to light of ``temperature_k``; 1 at 6500.

    A fit to the colour of a black body, linear in the logarithm of the temperature; accurate enough for a tint.
    """
    x = np.log(temperature_k / 6500.0)
    return np.asarray(np.exp(np.array([-0.45, 0.0, 0.65]) * x))


@lru_cache(maxsize=256)
def pack(appearance: Appearance, *, indoor: bool = False) -> Float64[ndarray, "32"]:
    """The look of ``appearance``; see the names of the indices at the top of this file."""
    a = appearance
    look = np.zeros(LENGTH)
    elevation, azimuth = np.radians(max(a.sun_elevation_deg, 0.5)), np.radians(a.sun_azimuth_deg)
    look[SUN_X : SUN_Z + 1] = (
        np.cos(elevation) * np.cos(azimuth),
        np.cos(elevation) * np.sin(azimuth),
        np.sin(elevation),
    )
    sun, zenith, horizon = (_at(table, a.sun_elevation_deg) for table in (_SUN, _ZENITH, _HORIZON))
    grey = 0.75 * horizon.mean() + 0.25 * zenith.mean()
    overcast = grey * np.array([0.93, 0.98, 1.06]) * 1.15
    cover = float(np.clip((a.cloud_cover - 0.45) / 0.5, 0, 1))
    zenith = zenith + cover * (overcast - zenith)
    horizon = horizon + cover * (0.92 * overcast - horizon)
    sun = sun * (1 - cover) ** 1.5
    glow = 0.035 * a.night * np.array([1.0, 0.72, 0.5])  # the town's lamps light the underside of the clouds
    zenith, horizon = zenith + glow * (0.15 + 0.6 * cover), horizon + glow
    look[SUN_R : SUN_B + 1] = sun
    look[ZENITH_R : ZENITH_B + 1] = zenith
    look[HORIZON_R : HORIZON_B + 1] = horizon
    ground = np.array([0.16, 0.15, 0.13]) * (1 - 0.5 * a.wetness) * (1 - a.snow) + 0.6 * a.snow
    look[BOUNCE_R : BOUNCE_B + 1] = ground * (sun * max(np.sin(elevation), 0) * 0.55 + 0.5 * (zenith + horizon))
    look[FOG_R : FOG_B + 1] = 0.9 * horizon + 0.1 * zenith
    look[FOG] = a.fog_per_m + 0.00035
    look[SNOW], look[AUTUMN], look[WET], look[NIGHT] = a.snow, a.foliage_autumn, a.wetness, a.night
    look[LIT], look[CLOUD], look[FOLIAGE] = a.lit_windows, a.cloud_cover, a.foliage_density
    look[SEED] = a.change_seed % 65536
    look[LAMPS] = a.night
    look[STARS] = max(0.0, min(1.0, -a.sun_elevation_deg / 12)) * (1 - cover)
    look[INDOOR] = float(indoor)
    look.setflags(write=False)
    return look
