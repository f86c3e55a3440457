"""Facades: walls of plaster, brick, stone, panels or boards, with windows and doors set back into them.

The recess of a window looks exact without any triangles: the ray that hits the wall plane at ``(u, v)`` continues to
the pane at depth ``d`` behind it, ``(u, v) + d (du, dv) / -dn``; where it leaves the opening on the way, it hits the
reveal. The shadow that the opening casts on the pane is found in the same way along the direction of the sun.
"""

from math import floor

from sextant.worlds.shading.compiled import compiled
from sextant.worlds.shading.look import LIT, NIGHT
from sextant.worlds.shading.noise import clamp, fractal_noise, hash3, keep, smoothstep, value_noise
from sextant.worlds.surfaces import BLUE, BLUE2, GREEN, GREEN2, P0, RED, RED2, SEED

PLASTER, BRICK, STONE, PANELS, BOARDS = range(5)
SASH, SQUARE, RIBBON, FRENCH, CURTAIN = range(5)
HOME, SHOP, GARAGE, OFFICE = range(4)


@compiled
def wall_colour(row, u, v, seed, style, footprint):
    """Albedo of the bare wall."""
    r, g, b = row[RED], row[GREEN], row[BLUE]
    if style == BRICK:
        course = floor(v / 0.085)
        x = u / 0.24 + 0.5 * (course % 2)
        fu, fv = x - floor(x), v / 0.085 - course
        detail = keep(footprint, 0.085)
        shade = 1.0 + detail * 0.35 * (hash3(floor(x), course, seed) - 0.5)
        if detail > 0.0 and (fv < 0.16 or fu < 0.05):
            r, g, b = r + (0.42 - r) * 0.6 * detail, g + (0.40 - g) * 0.6 * detail, b + (0.37 - b) * 0.6 * detail
        else:
            average = 0.12 * (1.0 - detail)
            r, g, b = r + (0.42 - r) * average, g + (0.40 - g) * average, b + (0.37 - b) * average
        shade *= 0.88 + 0.24 * value_noise(u * 0.8, v * 0.8, seed)
    elif style == STONE:
        course = floor(v / 0.34)
        x = u / 0.62 + 0.5 * (course % 2) + 0.2 * hash3(course, 3, seed)
        fu, fv = x - floor(x), v / 0.34 - course
        detail = keep(footprint, 0.3)
        shade = 0.95 + detail * 0.22 * (hash3(floor(x), course, seed) - 0.5)
        shade += 0.12 * value_noise(u * 2.5, v * 2.5, seed)
        if fv < 0.05 or fu < 0.03:
            shade *= 1.0 - 0.35 * detail
    elif style == PANELS:
        fu, fv = u / 2.4 - floor(u / 2.4), v / 1.5 - floor(v / 1.5)
        shade = 0.94 + 0.06 * hash3(floor(u / 2.4), floor(v / 1.5), seed) + 0.05 * value_noise(u * 0.7, v * 0.25, seed)
        if fu < 0.012 or fv < 0.02:
            shade *= 1.0 - 0.5 * keep(footprint, 0.08)
    elif style == BOARDS:
        board = floor(v / 0.16)
        fv = v / 0.16 - board
        detail = keep(footprint, 0.12)
        shade = 0.97 + 0.08 * detail * (hash3(board, 1, seed) - 0.5) - 0.3 * detail * (1.0 - smoothstep(0.0, 0.2, fv))
        shade *= 0.95 + 0.1 * value_noise(u * 0.6, v * 6.0, seed) * detail
    else:
        shade = 0.93 + 0.14 * fractal_noise(u * 0.9, v * 0.9, seed, 2)
        if footprint < 0.05:
            shade += 0.03 * (value_noise(u * 18.0, v * 18.0, seed) - 0.5)
    streak = value_noise(u * 2.2, v * 0.22, seed + 9)
    shade *= 1.0 - 0.16 * streak * streak
    shade *= 0.8 + 0.2 * smoothstep(0.0, 1.4, v + 0.5 * streak)
    return r * shade, g * shade, b * shade


