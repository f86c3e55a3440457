"""Cars, people, lamps, signs and fences: templates, placed many at a time."""

from functools import lru_cache, partial
from itertools import pairwise

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from sextant.worlds.mesh import Mesh, boxes, instances, limb, place, prism, quads
from sextant.worlds.surfaces import Kind, palette, surface_rows

CAR_COLOURS = palette(
    "#e8e8e6", "#1d1f22", "#8f9499", "#5b6168", "#7d1a1a", "#1f3c6b",
    "#c9ccce", "#2e4a3a", "#b08d3c", "#3a3c40", "#a33b1f", "#d8d4c4",
)  # fmt: skip
CLOTHES = palette("#2b2f3a", "#6b1f25", "#3a5a40", "#c9b79c", "#1f3a5f", "#8a8a8a", "#d08c2e", "#111111")
SIGN_COLOURS = palette("#a01818", "#b32020", "#1c3f87")
#: round, triangular and board: corners, radius in metres, turn of the first corner, height by width
_SIGNS = ((16, 0.32, 0.0, 1.0), (3, 0.42, np.pi / 2, 1.0), (4, 0.5, np.pi / 4, 0.55))
#: length, width, height in metres; where the cabin starts and ends along the car, at the waist and at the roof
_CARS = (
    ((4.5, 1.78, 1.45), (-0.40, 0.22), (-0.25, 0.06)),
    ((4.1, 1.76, 1.50), (-0.47, 0.20), (-0.38, 0.05)),
    ((4.6, 1.85, 1.68), (-0.48, 0.22), (-0.43, 0.08)),
    ((5.0, 1.95, 2.05), (-0.49, 0.36), (-0.47, 0.22)),
)
_VAN = 3
LAMP_HEIGHT_M, LAMP_REACH_M = 5.6, 1.1


def _ring(z: float, back: float, front: float, half: float, bevel: float, *, fine: bool) -> Float64[ndarray, "k 3"]:
    """A level outline from ``back`` to ``front``, ``half`` wide on each side, with corners cut by ``bevel`` if fine."""
    if not fine:
        return np.array([(back, -half, z), (front, -half, z), (front, half, z), (back, half, z)])
    outline = [
        (back + bevel, -half), (front - bevel, -half), (front, -half + bevel), (front, half - bevel),
        (front - bevel, half), (back + bevel, half), (back, half - bevel), (back, -half + bevel),
    ]  # fmt: skip
    return np.array([(x, y, z) for x, y in outline])


@lru_cache(maxsize=8)
def _car(form: int, fine: bool) -> Float64[ndarray, "t 3 3"]:
    """A car standing on the origin, facing x."""
    (long, width, high), waist, roof = _CARS[form]
    half, belt = width / 2, 0.6 * high
    ring = partial(_ring, fine=fine)
    shoulder = ring(belt, -0.485 * long, 0.44 * long, 0.93 * half, 0.16)
    cabin = [
        ring(belt, waist[0] * long, waist[1] * long, 0.88 * half, 0.1),
        ring(high - 0.07, roof[0] * long, roof[1] * long, 0.74 * half, 0.1),
        ring(high, (roof[0] + 0.03) * long, (roof[1] - 0.03) * long, 0.64 * half, 0.1),
    ]
    if not fine:  # wheels are painted on the sides
        sill = ring(0.08, -0.48 * long, 0.48 * long, 0.97 * half, 0.0)
        body = [sill, ring(0.45, -0.5 * long, 0.5 * long, half, 0.0), shoulder]
        return np.concatenate([_loft(body), _loft([cabin[0], cabin[2]])])
    body = [
        ring(0.24, -0.47 * long, 0.47 * long, 0.92 * half, 0.12),
        ring(0.45, -0.5 * long, 0.5 * long, half, 0.18),
        ring(0.74 * belt + 0.1, -0.5 * long, 0.495 * long, half, 0.18),
        shoulder,
    ]
    triangles = [_loft(body), _loft(cabin)]
    wheel = prism(0.33, 0.33, 0.2, 10)
    wheel = wheel[:, :, [0, 2, 1]] * np.array([1, -1, 1])  # its axis from z to -y
    for x in (-0.3 * long, 0.3 * long):
        triangles.append(wheel + np.array([x, -half + 0.2, 0.33]))
        triangles.append(wheel[:, ::-1] * np.array([1, -1, 1]) + np.array([x, half - 0.2, 0.33]))
    return np.concatenate(triangles)


