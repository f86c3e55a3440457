"""What is seen indoors: walls, floors, ceilings, doors and furniture, and the light of lamps and windows on them.

Every indoor row ends with three numbers of its room: the lamp light and the daylight that its walls scatter, and the
share of its lamps that are on by day (``LAMP_FILL``, ``DAY_FILL``, ``BURN``). No ray is cast for light: a grid of cells
lists the lamps and windows of the room that a point is in, and holds the contact shadow of the furniture there.
"""

from math import floor, sqrt

from sextant.worlds.shading.compiled import compiled
from sextant.worlds.shading.look import (
    HORIZON_B,
    HORIZON_G,
    HORIZON_R,
    INDOOR,
    NIGHT,
    SUN_B,
    SUN_G,
    SUN_R,
    ZENITH_B,
    ZENITH_G,
    ZENITH_R,
)  # fmt: skip
from sextant.worlds.shading.noise import clamp, fractal_noise, hash3, keep, smoothstep, value_noise
from sextant.worlds.shading.sky import sky
from sextant.worlds.surfaces import BLUE, BLUE2, GREEN, GREEN2, P0, RED, RED2, SEED, Kind

WALL, FLOOR, CEILING, DOOR, WOOD, POSTER, SCREEN, WINDOW, SHELF = (int(kind) for kind in list(Kind)[int(Kind.WALL) :])
LAMP_FILL, DAY_FILL, BURN = P0 + 7, P0 + 8, P0 + 9
#: lights above this height are ceiling lamps, those below are windows; how far a light reaches, metres
LAMP_ABOVE_M, REACH_M = 2.45, 6.0
#: contact shadows are stored as integers up to this number, which is full shadow
SHADOW_STEPS = 1000.0


@compiled
def panel(u, w, width, depth, columns, rows):
    """Whether a point of a ceiling is on a lamp panel of 1.2 by 0.3 m on a lattice: 0 no, 1 its light, 2 its frame."""
    if columns < 1.0 or rows < 1.0:
        return 0
    pu, pw = width / columns, depth / rows
    du = abs(u - (floor(u / pu) + 0.5) * pu)
    dw = abs(w - (floor(w / pw) + 0.5) * pw)
    if width < depth:
        du, dw = dw, du
    if du > 0.62 or dw > 0.17:
        return 0
    return 1 if du < 0.595 and dw < 0.145 and abs(dw) > 0.006 else 2


@compiled
def corner(u, width, low, high):
    """How much light reaches a surface near the inner corners at its ends: 1 far from them."""
    k = 1.0
    if low > 0.5:
        k *= 0.80 + 0.20 * smoothstep(-0.15, 0.65, u)
    if high > 0.5:
        k *= 0.80 + 0.20 * smoothstep(-0.15, 0.65, width - u)
    return k


@compiled
def daylight(look):
    """Linear RGB of the light that comes through a window."""
    r = 0.4 * look[ZENITH_R] + 0.5 * look[HORIZON_R] + 0.35 * look[SUN_R]
    g = 0.4 * look[ZENITH_G] + 0.5 * look[HORIZON_G] + 0.35 * look[SUN_G]
    b = 0.4 * look[ZENITH_B] + 0.5 * look[HORIZON_B] + 0.35 * look[SUN_B]
    return r, g, b


@compiled
def burning_share(row, look):
    """Share of a room's lamps that are on: all at night and on dull days, the room's own share in bright daylight."""
    _, day, _ = daylight(look)
    dull = max(look[NIGHT], 1.0 - smoothstep(0.45, 0.9, day))
    return row[BURN] + (1.0 - row[BURN]) * dull