@compiled
def room(x, y, w, h, seed, lit, day, footprint):
    """What is seen through a pane: albedo of the curtains or the dark room, and the light that comes out of it."""
    kind = hash3(seed, 5, 1)
    r, g, b = 0.035, 0.037, 0.042
    glow = 1.0
    tint = 0.5 + 0.5 * hash3(seed, 6, 1)
    if kind < 0.4 and abs(x) > w * (0.24 + 0.16 * hash3(seed, 7, 1)):  # curtains at the sides
        fold = 0.8 + 0.2 * keep(footprint, 0.12) * value_noise(x * 14.0, 0.0, seed)
        r, g, b, glow = 0.5 * fold, 0.48 * fold * (0.9 + 0.1 * tint), 0.42 * fold * tint, 0.55
    elif kind < 0.65 and y > h * (0.35 + 0.6 * hash3(seed, 8, 1)):  # a blind half down
        slat = 0.85 + 0.15 * keep(footprint, 0.05) * (1.0 if y * 12.0 - floor(y * 12.0) > 0.3 else 0.0)
        r, g, b, glow = 0.46 * slat, 0.45 * slat, 0.41 * slat, 0.4
    elif kind > 0.86:  # net curtain
        r, g, b, glow = 0.3, 0.3, 0.3, 0.8
    elif y < 0.25 and hash3(seed, 9, 1) > 0.6:  # plants on the sill
        r, g, b = 0.05, 0.10, 0.03
    if lit == 0.0:
        return r, g, b, 0.0, 0.0, 0.0
    warm = 0.45 + 0.45 * hash3(seed, 10, 1)
    level = 1.5 * lit * glow * (0.55 + 0.45 * clamp(y / h, 0.0, 1.0)) * (0.6 + 0.6 * hash3(seed, 11, 1))
    level *= 1.0 - 0.6 * day
    return r, g, b, level, level * (0.55 + 0.3 * warm), level * (0.2 + 0.5 * warm * warm)


