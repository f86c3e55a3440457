"""The inner loops of the renderer: rays of a view, shadow rays, shading, and the development of the picture."""

from math import cos, exp, floor, log, pi, sin, sqrt

from sextant.worlds.shading.compiled import compiled
from sextant.worlds.shading.ground import puddle
from sextant.worlds.shading.interior import indoor_light
from sextant.worlds.shading.look import (
    BOUNCE_B,
    BOUNCE_G,
    BOUNCE_R,
    FOG,
    FOG_B,
    FOG_G,
    FOG_R,
    HORIZON_B,
    HORIZON_G,
    HORIZON_R,
    INDOOR,
    LAMPS,
    SNOW,
    SUN_B,
    SUN_G,
    SUN_R,
    SUN_X,
    SUN_Y,
    SUN_Z,
    WET,
    ZENITH_B,
    ZENITH_G,
    ZENITH_R,
)  # fmt: skip
from sextant.worlds.shading.materials import CONIFER, FACADE, LEAVES, material
from sextant.worlds.shading.noise import clamp, fractal_noise, hash3, smoothstep
from sextant.worlds.shading.sky import sky
from sextant.worlds.surfaces import KIND, X, Y, Z


@compiled
def world_rays(pose, bearings, first, shift, origins, directions):
    """Rays of a camera at ``pose`` (3 x 4, world from camera), into float32 ``origins`` and ``directions``.

    While the shutter is open the camera moves by ``shift`` (metres along world x, y, z, and radians about z): each ray
    has its own instant, hashed from its number ``first + i``.
    """
    moving = shift[0] != 0.0 or shift[1] != 0.0 or shift[2] != 0.0 or shift[3] != 0.0
    for i in range(bearings.shape[0]):
        x, y, z = bearings[i, 0], bearings[i, 1], bearings[i, 2]
        dx = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z
        dy = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z
        dz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z
        moment = 0.0
        if moving:
            moment = hash3(first + i, 7, 13) - 0.5
            a = shift[3] * moment
            dx, dy = dx - a * dy, dy + a * dx
            n = 1.0 / sqrt(dx * dx + dy * dy + dz * dz)
            dx, dy, dz = dx * n, dy * n, dz * n
        origins[i, 0] = pose[0, 3] + shift[0] * moment
        origins[i, 1] = pose[1, 3] + shift[1] * moment
        origins[i, 2] = pose[2, 3] + shift[2] * moment
        directions[i, 0], directions[i, 1], directions[i, 2] = dx, dy, dz


@compiled
def distances(origins, directions, triangle, normals, offsets, out):
    """Exact distance along each ray to the plane of the triangle it hit; infinite where it hit none."""
    for i in range(triangle.shape[0]):
        t = triangle[i]
        if t < 0:
            out[i] = float("inf")
            continue
        nx, ny, nz = normals[t, 0], normals[t, 1], normals[t, 2]
        along = nx * directions[i, 0] + ny * directions[i, 1] + nz * directions[i, 2]
        out[i] = (offsets[t] - nx * origins[i, 0] - ny * origins[i, 1] - nz * origins[i, 2]) / along


@compiled
def gaps(origins, directions, triangle, distance, surface, surfaces, footprint, out):
    """Numbers of the rays that hit foliage and slip between the leaves; returns how many."""
    count = 0
    for i in range(triangle.shape[0]):
        t = triangle[i]
        if t < 0:
            continue
        if int(surfaces[surface[t], KIND]) != LEAVES:
            continue
        d = distance[i]
        x = origins[i, 0] + d * directions[i, 0]
        y = origins[i, 1] + d * directions[i, 1]
        z = origins[i, 2] + d * directions[i, 2]
        size = max(0.07, 1.2 * footprint * d)
        if hash3(floor(x / size) * 7 + floor(z / size), floor(y / size) * 5 - floor(z / size), t) < 0.34:
            out[count] = i
            count += 1
    return count