@compiled
def outside(dx, dy, dz, look):
    """What is seen through a window: the sky above a row of distant trees and houses, with a lawn below."""
    a = dx / (abs(dx) + abs(dy) + 1e-9)
    a = a if dy >= 0.0 else 2.0 - a
    level = sqrt(dx * dx + dy * dy) + 1e-9
    slope = dz / level
    r, g, b = daylight(look)
    top = 0.03 + 0.12 * value_noise(a * 9.0, 3.0, 401) + 0.05 * value_noise(a * 45.0, 5.0, 402)
    if hash3(floor(a * 7.0), 1, 403) > 0.6:
        top = max(top, 0.05 + 0.16 * hash3(floor(a * 7.0), 2, 403))
        if slope < top and slope > 0.0:
            dark = 0.55 if hash3(floor(a * 160.0), floor(slope * 40.0), 404) > 0.6 else 1.0
            lit = look[NIGHT] * (1.0 if dark < 1.0 and hash3(floor(a * 160.0), floor(slope * 40.0), 405) > 0.7 else 0.0)
            return 0.34 * r * dark + 0.5 * lit, 0.31 * g * dark + 0.36 * lit, 0.28 * b * dark + 0.16 * lit
    if slope < top and slope > -0.01:
        k = 0.6 + 0.7 * value_noise(a * 70.0, slope * 30.0, 406)
        return 0.09 * k * r, 0.13 * k * g, 0.06 * k * b
    if slope <= -0.01:
        k = 0.8 + 0.4 * value_noise(dx / (0.05 - dz) * 3.0, dy / (0.05 - dz) * 3.0, 407)
        return 0.16 * k * r, 0.21 * k * g, 0.10 * k * b
    return sky(dx, dy, dz, look, True)


@compiled
def wall(row, u, oz, footprint):
    """Albedo of a pale wall with a skirting board, darker towards its corners."""
    r, g, b = row[RED], row[GREEN], row[BLUE]
    seed = int(row[SEED] * 16777216.0)
    board = row[P0 + 2]
    k = (
        0.975
        + 0.035 * value_noise(u * 0.7, oz * 0.7, seed)
        + 0.015 * value_noise(u * 55.0, oz * 55.0, seed) * keep(footprint, 0.02)
    )
    if oz < board:
        r, g, b = row[RED2], row[GREEN2], row[BLUE2]
        if oz > board - 0.008:
            k *= 1.0 - 0.35 * keep(footprint, 0.01)
    k *= corner(u, row[P0], row[P0 + 3], row[P0 + 4])
    k *= 0.86 + 0.14 * smoothstep(0.0, 0.45, oz)
    k *= 0.80 + 0.20 * smoothstep(0.0, 0.5, row[P0 + 1] - oz)
    return k * r, k * g, k * b


@compiled
def floors(row, u, w, footprint):
    """Albedo and gloss of carpet, tiles, planks or linoleum, darker towards the walls of the room."""
    r, g, b = row[RED], row[GREEN], row[BLUE]
    seed, style, gloss = int(row[SEED] * 16777216.0), int(row[P0]), 0.0
    if style == 1:
        i, j = floor(u / 0.6), floor(w / 0.6)
        k = 0.94 + 0.1 * hash3(i, j, seed) * keep(footprint, 0.5)
        k += 0.05 * (value_noise(u * 9.0, w * 9.0, seed) - 0.5) * keep(footprint, 0.1)
        if u / 0.6 - i < 0.012 or w / 0.6 - j < 0.012:
            k *= 1.0 - 0.35 * keep(footprint, 0.03)
        gloss = 0.5
    elif style == 2:
        i = floor(w / 0.14)
        j = floor(u / 1.6 + hash3(i, 99, seed))
        fine = keep(footprint, 0.12)
        k = (
            1.0
            + (0.34 * hash3(i, j, seed) - 0.17) * fine
            + 0.14 * (value_noise(u * 3.0, w * 45.0, seed) - 0.5) * keep(footprint, 0.03)
        )
        if w / 0.14 - i < 0.02:
            k *= 1.0 - 0.3 * keep(footprint, 0.012)
        gloss = 0.4
    elif style == 3:
        k = 0.95 + 0.1 * fractal_noise(u * 2.0, w * 2.0, seed, 2)
        k += 0.12 * (value_noise(u * 40.0, w * 40.0, seed) - 0.5) * keep(footprint, 0.03)
        gloss = 0.75
    else:
        k = 0.93 + 0.12 * fractal_noise(u * 1.5, w * 1.5, seed, 2)
        k += 0.3 * keep(footprint, 0.02) * (value_noise(u * 70.0, w * 70.0, seed) - 0.5)
    mask = int(row[P0 + 3])
    k *= corner(u, row[P0 + 1], float(mask & 8), float(mask & 2)) * corner(
        w, row[P0 + 2], float(mask & 1), float(mask & 4)
    )
    return k * r, k * g, k * b, gloss