@compiled
def facade(row, u, v, du, dv, dn, su, sv, sn, footprint, look):
    """What a wall looks like at ``(u, v)`` metres from its lower left corner.

    ``(du, dv, dn)`` is the ray and ``(su, sv, sn)`` the sun in the frame along, up and out of the wall.

    Returns:
        albedo (3), emission (3), mirror share of a pane, share of the sun let through.
    """
    width, height, ground, storeys, bays = row[P0], row[P0 + 1], row[P0 + 2], row[P0 + 3], row[P0 + 4]
    use, style, wall, blank, trim = int(row[P0 + 5]), int(row[P0 + 6]), int(row[P0 + 7]), row[P0 + 8], row[P0 + 9]
    seed = int(row[SEED] * 16777216.0)
    day = 1.0 - look[NIGHT]
    r, g, b = wall_colour(row, u, v, seed, wall, footprint)
    door_r, door_g, door_b = row[RED2], row[GREEN2], row[BLUE2]
    pale = 0.3 + 0.7 * trim  # surrounds, quoins and bands
    tr = row[RED] + (0.58 - row[RED]) * pale
    tg = row[GREEN] + (0.55 - row[GREEN]) * pale
    tb = row[BLUE] + (0.48 - row[BLUE]) * pale
    if v < 0.45 and blank < 1.5:  # plinth
        r, g, b = 0.32 * (0.6 + r), 0.32 * (0.6 + g), 0.32 * (0.58 + b)
    if v > height - 0.5:
        eave = 1.0 - 0.25 * smoothstep(height - 0.5, height, v)
        r, g, b = r * eave, g * eave, b * eave
    if blank > 0.5:
        return r, g, b, 0.0, 0.0, 0.0, 0.0, 1.0
    if trim > 0.5 and wall != BOARDS:
        edge = min(u, width - u)
        if edge < (0.42 if floor(v / 0.36) % 2 == 0 else 0.28) and keep(footprint, 0.25) > 0.3:
            s = 1.0 if (v / 0.36 - floor(v / 0.36)) > 0.08 else 0.7
            r, g, b = tr * s, tg * s, tb * s
    bay_width = width / bays
    bay = floor(clamp(u, 0.0, width - 1e-3) / bay_width)
    x = u - (bay + 0.5) * bay_width
    storey_height = (height - ground) / max(storeys - 1.0, 1.0)
    if v < ground:
        storey, y, level_height = 0.0, v, ground
    else:
        storey = 1.0 + floor((v - ground) / storey_height)
        y, level_height = v - ground - (storey - 1.0) * storey_height, storey_height
        if storey >= storeys:  # gable
            if abs(u - 0.5 * width) > 0.45 or v > height + 1.4 or v < height + 0.3 or hash3(seed, 70, 0) < 0.4:
                return r, g, b, 0.0, 0.0, 0.0, 0.0, 1.0
            x, y, storey = u - 0.5 * width, v - height + 0.5, storeys
    if trim > 0.2 and storey > 0.5 and y < 0.14:
        s = 1.0 if y > 0.03 else 0.6
        r, g, b = tr * s, tg * s, tb * s

    # the opening of this bay: half width, sill, head, depth
    half, sill, head, depth, double = 0.52, 0.85, 2.15, 0.17, 1.0
    door, glazed = False, False
    door_bay = floor(hash3(seed, 71, 0) * bays)
    if storey == 0.0 and use == SHOP:
        half, sill, head, depth, glazed = 0.5 * bay_width - 0.18, 0.45, ground - 1.05, 0.22, True
        if bay == door_bay:
            half, sill, door = min(half, 0.75), 0.08, True
        if v > ground - 0.95 and v < ground - 0.22:  # the sign over the window
            hue = hash3(seed, 72, 0)
            bold = 0.1 + 0.25 * hash3(seed, 69, 0)
            sr = 0.06 + bold * clamp(abs(hue * 6.0 - 3.0) - 1.0, 0.0, 1.0)
            sg = 0.055 + 0.8 * bold * clamp(2.0 - abs(hue * 6.0 - 2.0), 0.0, 1.0)
            sb = 0.05 + 0.9 * bold * clamp(2.0 - abs(hue * 6.0 - 4.0), 0.0, 1.0)
            letter = floor(u / 0.34)
            if v > ground - 0.8 and v < ground - 0.36 and abs(u - 0.5 * width) < 0.32 * width:
                ink = hash3(letter, floor((v - ground) / 0.11), seed + 73)
                if hash3(letter, 74, seed) > 0.18 and u / 0.34 - letter > 0.2 and ink > 0.42:
                    k = 0.85 * keep(footprint, 0.25) + 0.3 * (1.0 - keep(footprint, 0.25))
                    sr, sg, sb = sr + (0.8 - sr) * k, sg + (0.78 - sg) * k, sb + (0.7 - sb) * k
            e = 0.55 * look[NIGHT] * (1.0 if hash3(seed, 75, 0) > 0.35 else 0.0)
            return sr, sg, sb, sr * e, sg * e, sb * e, 0.0, 1.0
    elif storey == 0.0 and use == GARAGE and bay == door_bay:
        if abs(x) < min(1.3, 0.42 * bay_width) and v < 2.25:
            line = 1.0 if v / 0.28 - floor(v / 0.28) > 0.12 else 1.0 - 0.4 * keep(footprint, 0.12)
            return 0.8 * door_r * line, 0.8 * door_g * line, 0.8 * door_b * line, 0.0, 0.0, 0.0, 0.0, 0.85
    elif storey == 0.0 and use == OFFICE:
        half, sill, head, depth, glazed = 0.5 * bay_width - 0.12, 0.1, ground - 0.45, 0.12, True
    elif storey == 0.0 and bay == door_bay and use != GARAGE:
        half, sill, head, depth, door = 0.55, 0.12, 2.25, 0.22, True
    elif style == SQUARE:
        half, sill, head = min(0.5 + 0.25 * hash3(seed, 76, 0), 0.4 * bay_width), 0.95, min(2.1, level_height - 0.4)
    elif style == RIBBON:
        half, sill, head, depth, double = 0.5 * bay_width - 0.03, 0.95, level_height - 0.5, 0.08, 0.0
    elif style == FRENCH:
        half, sill, head, depth = min(0.62, 0.4 * bay_width), 0.15, min(2.45, level_height - 0.35), 0.22
    elif style == CURTAIN:
        half, sill, head, depth, double = 0.5 * bay_width - 0.04, 0.35, level_height - 0.06, 0.05, 0.0
    else:
        half, sill, head = min(0.52, 0.38 * bay_width), 0.8, min(2.35, level_height - 0.45)
    head = max(head, sill + 0.4)
    if footprint > 1.3 * half and not glazed:  # too far to tell openings from wall
        share = clamp(2.0 * half * (head - sill) / (bay_width * level_height), 0.0, 0.9)
        e = look[LIT] * share * 0.5 * (1.0 - 0.6 * day)
        r, g, b = r + (0.05 - r) * share, g + (0.055 - g) * share, b + (0.06 - b) * share
        return r, g, b, e, e * 0.75, e * 0.45, 0.35 * share, 1.0

    ax = abs(x)
    if ax > half or y < sill or y > head:
        if style <= FRENCH and style != RIBBON and not glazed:
            beside = ax > half + 0.03 and ax < half + 0.46 and y > sill and y < head
            if beside and storey > 0.0 and use != OFFICE and hash3(seed, 77, 0) > 0.6:
                slat = 1.0 if y / 0.07 - floor(y / 0.07) > 0.3 else 1.0 - 0.35 * keep(footprint, 0.06)  # shutters
                return door_r * 0.8 * slat, door_g * 0.8 * slat, door_b * 0.8 * slat, 0.0, 0.0, 0.0, 0.0, 1.0
            if y > sill - 0.09 and y <= sill and ax < half + 0.14 and not door:
                return 0.55, 0.54, 0.52, 0.0, 0.0, 0.0, 0.0, 1.0
            if y > sill - 0.3 and y <= sill - 0.09 and ax < half + 0.14:
                s = 0.72 + 0.28 * (sill - 0.09 - y) / 0.21
                return r * s, g * s, b * s, 0.0, 0.0, 0.0, 0.0, 0.75
            if trim > 0.35 and ax < half + 0.13 and y > sill and y < head + 0.16:
                return tr, tg, tb, 0.0, 0.0, 0.0, 0.0, 1.0
        return r, g, b, 0.0, 0.0, 0.0, 0.0, 1.0

    step = depth / max(-dn, 0.05)
    px, py = x + du * step, y + dv * step
    if abs(px) > half or py < sill or py > head:  # the reveal
        k = 0.8 if py < sill else 0.55
        return r * k, g * k, b * k, 0.0, 0.0, 0.0, 0.0, 0.45
    sunlit = 0.0
    if sn > 0.02:
        qx, qy = px + su * depth / sn, py + sv * depth / sn
        if abs(qx) < half and qy < head and qy > sill:
            sunlit = 1.0
    cell = int(hash3(int(bay), int(storey), seed) * 16777216.0)
    if door and not glazed:
        if py > head - 0.38:
            e = 0.5 * look[NIGHT] * (1.0 if hash3(seed, 78, 0) > 0.4 else 0.0)
            return 0.05, 0.05, 0.06, e, e * 0.7, e * 0.35, 0.5, sunlit
        panel = 1.0
        if abs(abs(px) - 0.25) < 0.16 and (abs(py - 0.65) < 0.3 or abs(py - 1.4) < 0.3):
            panel = 0.78
        return door_r * 0.7 * panel, door_g * 0.7 * panel, door_b * 0.7 * panel, 0.0, 0.0, 0.0, 0.03, sunlit
    frame = 0.055 if not glazed else 0.04
    if (
        half - abs(px) < frame
        or py - sill < frame
        or head - py < frame
        or (double > 0.5 and not glazed and abs(px) < 0.5 * frame)
        or (style == SASH and not glazed and abs(py - (sill + 0.58 * (head - sill))) < 0.5 * frame)
        or (glazed and half > 1.0 and abs(abs(px) - half / 3.0) < 0.025)
    ):
        f = 0.62 if hash3(seed, 79, 0) > 0.35 else 0.12
        if style == CURTAIN or glazed:
            f = 0.14
        return f, f, f * 0.96, 0.0, 0.0, 0.0, 0.0, sunlit
    if style == FRENCH and py - sill < 0.95:  # railing before the glass
        if py - sill > 0.9 or (x / 0.11 - floor(x / 0.11) < 0.16 and keep(footprint, 0.11) > 0.3):
            return 0.03, 0.03, 0.03, 0.0, 0.0, 0.0, 0.0, 1.0
    if glazed:
        deep = 1.1 / max(-dn, 0.05)
        gx, gy = px + du * deep, py + dv * deep
        shelf, place = floor(gy / 0.38), floor(gx / 0.17)
        fx, fy = gx / 0.17 - place, gy / 0.38 - shelf
        goods = hash3(place, shelf, cell)
        there = goods > 0.35 and fy > 0.08 and fy < 0.3 + 0.65 * goods and fx > 0.1 and gy < 1.75
        tint = hash3(place, shelf, cell + 1)
        open_now = 1.0 if hash3(seed, 80, 0) > 0.25 else 0.12
        bright = (0.10 * day + 0.5 * look[NIGHT]) * open_now
        level = bright * (0.3 + 0.6 * goods if there else 0.32 + 0.1 * clamp(gy / head, 0.0, 1.0))
        if not there:
            tint = 0.5
        if gy > head:
            level = 1.8 * bright if floor(gx / 0.9) % 2 == 0 else 0.8 * bright
        return 0.04, 0.04, 0.045, level, level * (0.72 + 0.25 * tint), level * (0.45 + 0.4 * tint), 0.85, sunlit
    lit = 1.0 if hash3(cell, 81, 0) < look[LIT] else 0.0
    kr, kg, kb, er, eg, eb = room(px, py - sill, half, head - sill, cell, lit, day, footprint)
    return kr, kg, kb, er, eg, eb, 0.9, 0.55 * sunlit