def _loft(rings: list[Float64[ndarray, "k 3"]]) -> Float64[ndarray, "t 3 3"]:
    """Walls between rings, and a cap on the last."""
    faces = [
        quads(np.stack([a, np.roll(a, -1, 0), np.roll(b, -1, 0), b], 1)).reshape(-1, 3, 3) for a, b in pairwise(rings)
    ]
    top = rings[-1]
    cap = np.stack([np.broadcast_to(top.mean(0), top.shape), top, np.roll(top, -1, 0)], 1)
    return np.concatenate([*faces, cap])


def car_mesh(
    position: Float64[ndarray, "n 3"],
    heading: Float64[ndarray, "n"],
    seed: Float64[ndarray, "n"],
    *,
    fine: bool,
    moving: bool = False,
) -> Mesh:
    """Cars at ``position`` (on the road), facing ``heading``; ``moving`` ones have their lights on."""
    parts = []
    form = np.minimum((seed * 17 % 1 * 4.6).astype(int), _VAN)
    for k, ((length, width, height), _, _) in enumerate(_CARS):
        at = np.flatnonzero(form == k)
        if not len(at):
            continue
        placed = place(_car(k, fine), position[at], heading[at])
        colour = CAR_COLOURS[(seed[at] * 89 % 1 * len(CAR_COLOURS)).astype(int)]
        if k == _VAN:
            colour = 0.35 * colour + 0.5
        rows = surface_rows(
            Kind.CAR, len(at), seed=seed[at], colour=colour, origin=position[at], heading=heading[at],
            parameters=(length, width, height, float(moving)),
        )  # fmt: skip
        parts.append(instances(placed, rows))
    return Mesh.join(parts)


@lru_cache(maxsize=4)
def _person(step: int) -> Float64[ndarray, "t 3 3"]:
    """A person of 1.76 m: standing (0), taking a short step (1) or a long one (2)."""

    def ring(z: float, rx: float, ry: float, x: float = 0.0) -> Float64[ndarray, "6 3"]:
        a = 2 * np.pi * np.arange(6) / 6
        return np.stack([x + rx * np.cos(a), ry * np.sin(a), np.full(6, z)], -1)

    stride = (0.0, 0.22, 0.3)[step]
    legs = [limb(np.array([s * stride, 0.09 * s, 0.0]), np.array([0.0, 0.08 * s, 0.86]), 0.07, 0.1, 5) for s in (-1, 1)]
    torso = _loft([ring(0.82, 0.14, 0.19), ring(1.1, 0.12, 0.17), ring(1.42, 0.13, 0.23), ring(1.5, 0.06, 0.08)])
    arms = [
        limb(np.array([-s * stride * 0.8, 0.27 * s, 0.78]), np.array([0.0, 0.24 * s, 1.42]), 0.045, 0.06, 4)
        for s in (-1, 1)
    ]
    head = _loft([ring(1.5, 0.05, 0.05), ring(1.58, 0.1, 0.085), ring(1.7, 0.105, 0.085), ring(1.76, 0.06, 0.05)])
    return np.concatenate([*legs, torso, *arms, head])


def person_mesh(position: Float64[ndarray, "n 3"], heading: Float64[ndarray, "n"], seed: Float64[ndarray, "n"]) -> Mesh:
    """People at ``position``, standing or in mid-step."""
    parts = []
    step = (seed * 13 % 1 * 3).astype(int)
    for k in range(3):
        at = np.flatnonzero(step == k)
        if len(at):
            tall = 0.92 + 0.14 * (seed[at] * 7 % 1)
            placed = place(_person(k)[None] * tall[:, None, None, None], position[at], heading[at])
            coat = CLOTHES[(seed[at] * 41 % 1 * len(CLOTHES)).astype(int)]
            legs = CLOTHES[(seed[at] * 73 % 1 * 3).astype(int)]
            rows = surface_rows(
                Kind.PERSON, len(at), seed=seed[at], colour=coat, second=legs, origin=position[at],
                parameters=(1.76 * tall,),
            )  # fmt: skip
            parts.append(instances(placed, rows))
    return Mesh.join(parts)