@compiled
def shadow_rays(origins, directions, triangle, distance, normals, surface, surfaces, look, at, starts):
    """Points that face the sun and may be in shadow: their ray numbers and positions; returns how many."""
    if look[SUN_R] + look[SUN_G] + look[SUN_B] < 1e-3 or look[INDOOR] > 0.5:
        return 0
    count = 0
    for i in range(triangle.shape[0]):
        t = triangle[i]
        if t < 0:
            continue
        nx, ny, nz = normals[t, 0], normals[t, 1], normals[t, 2]
        if nx * directions[i, 0] + ny * directions[i, 1] + nz * directions[i, 2] > 0.0:
            nx, ny, nz = -nx, -ny, -nz
        facing = nx * look[SUN_X] + ny * look[SUN_Y] + nz * look[SUN_Z]
        d = distance[i]
        if facing <= 0.0:
            kind = int(surfaces[surface[t], KIND])
            if kind != LEAVES and kind != CONIFER:
                continue
            nx, ny, nz = look[SUN_X], look[SUN_Y], look[SUN_Z]
        lift = 0.002 + 2e-5 * d
        if int(surfaces[surface[t], KIND]) == LEAVES:
            lift = 0.35  # the nearest leaves do not count: light filters in
            nx, ny, nz = look[SUN_X], look[SUN_Y], look[SUN_Z]
        starts[count, 0] = origins[i, 0] + d * directions[i, 0] + nx * lift
        starts[count, 1] = origins[i, 1] + d * directions[i, 1] + ny * lift
        starts[count, 2] = origins[i, 2] + d * directions[i, 2] + nz * lift
        at[count] = i
        count += 1
    return count


@compiled
def one_surface(triangle, i, samples):
    """Whether all rays of the pixel of ray ``i`` hit one triangle."""
    first = i // samples * samples
    for k in range(1, samples):
        if triangle[first + k] != triangle[first]:
            return False
    return True


@compiled
def corner_rays(triangle, at, starts, samples, sunny, chosen, froms):
    """Which of the rays ``at`` are cast at the sun first: the first and last of a pixel on one triangle, otherwise all.

    Their numbers go into ``chosen`` and their ``starts`` into ``froms``; returns how many.
    """
    count = 0
    for j in range(at.shape[0]):
        sample = at[j] % samples
        if sample == 0 or sample == samples - 1 or not one_surface(triangle, at[j], samples):
            chosen[count] = at[j]
            froms[count, 0], froms[count, 1], froms[count, 2] = starts[j, 0], starts[j, 1], starts[j, 2]
            count += 1
    return count


@compiled
def inner_rays(triangle, at, starts, samples, sunny, chosen, froms):
    """The rays that ``corner_rays`` left out: lit like their pixel's corners if these agree, otherwise ``chosen``."""
    count = 0
    for j in range(at.shape[0]):
        sample = at[j] % samples
        if sample == 0 or sample == samples - 1 or not one_surface(triangle, at[j], samples):
            continue
        first = at[j] - sample
        if sunny[first] == sunny[first + samples - 1]:
            sunny[at[j]] = sunny[first]
        else:
            chosen[count] = at[j]
            froms[count, 0], froms[count, 1], froms[count, 2] = starts[j, 0], starts[j, 1], starts[j, 2]
            count += 1
    return count


@compiled
def sky_rays(origins, directions, triangle, distance, normals, surface, surfaces, number, samples, at, starts, ways):
    """One ray from each point that was hit, cosine-distributed about its normal: does it see the sky? Returns how many.

    The ``samples`` rays of a pixel, identified by the ``number`` of the ray in its view, are spread by a golden-ratio
    sequence shifted by a hash of the pixel.
    """
    count = 0
    for i in range(triangle.shape[0]):
        t = triangle[i]
        if t < 0:
            continue
        nx, ny, nz = normals[t, 0], normals[t, 1], normals[t, 2]
        if nx * directions[i, 0] + ny * directions[i, 1] + nz * directions[i, 2] > 0.0:
            nx, ny, nz = -nx, -ny, -nz
        pixel, sample = number[i] // samples, number[i] % samples
        z = sample * 0.7548776662466927 + hash3(pixel, 1, 17)
        z = 2.0 * (z - floor(z)) - 1.0
        turn = 2.0 * pi * (sample * 0.5698402909980532 + hash3(pixel, 2, 17))
        level = sqrt(max(1.0 - z * z, 0.0))
        wx, wy, wz = nx + 0.999 * level * cos(turn), ny + 0.999 * level * sin(turn), nz + 0.999 * z
        n = 1.0 / sqrt(wx * wx + wy * wy + wz * wz)
        d = distance[i]
        lift = 0.3 if int(surfaces[surface[t], KIND]) == LEAVES else 0.003 + 2e-5 * d
        starts[count, 0] = origins[i, 0] + d * directions[i, 0] + nx * lift
        starts[count, 1] = origins[i, 1] + d * directions[i, 1] + ny * lift
        starts[count, 2] = origins[i, 2] + d * directions[i, 2] + nz * lift
        ways[count, 0], ways[count, 1], ways[count, 2] = wx * n, wy * n, wz * n
        at[count] = i
        count += 1
    return count