@compiled
def ceiling(row, u, w, footprint, look):
    """Albedo and emission of a ceiling of 0.6 m boards with lamp panels."""
    r, g, b = row[RED], row[GREEN], row[BLUE]
    side, width, depth = row[P0], row[P0 + 2], row[P0 + 3]
    on = panel(u, w, width, depth, row[P0 + 5], row[P0 + 6])
    if on == 2:
        return 0.55 * r, 0.55 * g, 0.55 * b, 0.0, 0.0, 0.0
    if on == 1:
        e = 2.6 * row[P0 + 1] * burning_share(row, look)
        return 0.8 * r, 0.8 * g, 0.8 * b, e, 0.97 * e, 0.88 * e
    cu, cw = u - 0.5 * width, w - 0.5 * depth
    fu, fw = cu / side - floor(cu / side), cw / side - floor(cw / side)
    k = 1.0 - 0.06 * value_noise(u * 30.0, w * 30.0, 17) * keep(footprint, 0.03)
    if fu < 0.025 or fw < 0.025:
        k *= 1.0 - 0.22 * keep(footprint, 0.025)
    mask = int(row[P0 + 4])
    k *= corner(u, width, float(mask & 8), float(mask & 2)) * corner(w, depth, float(mask & 1), float(mask & 4))
    return k * r, k * g, k * b, 0.0, 0.0, 0.0


@compiled
def cork(u, v, edge, seed, footprint):
    """Albedo of a pinboard: notes on cork in a wooden frame."""
    if edge < 0.03:
        return 0.32, 0.2, 0.1
    k = 0.85 + 0.3 * value_noise(u * 60.0, v * 60.0, seed) * keep(footprint, 0.03)
    r, g, b = 0.42 * k, 0.27 * k, 0.14 * k
    i, j = floor(u / 0.26), floor(v / 0.32)
    h = hash3(i, j, seed)
    fu, fv = u - i * 0.26 - 0.03 - 0.05 * h, v - j * 0.32 - 0.02 - 0.06 * hash3(i, j, seed + 1)
    if h > 0.3 and fu > 0.0 and fu < 0.15 and fv > 0.0 and fv < 0.2 + 0.04 * h:
        c, line = hash3(i, j, seed + 2), floor(fv / 0.022)
        r, g, b = 0.75, 0.75 - 0.25 * (c > 0.75), 0.72 - 0.5 * (c > 0.6)
        if line % 2 == 0 and fu > 0.015 and fu < 0.02 + 0.12 * hash3(line, i, seed + j):
            k = 1.0 - 0.6 * keep(footprint, 0.025)
            r, g, b = r * k, g * k, b * k
    return r, g, b


@compiled
def printed(row, across, top, u, v, seed, footprint):
    """Albedo of a poster: a coloured title, and a grid of pictures and blocks of text."""
    r, g, b = row[RED], row[GREEN], row[BLUE]
    if top > 0.84:
        r, g, b = row[RED2], row[GREEN2], row[BLUE2]
        if abs(top - 0.91) < 0.025 and across > 0.1 and across < 0.85 and hash3(floor(u / 0.03), 1, seed) > 0.2:
            k = keep(footprint, 0.04)
            r, g, b = r + (0.8 - r) * k, g + (0.8 - g) * k, b + (0.8 - b) * k
        return r, g, b
    i, j = floor(across * 3.0), floor(top / 0.84 * 4.0)
    fu, fv = across * 3.0 - i, top / 0.84 * 4.0 - j
    if fu < 0.06 or fu > 0.94 or fv < 0.08 or fv > 0.94:
        return r, g, b
    h = hash3(i, j, seed)
    if h > 0.62:
        t, c = value_noise(u * 14.0, v * 14.0, seed), 0.15 + 0.5 * hash3(i, j, seed + 4)
        r = c * (0.5 + t)
        g = 0.8 * c * (1.4 - t) * (0.5 + hash3(i, j, seed + 5))
        b = c * (0.4 + 0.8 * hash3(i, j, seed + 6))
    elif h > 0.15:
        line = v / 0.024 - floor(v / 0.024)
        if line < 0.5 and hash3(floor(v / 0.024), floor(u / 0.02), seed) > 0.12:
            k = 1.0 - 0.8 * keep(footprint, 0.03)
            r, g, b = r * k, g * k, b * k
    return r, g, b