def lamp_mesh(position: Float64[ndarray, "n 3"], heading: Float64[ndarray, "n"], *, fine: bool) -> Mesh:
    """Street lamps: a post with an arm that reaches out along ``heading``."""
    if not len(position):
        return Mesh.empty()
    foot, tip = np.array([0, 0, LAMP_HEIGHT_M - 0.1]), np.array([LAMP_REACH_M, 0, LAMP_HEIGHT_M + 0.15])
    if fine:
        pole = [prism(0.085, 0.05, LAMP_HEIGHT_M, 6), prism(0.13, 0.1, 0.7, 6), limb(foot, tip, 0.045, 0.035, 4)]
    else:
        pole = [prism(0.09, 0.0, LAMP_HEIGHT_M, 3), limb(foot, tip, 0.045, 0.0, 3)]
    post = place(np.concatenate(pole), position, heading)
    metal = surface_rows(Kind.PLAIN, len(position), colour=palette("#3e4347"), origin=position, parameters=(0.05,))
    head = place_offset(position, heading, np.array([LAMP_REACH_M, 0.0, LAMP_HEIGHT_M + 0.06]))
    size = np.broadcast_to(np.array([0.62, 0.24, 0.08]), head.shape)
    light = surface_rows(Kind.LAMP, len(position), colour=(0.7, 0.7, 0.66))
    glow = boxes(head, size * 0.9, heading, light, bottom=True)
    shell = [boxes(head + np.array([0, 0, 0.05]), size, heading, metal)] if fine else []
    return Mesh.join([instances(post, metal), *shell, glow])


def lamp_lights(position: Float64[ndarray, "n 3"], heading: Float64[ndarray, "n"]) -> Float64[ndarray, "n 3"]:
    """The position of each lamp's light."""
    return place_offset(position, heading, np.array([LAMP_REACH_M, 0.0, LAMP_HEIGHT_M]))


def sign_mesh(position: Float64[ndarray, "n 3"], heading: Float64[ndarray, "n"], seed: Float64[ndarray, "n"]) -> Mesh:
    """Traffic signs on poles, facing ``heading``: round, triangular or boards."""
    parts = []
    style = (seed * 3).astype(int)
    middle = np.array([0.05, 0, 2.55])
    for k, (sides, radius, turn, squash) in enumerate(_SIGNS):
        at = np.flatnonzero(style == k)
        if not len(at):
            continue
        pole = place(prism(0.035, 0.035, 2.9, 5), position[at], heading[at])
        grey = surface_rows(Kind.PLAIN, len(at), colour=palette("#7d8285"), origin=position[at], parameters=(0.1,))
        a = turn + 2 * np.pi * np.arange(sides + 1) / sides
        ring = np.stack([np.full(sides + 1, 0.05), radius * np.cos(a), 2.55 + squash * radius * np.sin(a)], -1)
        face = np.stack([np.broadcast_to(middle, (sides, 3)), ring[:-1], ring[1:]], 1)
        back = face[:, ::-1] - np.array([0.02, 0, 0])
        plate = surface_rows(
            Kind.SIGN, len(at), seed=seed[at], colour=SIGN_COLOURS[k],
            origin=place_offset(position[at], heading[at], middle),
            heading=heading[at] + np.pi / 2, parameters=(float(k),),
        )  # fmt: skip
        parts += [
            instances(pole, grey),
            instances(place(face, position[at], heading[at]), plate),
            instances(place(back, position[at], heading[at]), grey),
        ]
    return Mesh.join(parts)


def bench_mesh(position: Float64[ndarray, "n 3"], heading: Float64[ndarray, "n"]) -> Mesh:
    """Benches facing ``heading``."""
    if not len(position):
        return Mesh.empty()
    wood = surface_rows(
        Kind.WOOD, len(position), seed=0.3, colour=palette("#7a5a3a"), origin=position, heading=heading + np.pi / 2
    )
    iron = surface_rows(Kind.PLAIN, len(position), colour=(0.05, 0.05, 0.05))
    seat = _boxes_at(position, heading, (0, 0, 0.42), (0.45, 1.7, 0.05), wood, bottom=True)
    back = _boxes_at(position, heading, (-0.22, 0, 0.55), (0.05, 1.7, 0.35), wood, bottom=True)
    legs = [_boxes_at(position, heading, (0, y, 0), (0.4, 0.06, 0.42), iron) for y in (-0.65, 0.65)]
    return Mesh.join([seat, back, *legs])


def _boxes_at(
    position: Float64[ndarray, "n 3"],
    heading: Float64[ndarray, "n"],
    offset: tuple[float, float, float],
    size: tuple[float, float, float],
    rows: Float32[ndarray, "n 24"],
    *,
    bottom: bool = False,
) -> Mesh:
    """A box of one size at ``offset`` in the frame of each object."""
    extent = np.broadcast_to(np.array(size, float), position.shape)
    return boxes(place_offset(position, heading, np.array(offset, float)), extent, heading, rows, bottom=bottom)


def place_offset(
    position: Float64[ndarray, "n 3"], heading: Float64[ndarray, "n"], offset: Float64[ndarray, "3"]
) -> Float64[ndarray, "n 3"]:
    """The point ``offset`` in the frame of each object."""
    c, s = np.cos(heading), np.sin(heading)
    x, y, z = offset
    return np.asarray(position + np.stack([c * x - s * y, s * x + c * y, np.full(len(c), z)], -1))