@compiled
def shade(
    origins, directions, triangle, distance, sunny, open_sky, normals, surface, surfaces,
    lamps, lamp_cells, lamp_origin, look, pixel, radiance, mirror,
):  # fmt: skip
    """Linear radiance of every ray.

    ``albedo (sun max(n.s, 0) visible + sky (1 + n.z)/2 + bounce (1 - n.z)/2 + lamps) + emission + mirrored sky``, with
    snow and wetness on what faces up, then fog by distance. ``open_sky`` is 1 or 0 where a ray tested whether the point
    sees the sky, -1 where none did: then the sky's share is estimated from the normal and the height above the street.
    The reflective shares of wet ground are left in ``mirror`` for a second cast.
    """
    sun_x, sun_y, sun_z = look[SUN_X], look[SUN_Y], look[SUN_Z]
    indoor = look[INDOOR] > 0.5
    air_r = 0.5 * look[ZENITH_R] + 0.5 * look[HORIZON_R]
    air_g = 0.5 * look[ZENITH_G] + 0.5 * look[HORIZON_G]
    air_b = 0.5 * look[ZENITH_B] + 0.5 * look[HORIZON_B]
    for i in range(triangle.shape[0]):
        dx, dy, dz = float(directions[i, 0]), float(directions[i, 1]), float(directions[i, 2])
        t = triangle[i]
        mirror[i] = 0.0
        if t < 0:
            radiance[i, 0], radiance[i, 1], radiance[i, 2] = sky(dx, dy, dz, look, True)
            if look[FOG] > 0.001:
                clear = exp(-look[FOG] * 260.0 * (1.0 - 0.75 * clamp(dz * 2.5, 0.0, 1.0)))
                radiance[i, 0] = look[FOG_R] + (radiance[i, 0] - look[FOG_R]) * clear
                radiance[i, 1] = look[FOG_G] + (radiance[i, 1] - look[FOG_G]) * clear
                radiance[i, 2] = look[FOG_B] + (radiance[i, 2] - look[FOG_B]) * clear
            continue
        row = surfaces[surface[t]]
        kind = int(row[KIND])
        nx, ny, nz = normals[t, 0], normals[t, 1], normals[t, 2]
        along = nx * dx + ny * dy + nz * dz
        if along > 0.0:
            nx, ny, nz, along = -nx, -ny, -nz, -along
        d = distance[i]
        x, y, z = origins[i, 0] + d * dx, origins[i, 1] + d * dy, origins[i, 2] + d * dz
        footprint = pixel * d / max(sqrt(-along), 0.12)
        r, g, b, er, eg, eb, gloss, sunlit, wheel = material(
            row, t, x, y, z, nx, ny, nz, dx, dy, dz, sun_x, sun_y, sun_z, footprint, look
        )
        if indoor:
            cr, cg, cb = indoor_light(
                row, r, g, b, gloss, x, y, z, nx, ny, nz, dx, dy, dz, along, lamps, lamp_cells, lamp_origin, look
            )
            radiance[i, 0], radiance[i, 1], radiance[i, 2] = cr + er, cg + eg, cb + eb
            continue
        round_x, round_y, round_z = nx, ny, nz
        leafy = kind == LEAVES or kind == CONIFER
        if kind == LEAVES:  # a crown is lit like a ball, not leaf by leaf
            cx, cy, cz = x - row[X], y - row[Y], z - row[Z]
            n = 0.75 / (sqrt(cx * cx + cy * cy + cz * cz) + 1e-6)
            round_x, round_y, round_z = 0.25 * nx + n * cx, 0.25 * ny + n * cy, 0.25 * nz + n * cz
        up = clamp(0.5 + 0.5 * round_z, 0.0, 1.0)
        mirrored = 0.0
        if nz > 0.25:
            if look[SNOW] > 0.0 and kind != FACADE:
                drift = fractal_noise(x * 0.45, y * 0.45, 71, 3)
                cover = look[SNOW] * smoothstep(0.25, 0.6, nz)
                cover = smoothstep(1.0 - cover, 1.25 - cover, drift + 0.25 - 0.55 * wheel * (0.35 + drift))
                if leafy:
                    cover *= 0.6
                r, g, b = r + (0.80 - r) * cover, g + (0.83 - g) * cover, b + (0.88 - b) * cover
                gloss *= 1.0 - cover
            if look[WET] > 0.0 and not leafy:
                water = puddle(x, y, look) if nz > 0.95 else 0.0
                dark = 1.0 - look[WET] * (0.38 + 0.2 * water)
                r, g, b = r * dark, g * dark, b * dark
                if nz > 0.95 and z < 0.5:
                    fresnel = 0.02 + 0.98 * (1.0 + along) ** 5
                    mirrored = look[WET] * (0.35 + 0.65 * water) * clamp(fresnel * 1.3, 0.0, 0.85)
        low = 0.62 + 0.38 * smoothstep(0.0, 5.0, z)  # the street canyon hides part of the sky
        if nz > 0.5:
            low = 0.86 if z < 1.0 else 0.95
        sky_light = up * low
        ground_light = 1.0 - up
        if open_sky[i] >= 0.0:  # tested by a ray instead of estimated
            sky_light, ground_light = 1.05 * open_sky[i], 0.85 * (1.0 - open_sky[i])
        lr = air_r * sky_light + look[BOUNCE_R] * ground_light
        lg = air_g * sky_light + look[BOUNCE_G] * ground_light
        lb = air_b * sky_light + look[BOUNCE_B] * ground_light
        if sunny[i] != 0:
            facing = round_x * sun_x + round_y * sun_y + round_z * sun_z
            if leafy:
                facing = clamp(0.35 + 0.65 * facing, 0.0, 1.0)
            facing = max(facing, 0.0) * sunlit
            lr, lg, lb = lr + look[SUN_R] * facing, lg + look[SUN_G] * facing, lb + look[SUN_B] * facing
        if look[LAMPS] > 0.0 and lamps.shape[0] > 0:
            gx = int(floor((x - lamp_origin[0]) / lamp_origin[2]))
            gy = int(floor((y - lamp_origin[1]) / lamp_origin[2]))
            if gx >= 0 and gy >= 0 and gx < lamp_cells.shape[0] and gy < lamp_cells.shape[1]:
                for k in range(lamp_cells.shape[2]):
                    lamp = lamp_cells[gx, gy, k]
                    if lamp < 0:
                        break
                    qx, qy, qz = lamps[lamp, 0] - x, lamps[lamp, 1] - y, lamps[lamp, 2] - z
                    if qz < 0.05:
                        continue
                    q2 = qx * qx + qy * qy + qz * qz
                    q = sqrt(q2)
                    facing = (round_x * qx + round_y * qy + round_z * qz) / q
                    if leafy:
                        facing = 0.4 + 0.6 * facing
                    if facing > 0.0:
                        cone = qz / q
                        level = 30.0 * look[LAMPS] * facing * (0.25 + 0.75 * cone * cone) / (q2 + 2.0)
                        lr, lg, lb = lr + level, lg + 0.72 * level, lb + 0.38 * level
        cr, cg, cb = r * lr + er, g * lg + eg, b * lb + eb
        if gloss > 0.0:
            k = -2.0 * along
            mx, my, mz = dx + k * nx, dy + k * ny, dz + k * nz
            fresnel = 0.06 + 0.94 * (1.0 + along) ** 5
            share = clamp(gloss * fresnel * 1.7, 0.0, 0.9)
            if mz > 0.0:
                hr, hg, hb = sky(mx, my, mz, look, False)
            else:
                hr, hg, hb = look[BOUNCE_R], look[BOUNCE_G], look[BOUNCE_B]
            across = 0.55 * (1.0 - smoothstep(0.02, 0.35, mz))  # the houses opposite hide the low sky
            hr, hg, hb = hr * (1.0 - across), hg * (1.0 - across), hb * (1.0 - across)
            cr, cg, cb = cr + (hr - cr) * share, cg + (hg - cg) * share, cb + (hb - cb) * share
        if mirrored > 0.01:
            cr, cg, cb = cr * (1.0 - mirrored), cg * (1.0 - mirrored), cb * (1.0 - mirrored)
            mirror[i] = mirrored
        clear = exp(-look[FOG] * d)
        mirror[i] *= clear
        radiance[i, 0] = look[FOG_R] + (cr - look[FOG_R]) * clear
        radiance[i, 1] = look[FOG_G] + (cg - look[FOG_G]) * clear
        radiance[i, 2] = look[FOG_B] + (cb - look[FOG_B]) * clear


