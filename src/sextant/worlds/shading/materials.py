"""One function for what is seen at a point of any surface."""

from math import floor, sqrt

from sextant.worlds.shading.compiled import compiled
from sextant.worlds.shading.facade import facade
from sextant.worlds.shading.ground import field, grass, pavement, road
from sextant.worlds.shading.interior import WALL, interior
from sextant.worlds.shading.look import AUTUMN, NIGHT
from sextant.worlds.shading.noise import clamp, fractal_noise, hash3, keep, smoothstep, value_noise
from sextant.worlds.surfaces import BLUE, BLUE2, COS, GREEN, GREEN2, KIND, P0, RED, RED2, SEED, SIN, Kind, X, Y, Z

(
    PLAIN, FACADE, ROOF, ROAD, PAVEMENT, GRASS, KERB, BARK, LEAVES, CONIFER, CAR, HEDGE, SIGN, LAMP, PERSON, FIELD,
    AWNING, FENCE,
) = (int(kind) for kind in list(Kind)[:WALL])  # fmt: skip


@compiled
def car(row, px, py, pz, nz, look):
    """A car in its own frame (x forward): wheels, glass, lights and paint by position."""
    length, width, height = row[P0], row[P0 + 1], row[P0 + 2]
    r, g, b = row[RED], row[GREEN], row[BLUE]
    axle = 0.3 * length
    dx = min(abs(px - axle), abs(px + axle))
    d2 = dx * dx + (pz - 0.33) * (pz - 0.33)
    if d2 < 0.125 and abs(py) > 0.5 * width - 0.27:
        if d2 < 0.045:
            return 0.38, 0.38, 0.39, 0.0, 0.0, 0.0, 0.12
        return 0.018, 0.018, 0.018, 0.0, 0.0, 0.0, 0.0
    if pz < 0.27:
        return 0.03, 0.03, 0.03, 0.0, 0.0, 0.0, 0.0
    waist = 0.62 * height
    if pz > waist + 0.03 and pz < height - 0.09 and nz < 0.93:
        pillar = abs(px + 0.02 * length)
        if pillar > 0.05:
            return 0.02, 0.022, 0.025, 0.0, 0.0, 0.0, 0.85
    if abs(px) > 0.5 * length - 0.12 and pz > 0.52 and pz < 0.76 and abs(py) > 0.5 * width - 0.42:
        on = row[P0 + 3] * (0.12 + look[NIGHT])
        if px > 0.0:
            return 0.7, 0.7, 0.68, 2.2 * on, 2.1 * on, 1.8 * on, 0.3
        return 0.42, 0.02, 0.015, 1.4 * on, 0.08 * on, 0.05 * on, 0.2
    if abs(px) > 0.5 * length - 0.1 and abs(py) < 0.27 and pz > 0.42 and pz < 0.54:
        return 0.75, 0.75, 0.7, 0.0, 0.0, 0.0, 0.0
    if abs(px) > 0.5 * length - 0.12 and pz < 0.45:
        return 0.05, 0.05, 0.05, 0.0, 0.0, 0.0, 0.05
    seam = abs(abs(px + 0.02 * length) - 0.19 * length)
    if seam < 0.012 and nz < 0.5:
        return 0.3 * r, 0.3 * g, 0.3 * b, 0.0, 0.0, 0.0, 0.1
    return r, g, b, 0.0, 0.0, 0.0, 0.28 if row[SEED] < 0.75 else 0.18


@compiled
def leaves(row, triangle, px, py, pz, look):
    """Albedo of foliage; in autumn each tree changes colour at its own time."""
    seed = row[SEED]
    tint = hash3(triangle, 91, 0)
    r, g, b = row[RED] * (0.7 + 0.6 * tint), row[GREEN] * (0.75 + 0.5 * tint), row[BLUE] * (0.7 + 0.6 * tint)
    turned = smoothstep(seed * 0.9, seed * 0.9 + 0.35, look[AUTUMN] * (0.85 + 0.3 * tint))
    if turned > 0.0:
        k = hash3(int(seed * 65536.0), 92, 0) + 0.35 * (tint - 0.5)
        ar, ag, ab = 0.42 + 0.1 * tint, 0.28 - 0.22 * clamp(k, 0.0, 1.0), 0.035
        r, g, b = r + (ar - r) * turned, g + (ag - g) * turned, b + (ab - b) * turned
    depth = sqrt(px * px + py * py + pz * pz) / row[P0]
    shade = 0.32 + 0.68 * smoothstep(0.25, 0.95, depth)
    shade *= 0.75 + 0.25 * smoothstep(-0.8, 0.5, pz / row[P0])
    return r * shade, g * shade, b * shade


@compiled
def roof(row, u, w, oz, nz, seed, footprint):
    """Brightness of courses of tiles, or of gravel on a flat roof."""
    if row[P0] > 0.5:
        return 0.85 + 0.3 * fractal_noise(u * 0.4, w * 0.4, seed, 2)
    slope = sqrt(max(1.0 - nz * nz, 1e-4))
    course = floor(oz / slope / 0.32)
    tile = floor(u / 0.26 + 0.5 * (course % 2))
    detail = keep(footprint, 0.2)
    fv = oz / slope / 0.32 - course
    k = 0.95 + 0.32 * detail * (hash3(tile, course, seed) - 0.5)
    k -= 0.3 * detail * (1.0 - smoothstep(0.0, 0.25, fv))
    return k * (0.82 + 0.3 * value_noise(u * 0.6, oz * 0.9, seed))


@compiled
def needles(triangle, x, y, z, footprint):
    """Brightness of a conifer."""
    k = 0.55 + 0.6 * hash3(triangle, 93, 0) * keep(footprint, 0.8)
    return k + 0.25 * value_noise(x * 6.0 + z * 3.0, y * 6.0 + z * 5.0, 94)