@compiled
def poster(row, u, oz, footprint):
    """A framed sheet: a title, blocks of text and pictures, or cork with notes (a seed above 0.7)."""
    width, height = row[P0], row[P0 + 1]
    seed = int(row[SEED] * 16777216.0)
    r, g, b = row[RED], row[GREEN], row[BLUE]
    edge = min(u, width - u, oz, height - oz)
    if width < 0.3:  # a name plate
        if abs(oz - 0.6 * height) < 0.1 * height and u > 0.15 * width and u < (0.5 + 0.4 * row[SEED]) * width:
            k = 1.0 - 0.8 * keep(footprint, 0.03)
            return r * k, g * k, b * k
        return r, g, b
    if row[SEED] > 0.7:
        return cork(u, oz, edge, seed, footprint)
    if edge < 0.02:
        return 0.75, 0.75, 0.73
    return printed(row, u / width, oz / height, u, oz, seed, footprint)


@compiled
def screen(row, u, oz, footprint):
    """Light of a screen: windows with lines of text on a plain ground, or dark."""
    width, height, on = row[P0], row[P0 + 1], row[P0 + 2]
    seed = int(row[SEED] * 16777216.0)
    edge = min(u, width - u, oz, height - oz)
    if edge < 0.012 or on <= 0.0:
        return 0.0, 0.0, 0.0
    e = 0.55 * on
    split = 0.3 + 0.4 * hash3(1, 2, seed)
    fu, fv = u / width, oz / height
    r, g, b = 0.10, 0.2, 0.36
    if fu > 0.06 and fu < split + 0.2 and fv > 0.12 and fv < 0.93:
        r, g, b = 0.85, 0.87, 0.9
        n = floor(fv * 30.0)
        if fv < 0.86 and n % 2 == 0 and fu < 0.1 + (split + 0.06) * hash3(n, 3, seed):
            k = 1.0 - 0.7 * keep(footprint, 0.012)
            r, g, b = r * k, g * k, b * k
    elif fu > split and fv > 0.3 and fv < 0.8 and fu < 0.95:
        r, g, b = 0.04, 0.05, 0.06
        n = floor(fv * 36.0)
        if n % 2 == 0 and fu < split + 0.25 + 0.3 * hash3(n, 4, seed) and fu > split + 0.22:
            g += 0.5 * keep(footprint, 0.012)
    return e * r, e * g, e * b


@compiled
def door(row, u, v, seed):
    """Albedo and gloss of a door leaf: a handle, and by its seed a pane of glass or a kick plate."""
    width, height = row[P0], row[P0 + 1]
    handle = abs(v - 1.05) < 0.012 and u > 0.80 * width and u < 0.93 * width
    if handle or (abs(u - 0.93 * width) < 0.022 and abs(v - 1.05) < 0.09):
        return 0.45, 0.45, 0.46, 0.5
    if row[SEED] > 0.6 and abs(u - 0.5 * width) < 0.13 and v > 1.2 and v < 1.85:
        return 0.12, 0.13, 0.14, 0.8
    if v < 0.2 and min(u, width - u, height - v) > 0.05 and row[SEED] < 0.35:
        return 0.5, 0.5, 0.5, 0.4
    k = 0.94 + 0.1 * value_noise(u * 30.0, v * 1.6, seed)
    return k * row[RED], k * row[GREEN], k * row[BLUE], 0.12


@compiled
def grain(u, w, v, nz, seed, footprint):
    """Brightness of wood: the grain runs along the width of level surfaces, and up upright ones."""
    along, across = (u, w) if abs(nz) > 0.7 else (v, u + w)
    k = value_noise(across * 30.0, along * 1.6, seed) + 0.5 * value_noise(across * 110.0, along * 3.0, seed)
    return 0.97 + 0.16 * (k - 0.75) * keep(footprint, 0.05)


@compiled
def window(row, u, v, dx, dy, dz, look):
    """Albedo, emission and gloss of a window: its frame, and what is outside."""
    width, height = row[P0], row[P0 + 1]
    if min(u, width - u, v, height - v) < 0.05 or (abs(u - 0.5 * width) < 0.035 and width > 1.0):
        return 0.72, 0.72, 0.71, 0.0, 0.0, 0.0, 0.1
    er, eg, eb = outside(dx, dy, dz, look)
    return 0.015, 0.017, 0.02, min(er, 1.7), min(eg, 1.7), min(eb, 1.7), 1.0