@compiled
def mirror_rays(origins, directions, distance, mirror, at, starts, ways):
    """Rays reflected by wet ground (normal up, slightly rippled), with their numbers; returns how many."""
    count = 0
    for i in range(mirror.shape[0]):
        if mirror[i] <= 0.0:
            continue
        d = distance[i]
        x = origins[i, 0] + d * directions[i, 0]
        y = origins[i, 1] + d * directions[i, 1]
        starts[count, 0], starts[count, 1] = x, y
        starts[count, 2] = origins[i, 2] + d * directions[i, 2] + 0.003
        h = hash3(floor(x * 40.0), floor(y * 40.0), 5)
        wx = directions[i, 0] + 0.03 * (h - 0.5)
        wy = directions[i, 1] + 0.03 * (hash3(floor(x * 40.0), floor(y * 40.0), 6) - 0.5)
        wz = -directions[i, 2] * (1.0 + 0.25 * (h - 0.5)) + 0.002
        n = 1.0 / sqrt(wx * wx + wy * wy + wz * wz)
        ways[count, 0], ways[count, 1], ways[count, 2] = wx * n, wy * n, wz * n
        at[count] = i
        count += 1
    return count


@compiled
def average(radiance, samples, out):
    """Mean of the ``samples`` rays of each pixel, clipped at 8 so that lamps do not sparkle."""
    for i in range(out.shape[0]):
        for c in range(3):
            total = 0.0
            for k in range(samples):
                total += min(radiance[i * samples + k, c], 8.0)
            out[i, c] = total / samples