@compiled
def hedge(row, u, w, oz, seed, footprint, look):
    """Albedo of a clipped hedge, slightly browner in autumn."""
    k = 0.45 + 0.55 * value_noise(u * 7.0 + w * 3.0, oz * 7.0 + w * 5.0, seed)
    k += 0.35 * keep(footprint, 0.12) * (hash3(floor(u * 12.0), floor(oz * 12.0), floor(w * 12.0)) - 0.4)
    brown = 0.5 * look[AUTUMN]
    return k * (row[RED] + 0.05 * brown), k * (row[GREEN] - 0.02 * brown), k * row[BLUE]


@compiled
def bark(x, y, z, footprint):
    """Brightness of a trunk."""
    return 0.6 + 0.8 * value_noise(x * 14.0 + y * 9.0, z * 2.5, 95) * (0.4 + 0.6 * keep(footprint, 0.1))


@compiled
def sign(row, u, oz, seed):
    """Albedo of a traffic sign: a bar on a white disc, a plain triangle, or a line of letters on a board."""
    style = int(row[P0])
    if style == 0 and sqrt(u * u + oz * oz) < 0.22:
        if abs(oz) < 0.05 and abs(u) < 0.14:
            return 0.04, 0.04, 0.04
        return 0.75, 0.75, 0.75
    if style == 2 and abs(oz) < 0.06 and abs(u) < 0.3 and hash3(floor(u * 16.0), 97, seed) > 0.25:
        return 0.8, 0.8, 0.8
    return row[RED], row[GREEN], row[BLUE]


@compiled
def person(row, oz):
    """Albedo of a person by height: hair, skin, coat, trousers."""
    height = row[P0]
    if oz > 0.95 * height:
        return 0.05, 0.035, 0.025
    if oz > 0.86 * height:
        return 0.42, 0.27, 0.19
    if oz < 0.48 * height:
        return row[RED2], row[GREEN2], row[BLUE2]
    return row[RED], row[GREEN], row[BLUE]


@compiled
def fence(u, seed, footprint):
    """Brightness of upright boards with gaps between them."""
    k = 0.75 + 0.4 * hash3(floor(u / 0.12), 98, seed) * keep(footprint, 0.12)
    if u / 0.12 - floor(u / 0.12) < 0.12:
        k *= 1.0 - 0.5 * keep(footprint, 0.1)
    return k


@compiled
def material(row, triangle, x, y, z, nx, ny, nz, dx, dy, dz, sx, sy, sz, footprint, look):
    """What is seen of surface ``row`` at world ``(x, y, z)`` with unit normal ``n`` along the unit ray ``d``.

    Returns:
        albedo (3), emission (3), gloss (share mirrored as by glass), share of the sun let through, wheel-cleared share.
    """
    kind = int(row[KIND])
    c, s = row[COS], row[SIN]
    ox, oy, oz = x - row[X], y - row[Y], z - row[Z]
    u, w = c * ox + s * oy, c * oy - s * ox
    r, g, b = row[RED], row[GREEN], row[BLUE]
    er, eg, eb, gloss, sunlit, wheel = 0.0, 0.0, 0.0, 0.0, 1.0, 0.0
    seed = int(row[SEED] * 16777216.0)
    shade = 1.0
    if kind == FACADE:
        r, g, b, er, eg, eb, gloss, sunlit = facade(
            row, u, oz, c * dx + s * dy, dz, dx * nx + dy * ny + dz * nz,
            c * sx + s * sy, sz, sx * nx + sy * ny + sz * nz, footprint, look,
        )  # fmt: skip
    elif kind == ROAD:
        r, g, b, wheel = road(row, u, w, x, y, footprint, look)
    elif kind == PAVEMENT:
        r, g, b = pavement(u, w, 30 + int(row[SEED] * 4.0), footprint)
    elif kind == GRASS:
        r, g, b = grass(x, y, footprint, look)
    elif kind == FIELD:
        r, g, b = field(x, y, footprint, look)
    elif kind == PLAIN:
        gloss = row[P0]
        shade = 0.94 + 0.12 * value_noise((u + w) * 2.0, oz * 2.0 + u, seed)
    elif kind == ROOF:
        shade = roof(row, u, w, oz, nz, seed, footprint)
    elif kind == LEAVES:
        r, g, b = leaves(row, triangle, ox, oy, oz, look)
    elif kind == CONIFER:
        shade = needles(triangle, x, y, z, footprint)
    elif kind == HEDGE:
        r, g, b = hedge(row, u, w, oz, seed, footprint, look)
    elif kind == BARK:
        shade = bark(x, y, z, footprint)
    elif kind == CAR:
        r, g, b, er, eg, eb, gloss = car(row, u, w, oz, nz, look)
    elif kind == KERB:
        shade = 0.9 + 0.2 * value_noise(u * 3.0 + w, w * 3.0, 96)
    elif kind == LAMP:
        er = 6.0 * look[NIGHT]
        eg, eb = 0.74 * er, 0.42 * er
    elif kind == SIGN:
        r, g, b = sign(row, u, oz, seed)
        gloss = 0.05
    elif kind == PERSON:
        r, g, b = person(row, oz)
    elif kind == AWNING:
        if floor(u / 0.3) % 2 == 0:
            r, g, b = row[RED2], row[GREEN2], row[BLUE2]
    elif kind == FENCE:
        shade = fence(u, seed, footprint)
    elif kind >= WALL:
        r, g, b, er, eg, eb, gloss = interior(row, kind, u, w, oz, nz, dx, dy, dz, footprint, look)
    return r * shade, g * shade, b * shade, er, eg, eb, gloss, sunlit, wheel
