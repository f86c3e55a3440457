"""Hashes and smooth noise: the random numbers of textures, pure functions of position."""

from math import floor

from sextant.worlds.shading.compiled import compiled


@compiled
def hash3(i, j, k):
    """A number in [0, 1) for three integers."""
    h = (int(i) * 374761393 + int(j) * 668265263 + int(k) * 2246822519 + 3266489917) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 2246822519) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 3266489917) & 0xFFFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFFFFFF) / 4294967296.0


@compiled
def clamp(x, low, high):
    """``x`` kept within ``[low, high]``."""
    return low if x < low else (high if x > high else x)


@compiled
def smoothstep(low, high, x):
    """0 below ``low``, 1 above ``high``, ``3t^2 - 2t^3`` between."""
    t = clamp((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


@compiled
def value_noise(x, y, seed):
    """Smooth noise in [0, 1) with features of size one: hashes of the lattice, blended by a smooth step."""
    i, j = floor(x), floor(y)
    fx, fy = x - i, y - j
    fx, fy = fx * fx * (3.0 - 2.0 * fx), fy * fy * (3.0 - 2.0 * fy)
    a, b = hash3(i, j, seed), hash3(i + 1, j, seed)
    c, d = hash3(i, j + 1, seed), hash3(i + 1, j + 1, seed)
    return (a + (b - a) * fx) * (1.0 - fy) + (c + (d - c) * fx) * fy


@compiled
def fractal_noise(x, y, seed, octaves):
    """Sum of ``octaves`` of value noise, each twice as fine and half as strong, scaled to [0, 1)."""
    total, weight, scale = 0.0, 0.0, 1.0
    for k in range(octaves):
        total += value_noise(x * scale + 17.3 * k, y * scale - 9.1 * k, seed + 31 * k) / scale
        weight += 1.0 / scale
        scale *= 2.0
    return total / weight


@compiled
def keep(footprint, size):
    """How much of a detail of ``size`` survives in a pixel covering ``footprint``: 1 if well resolved, 0 if finer."""
    return clamp(1.4 - footprint / size, 0.0, 1.0)
