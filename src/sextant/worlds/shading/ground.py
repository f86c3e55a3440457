"""Streets, pavements and open ground."""

from math import floor

from sextant.worlds.shading.compiled import compiled
from sextant.worlds.shading.look import AUTUMN, WET
from sextant.worlds.shading.noise import fractal_noise, hash3, keep, smoothstep, value_noise
from sextant.worlds.surfaces import P0, SEED


@compiled
def asphalt(x, y, footprint):
    """Albedo of a road surface at world ``(x, y)``: patches, grain and cracks."""
    base = 0.085 + 0.035 * value_noise(x * 0.21, y * 0.21, 11) + 0.02 * value_noise(x * 1.7, y * 1.7, 12)
    i, j = floor(x / 7.0), floor(y / 7.0)
    if hash3(i, j, 13) > 0.82:  # a repaired patch
        fx, fy = x / 7.0 - i, y / 7.0 - j
        w, h = 0.2 + 0.5 * hash3(i, j, 14), 0.15 + 0.4 * hash3(i, j, 15)
        if abs(fx - 0.5) < 0.5 * w and abs(fy - 0.5) < 0.5 * h:
            base *= 0.72
    grain = keep(footprint, 0.05)
    if grain > 0.0:
        base += 0.035 * grain * (value_noise(x * 33.0, y * 33.0, 16) - 0.5)
    if footprint < 0.12:
        crack = abs(value_noise(x * 0.55 + 0.4 * value_noise(x * 2.0, y * 2.0, 18), y * 0.55, 17) - 0.5)
        if crack < 0.0022 and value_noise(x * 0.09, y * 0.09, 19) > 0.5:
            base *= 1.0 - 0.3 * keep(footprint, 0.05)
    return base, base * 0.99, base * 0.98


@compiled
def road(row, u, v, x, y, footprint, look):
    """Albedo of a street ``u`` metres along its centre line and ``v`` metres to the left of it.

    Returns:
        albedo (3), how far wheels have cleared it of snow (0 to 1).
    """
    length, half, markings, start, end = row[P0], row[P0 + 1], row[P0 + 2], row[P0 + 3], row[P0 + 4]
    r, g, b = asphalt(x, y, footprint)
    lane = 0.5 * half
    track = abs(abs(abs(v) - lane) - 0.75)
    wheel = 1.0 - smoothstep(0.1, 0.45, track)
    dark = 1.0 - 0.1 * wheel
    r, g, b = r * dark, g * dark, b * dark
    white = 0.0
    if markings > 0.5:
        near, far = u, length - u
        if (start > 0.5 and near > 0.8 and near < 3.6) or (end > 0.5 and far > 0.8 and far < 3.6):
            if v - floor(v) < 0.5 and abs(v) < half - 0.3:
                white = 1.0
        elif (start > 0.5 and near > 4.6 and near < 5.0 and v > 0.1 and v < half - 0.3) or (
            end > 0.5 and far > 4.6 and far < 5.0 and v < -0.1 and v > 0.3 - half
        ):
            white = 1.0
        elif near > 5.0 and far > 5.0:
            if abs(v) < 0.075 and (u / 6.0 - floor(u / 6.0) < 0.5):
                white = 1.0
            elif markings > 1.5 and abs(abs(v) - half + 2.15) < 0.06:
                white = 1.0 if u / 5.5 - floor(u / 5.5) < 0.9 else 0.0
    if white > 0.0:
        worn = smoothstep(0.2, 0.55, fractal_noise(x * 1.9, y * 1.9, 21, 2)) * keep(footprint, 0.5)
        k = 0.85 * worn * white
        r, g, b = r + (0.62 - r) * k, g + (0.62 - g) * k, b + (0.6 - b) * k
    i = floor(u / 23.0)
    du, dv = u - (i + 0.2 + 0.6 * hash3(i, 22, int(row[SEED] * 65536.0))) * 23.0, v - lane * 0.8
    d2 = du * du + dv * dv
    if d2 < 0.11 and footprint < 0.4:  # a manhole
        k = 0.6 if d2 > 0.085 else 1.25
        r, g, b = r * k, g * k, b * k
    return r, g, b, wheel


@compiled
def pavement(u, v, seed, footprint):
    """Albedo of paving slabs at ``u`` along and ``v`` across them."""
    size = 0.5
    i, j = floor(u / size), floor(v / size)
    detail = keep(footprint, 0.22)
    shade = 0.27 + 0.07 * value_noise(u * 0.35, v * 0.35, 31) + 0.07 * detail * (hash3(i, j, seed) - 0.5)
    fu, fv = u / size - i, v / size - j
    if detail > 0.0 and (fu < 0.035 or fv < 0.035):
        shade *= 1.0 - 0.4 * detail
    if footprint < 0.1:
        shade *= 0.95 + 0.1 * value_noise(u * 21.0, v * 21.0, 32)
    stain = value_noise(u * 1.4, v * 1.4, 33)
    shade *= 1.0 - 0.18 * stain * stain
    return shade, shade * 0.97, shade * 0.93


@compiled
def grass(x, y, footprint, look):
    """Albedo of a lawn, with fallen leaves in autumn."""
    big = fractal_noise(x * 0.16, y * 0.16, 41, 2)
    fine = 0.5
    if footprint < 0.3:
        blades = 0.4 * value_noise(x * 31.0, y * 31.0, 43) * keep(footprint, 0.1)
        fine = 0.6 * value_noise(x * 9.0, y * 9.0, 42) + blades
    dry = 0.35 * look[AUTUMN]
    r = (0.060 + 0.045 * big + 0.06 * dry) * (0.55 + 0.9 * fine)
    g = (0.105 + 0.05 * big - 0.01 * dry) * (0.55 + 0.9 * fine)
    b = (0.028 + 0.012 * big) * (0.55 + 0.9 * fine)
    if look[AUTUMN] > 0.2 and value_noise(x * 0.7, y * 0.7, 44) < 0.62 * look[AUTUMN]:
        if hash3(floor(x / 0.09), floor(y / 0.09), 45) > 0.72 and footprint < 0.3:
            r, g, b = 0.30, 0.14, 0.03
        elif footprint >= 0.3:
            r, g, b = 0.72 * r + 0.07, 0.72 * g + 0.035, 0.72 * b + 0.008
    return r, g, b


@compiled
def field(x, y, footprint, look):
    """Albedo of the open countryside around a town."""
    i, j = floor(x / 160.0), floor(y / 110.0)
    crop = hash3(i, j, 51)
    r, g, b = grass(x, y, footprint, look)
    if crop > 0.66:
        k = 0.5 + 0.5 * value_noise(x * 0.05, y * 2.0, 52) * keep(footprint, 1.5)
        r, g, b = 0.5 * r + 0.16 * k, 0.5 * g + 0.13 * k, 0.5 * b + 0.05 * k
    elif crop < 0.25:
        k = 0.6 + 0.5 * value_noise(x * 1.3, y * 0.1, 53)
        r, g, b = 0.13 * k, 0.095 * k, 0.065 * k
    return r, g, b


@compiled
def puddle(x, y, look):
    """How deep water stands at world ``(x, y)``, 0 to 1."""
    wet = look[WET]
    return smoothstep(0.62 - 0.35 * wet, 0.8 - 0.3 * wet, fractal_noise(x * 0.3, y * 0.3, 61, 2)) * wet