@compiled
def gaussian(i, c, seed):
    """A standard normal number for three integers (Box-Muller)."""
    return sqrt(-2.0 * log(hash3(i, c, seed) + 1e-12)) * cos(2.0 * pi * hash3(i, c + 3, seed + 1))


@compiled
def develop(linear, width, gain, curve, read, shot, vignetting, seed, out):
    """A picture in 8 bits: vignetting, gains, filmic shoulder, sensor noise, and a tone ``curve`` of 65,536 levels."""
    n = linear.shape[0]
    height = n // width
    corner = 0.25 * (width * width + height * height)
    for i in range(n):
        fall = 1.0
        if vignetting > 0.0:
            dx, dy = i % width + 0.5 - 0.5 * width, i // width + 0.5 - 0.5 * height
            fall = 1.0 - vignetting * (dx * dx + dy * dy) / corner
        for c in range(3):
            v = linear[i, c] * gain[c] * fall
            v = v * (2.51 * v + 0.03) / (v * (2.43 * v + 0.59) + 0.14)
            if read > 0.0 or shot > 0.0:
                v += sqrt(read * read + shot * shot * max(v, 0.0)) * gaussian(i, c, seed)
            out[i, c] = curve[int(65535.0 * clamp(v, 0.0, 1.0) + 0.5)]