@compiled
def books(row, u, v, nz, seed):
    """Albedo of shelves: boards, books of many colours, and rows of binders."""
    r, g, b = row[RED], row[GREEN], row[BLUE]
    width, height, boards = row[P0], row[P0 + 1], max(row[P0 + 2], 1.0)
    board = (height - 0.025) / boards
    i = floor(v / board)
    fy = v - i * board
    if fy <= 0.025 or min(u, width - u) <= 0.022 or abs(nz) >= 0.5 or v >= height - 0.025:
        return r, g, b
    k = 0.75 + 0.25 * smoothstep(0.0, 0.5, 1.0 - fy / board)
    wide = 0.03 + 0.05 * hash3(i, 7, seed)
    book, group = floor(u / wide), floor(u / 0.4)
    if fy >= (0.55 + 0.35 * hash3(book, i, seed)) * board or hash3(group, i, seed + 2) <= 0.25:
        return 0.3 * k * r, 0.3 * k * g, 0.3 * k * b
    k *= 0.35 + 0.65 * smoothstep(0.0, 0.25 * wide, min(u - book * wide, (book + 1.0) * wide - u))
    if hash3(group, i, seed + 5) > 0.6:
        pale = 0.7 if fy > 0.35 * board and fy < 0.6 * board else 0.17
        return k * pale, k * pale, k * pale
    h, t = hash3(book, i, seed + 1), hash3(book, i, seed + 3)
    r, g = 0.08 + 0.5 * h * h, 0.07 + 0.4 * t * t
    return k * r, k * g, k * (0.07 + 0.45 * hash3(book, i, seed + 4) * (1.0 - 0.5 * h))


@compiled
def interior(row, kind, u, w, oz, nz, dx, dy, dz, footprint, look):
    """What an indoor surface looks like at ``(u, w, oz)`` in its texture frame.

    Returns:
        albedo (3), emission (3), gloss.
    """
    r, g, b = row[RED], row[GREEN], row[BLUE]
    er, eg, eb, gloss = 0.0, 0.0, 0.0, 0.0
    seed = int(row[SEED] * 16777216.0)
    if kind == WALL:
        r, g, b = wall(row, u, oz, footprint)
    elif kind == FLOOR:
        r, g, b, gloss = floors(row, u, w, footprint)
    elif kind == CEILING:
        r, g, b, er, eg, eb = ceiling(row, u, w, footprint, look)
    elif kind == DOOR:
        r, g, b, gloss = door(row, u, oz, seed)
    elif kind == WOOD:
        k = grain(u, w, oz, nz, seed, footprint)
        r, g, b = r * k, g * k, b * k
        gloss = 0.03 + 0.27 * look[INDOOR]  # varnished indoors, weathered outside
    elif kind == POSTER:
        r, g, b = poster(row, u, oz, footprint)
        gloss = 0.06
    elif kind == SCREEN:
        er, eg, eb = screen(row, u, oz, footprint)
        r, g, b, gloss = 0.015, 0.016, 0.02, 0.7
    elif kind == WINDOW:
        r, g, b, er, eg, eb, gloss = window(row, u, oz, dx, dy, dz, look)
    elif kind == SHELF:
        r, g, b = books(row, u, oz, nz, seed)
    return r, g, b, er, eg, eb, gloss


@compiled
def shadow(cells, origin, x, y):
    """The contact shadow at a point of the floor, 0 to 1, blended between cells."""
    gx, gy = (x - origin[0]) / origin[2] - 0.5, (y - origin[1]) / origin[2] - 0.5
    i, j = floor(gx), floor(gy)
    if i < 0 or j < 0 or i + 1 >= cells.shape[0] or j + 1 >= cells.shape[1]:
        return 0.0
    last = cells.shape[2] - 1
    fx, fy = gx - i, gy - j
    a = cells[i, j, last] * (1.0 - fx) + cells[i + 1, j, last] * fx
    b = cells[i, j + 1, last] * (1.0 - fx) + cells[i + 1, j + 1, last] * fx
    return max(a * (1.0 - fy) + b * fy, 0.0) / SHADOW_STEPS


