"""Radiance of the sky along a direction: gradient, sun, clouds, stars, and hills on the horizon."""

from math import exp, floor, sqrt

from sextant.worlds.shading.compiled import compiled
from sextant.worlds.shading.look import (
    CLOUD,
    FOG,
    HORIZON_B,
    HORIZON_G,
    HORIZON_R,
    SNOW,
    STARS,
    SUN_B,
    SUN_G,
    SUN_R,
    SUN_X,
    SUN_Y,
    SUN_Z,
    ZENITH_B,
    ZENITH_G,
    ZENITH_R,
)  # fmt: skip
from sextant.worlds.shading.noise import clamp, fractal_noise, hash3, smoothstep, value_noise


@compiled
def sky(dx, dy, dz, look, detail):
    """Linear RGB of the sky towards a unit vector; without ``detail`` it has no clouds and hills (for reflections)."""
    up = clamp(dz, 0.0, 1.0)
    blend = (1.0 - up) ** 5
    blend = clamp(blend + 0.25 * exp(-up * 7.0), 0.0, 1.0)
    r = look[ZENITH_R] + (look[HORIZON_R] - look[ZENITH_R]) * blend
    g = look[ZENITH_G] + (look[HORIZON_G] - look[ZENITH_G]) * blend
    b = look[ZENITH_B] + (look[HORIZON_B] - look[ZENITH_B]) * blend
    towards = dx * look[SUN_X] + dy * look[SUN_Y] + dz * look[SUN_Z]
    if towards > 0.0:
        p2 = towards * towards
        p8 = p2 * p2 * p2 * p2
        p64 = p8 * p8 * p8 * p8 * p8 * p8 * p8 * p8
        halo = 0.06 * p8 + 0.35 * p64
        r, g, b = r + halo * look[SUN_R], g + halo * look[SUN_G], b + halo * look[SUN_B]
    if not detail:
        return r, g, b
    if towards > 0.99996:
        r, g, b = r + 12.0 * look[SUN_R], g + 12.0 * look[SUN_G], b + 12.0 * look[SUN_B]
    cover = look[CLOUD]
    if up > 0.015 and cover > 0.0:
        x, y = dx / (up + 0.12), dy / (up + 0.12)
        n = fractal_noise(x * 1.3 + 5.0, y * 1.3, 911, 4)
        low = 0.72 - 0.5 * cover
        amount = smoothstep(low, low + 0.22, n) * smoothstep(0.015, 0.12, up)
        thick = smoothstep(low + 0.05, low + 0.4, n)
        lit = (0.55 + 0.45 * clamp(towards, 0.0, 1.0)) * (1.0 - 0.55 * thick)
        grey = (look[HORIZON_R] + look[HORIZON_G] + look[HORIZON_B]) / 3.0
        cr = 0.55 * grey * (1.15 - 0.5 * thick) + 0.42 * lit * look[SUN_R]
        cg = 0.55 * grey * (1.16 - 0.5 * thick) + 0.42 * lit * look[SUN_G]
        cb = 0.55 * grey * (1.22 - 0.5 * thick) + 0.42 * lit * look[SUN_B]
        amount *= 0.9
        r, g, b = r + (cr - r) * amount, g + (cg - g) * amount, b + (cb - b) * amount
    if look[STARS] > 0.0 and up > 0.05:
        x, y = dx / (up + 0.5) * 70.0 + 1000.0, dy / (up + 0.5) * 70.0 + 1000.0
        i, j = floor(x), floor(y)
        fx, fy = x - i - 0.2 - 0.6 * hash3(i, j, 79), y - j - 0.2 - 0.6 * hash3(i, j, 80)
        if hash3(i, j, 77) > 0.97 and fx * fx + fy * fy < 0.008:
            s = 0.5 * look[STARS] * hash3(i, j, 78)
            r, g, b = r + s, g + s, b + s
    if dz < 0.12:
        level = sqrt(dx * dx + dy * dy) + 1e-9
        cx, cy = dx / level, dy / level
        for k in range(2):  # two ranges of hills, the farther one paler
            far = 1 - k
            height = (0.012 + 0.05 * value_noise(cx * (5.0 - 2.0 * far) + 9.0, cy * (5.0 - 2.0 * far), 301 + k)) * (
                1.0 + 0.5 * far
            )
            height += 0.004 * value_noise(cx * 45.0, cy * 45.0, 303 + k)
            if dz < height:
                haze = exp(-look[FOG] * (1500.0 + 2500.0 * far))
                haze = clamp(haze * 0.75, 0.0, 0.65)
                light = 0.35 * (look[ZENITH_R] + look[ZENITH_G] + look[ZENITH_B]) / 3.0 + 0.22 * look[SUN_G] * sqrt(
                    look[SUN_Z]
                )
                s = look[SNOW]
                hr = (0.10 + 0.55 * s) * light
                hg = (0.15 + 0.52 * s) * light
                hb = (0.09 + 0.62 * s) * light
                r, g, b = r + (hr - r) * haze, g + (hg - g) * haze, b + (hb - b) * haze
    return r, g, b