@compiled
def room_light(x, y, z, nx, ny, nz, mx, my, mz, lamps, cells, origin):
    """Light from the lights of its room at a point with normal ``n``, seen by a ray reflected to ``m``.

    Returns:
        light of lamps and of windows, and highlights of lamps and of windows.
    """
    lamp_light, day_light, lamp_shine, day_shine = 0.0, 0.0, 0.0, 0.0
    gx, gy = floor((x + 0.1 * nx - origin[0]) / origin[2]), floor((y + 0.1 * ny - origin[1]) / origin[2])
    if gx < 0 or gy < 0 or gx >= cells.shape[0] or gy >= cells.shape[1]:
        return lamp_light, day_light, lamp_shine, day_shine
    for n in range(cells.shape[2] - 1):
        lamp = cells[gx, gy, n]
        if lamp < 0:
            break
        qx, qy, qz = lamps[lamp, 0] - x, lamps[lamp, 1] - y, lamps[lamp, 2] - z
        q2 = qx * qx + qy * qy + qz * qz + 1e-9
        q = sqrt(q2)
        if q > REACH_M:
            continue
        fade = 1.0 - smoothstep(0.5 * REACH_M, REACH_M, q)
        facing = (nx * qx + ny * qy + nz * qz) / q
        shine = clamp((mx * qx + my * qy + mz * qz) / q, 0.0, 1.0)
        shine *= shine
        shine *= shine
        shine *= shine
        shine *= shine
        shine *= shine  # to the 32nd
        if lamps[lamp, 2] > LAMP_ABOVE_M:
            down = clamp(qz / q, 0.0, 1.0)
            lamp_light += fade * 1.7 * (0.15 + 0.85 * down) * max(facing, 0.0) / (q2 + 0.9)
            lamp_shine += fade * shine * shine * shine
        else:
            day_light += fade * 1.5 * clamp((facing + 0.15) / 1.15, 0.0, 1.0) / (q2 + 0.7)
            day_shine += fade * 0.55 * shine
    return lamp_light, day_light, lamp_shine, day_shine


@compiled
def indoor_light(row, r, g, b, gloss, x, y, z, nx, ny, nz, dx, dy, dz, along, lamps, cells, origin, look):
    """Light that a point of albedo ``(r, g, b)`` reflects back along the unit ray ``d``, without what it emits.

    ``albedo (fill + sum of lamps and windows) + gloss (their highlights)``: a lamp gives
    ``I cos(out) max(n.l, 0) / (d^2 + s)``, a window the same without its own cosine; both fade out at ``REACH_M``.
    """
    k = -2.0 * along
    lamp, day, lamp_shine, day_shine = room_light(
        x, y, z, nx, ny, nz, dx + k * nx, dy + k * ny, dz + k * nz, lamps, cells, origin
    )
    burning = burning_share(row, look)
    day_r, day_g, day_b = daylight(look)
    lamp_fill, day_fill = row[LAMP_FILL] * burning, row[DAY_FILL]
    lamp = lamp * burning + lamp_fill * (1.0 + 0.12 * nz)
    day += day_fill * (1.0 - 0.1 * nz)
    dim = 1.0
    if z < 0.9:
        deep = shadow(cells, origin, x + 0.03 * nx, y + 0.03 * ny)
        if nz > 0.9 and z > 0.02:
            deep *= 0.35 * (1.0 - z / 0.9)
        elif nz < 0.9:
            deep *= 0.45 * (1.0 - z / 0.9)
        dim = 1.0 - 0.72 * deep
    if nz < 0.5 and z < 0.5:
        dim *= 0.84 + 0.16 * smoothstep(-0.1, 0.5, z)
    cr, cg, cb = (
        r * dim * (lamp + day * day_r),
        g * dim * (0.96 * lamp + day * day_g),
        b * dim * (0.87 * lamp + day * day_b),
    )
    if gloss > 0.0:
        one = clamp(1.0 + along, 0.0, 1.0)
        share = gloss * (0.07 + 0.7 * one * one * one * one) * dim
        blur, lamp_shine, day_shine = 0.35 * (lamp_fill + day_fill), 3.0 * burning * lamp_shine, 3.0 * day_shine
        cr = cr * (1.0 - 0.5 * share) + share * (blur + lamp_shine + day_shine * day_r)
        cg = cg * (1.0 - 0.5 * share) + share * (0.97 * blur + 0.96 * lamp_shine + day_shine * day_g)
        cb = cb * (1.0 - 0.5 * share) + share * (0.92 * blur + 0.87 * lamp_shine + day_shine * day_b)
    return cr, cg, cb
