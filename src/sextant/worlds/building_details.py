"""What projects from buildings and gives a street its silhouette: chimneys, parapets, dormers, balconies, awnings."""

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from sextant.worlds.building_design import FLAT, GABLE, MANSARD, Buildings, Number
from sextant.worlds.mesh import Mesh, boxes, instances, place, quads
from sextant.worlds.shading.facade import CURTAIN, FRENCH, GARAGE, PLASTER, SHOP, SQUARE
from sextant.worlds.surfaces import Kind, palette, surface_rows

AWNING_COLOURS = palette("#8e2b25", "#2f5d46", "#2c4a73", "#b5702a", "#6b2d52", "#3c3c3c")
CHIMNEY, CHIMNEY_POT = (0.25, 0.12, 0.08), (0.3, 0.14, 0.09)
PLANT, SLAB, RAILING, DORMER_ROOF = (0.4, 0.41, 0.42), (0.42, 0.41, 0.39), (0.05, 0.05, 0.055), (0.11, 0.11, 0.12)
#: the largest number of dormers along a mansard, of balconies along a storey, and of storeys with balconies
DORMERS, BALCONIES, BALCONY_STOREYS = 5, 4, 4


def details(
    b: Buildings,
    colour: Float64[ndarray, "n 3"],
    trim: Float64[ndarray, "n 3"],
    seed: Float64[ndarray, "n"],
    *,
    fine: bool,
) -> Mesh:
    """All that projects from buildings with walls of ``colour``; repainting does not change which building has what."""
    pick = np.random.default_rng([9, len(b)]).random((5, len(b)))
    side = np.where(pick[1] < 0.5, -1.0, 1.0)
    return Mesh.join([
        *_chimneys(b, pick[0] < 0.7, side, fine),
        *_parapets(b, colour),
        _plant(b, pick[2] < 0.5, side),
        *_bands(b, trim),
        *_mansard_dormers(b, colour, seed),
        *_gable_dormers(b, pick[3] < 0.4, colour, seed),
        *_balconies(b, seed, fine),
        _awnings(b.some((b.use == SHOP) & (pick[4] < 0.45))),
    ])  # fmt: skip


def _boxes(
    b: Buildings, offset: tuple[Number, Number, Number], size: tuple[Number, Number, Number], colour: object,
    kind: Kind = Kind.PLAIN,
) -> Mesh:  # fmt: skip
    """A box on each building, at ``offset`` in its frame."""
    if not len(b):
        return Mesh.empty()
    base = b.beside(*offset)
    extent = np.stack([np.broadcast_to(np.asarray(v, float), len(b)) for v in size], -1)
    rows = surface_rows(kind, len(b), seed=b.seed, colour=colour, origin=base, heading=b.heading)
    return boxes(base, extent, b.heading, rows, bottom=True)


def _chimneys(b: Buildings, chosen: Bool[ndarray, "n"], side: Float64[ndarray, "n"], fine: bool) -> list[Mesh]:
    """Chimneys on pitched roofs, with pots if ``fine``."""
    chosen = chosen & (b.roof != FLAT)
    b, side = b.some(chosen), side[chosen]
    w, d, h = b.size.T
    x, y = side * 0.3 * w, 0.12 * d
    stack = _boxes(b, (x, y, h), (0.55, 0.75, 0.9 + b.rise), CHIMNEY)
    return [stack, _boxes(b, (x, y, h + b.rise + 0.9), (0.3, 0.3, 0.3), CHIMNEY_POT)] if fine else [stack]


def _parapets(b: Buildings, colour: Float64[ndarray, "n 3"]) -> list[Mesh]:
    """A low wall along each edge of a flat roof."""
    wall = colour[b.roof == FLAT] * 0.92
    b = b.some(b.roof == FLAT)
    w, d, h = b.size.T
    parts = []
    for x, y in ((0, -1), (0, 1), (-1, 0), (1, 0)):
        place = (x * (w / 2 - 0.125), y * (d / 2 - 0.125), h - 0.02)
        parts.append(_boxes(b, place, (w if y else 0.25, d - 0.5 if x else 0.25, 0.55), wall))
    return parts


def _plant(b: Buildings, chosen: Bool[ndarray, "n"], side: Float64[ndarray, "n"]) -> Mesh:
    """The plant room on a flat roof."""
    chosen = chosen & (b.roof == FLAT)
    b, side = b.some(chosen), side[chosen]
    w, d, h = b.size.T
    return _boxes(b, (side * 0.2 * w, 0.1 * d, h), (0.3 * w, 0.3 * d, 1.9), PLANT)


def _bands(b: Buildings, trim: Float64[ndarray, "n 3"]) -> list[Mesh]:
    """Cornices under flat and mansard roofs, and a ledge above shops."""
    under = ((b.roof == FLAT) | (b.roof == MANSARD)) & (b.window != CURTAIN) & (b.storeys > 1)
    top = b.some(under)
    w, d, h = top.size.T
    cornice = _boxes(top, (0.0, -d / 2 - 0.14, h - 0.32), (w + 0.02, 0.34, 0.3), trim[under])
    above = (b.use == SHOP) & (b.storeys > 1)
    shop = b.some(above)
    w, d, _ = shop.size.T
    ledge = _boxes(shop, (0.0, -d / 2 - 0.07, shop.ground - 0.16), (w, 0.2, 0.16), trim[above])
    return [cornice, ledge]


def _bays(b: Buildings, seed: Float64[ndarray, "n"]) -> Float64[ndarray, "n"]:
    """How many windows there are side by side along the street, as the facade draws them."""
    return np.maximum(1, np.round(b.size[:, 0] / (2.5 + 0.9 * seed)))


def _mansard_dormers(b: Buildings, colour: Float64[ndarray, "n 3"], seed: Float64[ndarray, "n"]) -> list[Mesh]:
    """A dormer over each bay of a mansard."""
    parts = []
    bays = _bays(b, seed)
    for k in range(DORMERS):
        at = (b.roof == MANSARD) & (k < bays)
        some = b.some(at)
        w, d, h = some.size.T
        x = (k + 0.5) * (w / bays[at]) - w / 2
        parts.append(_dormers(some, (x, -d / 2 + 0.34, h + 0.25), colour[at], seed[at]))
    return parts


def _gable_dormers(
    b: Buildings, chosen: Bool[ndarray, "n"], colour: Float64[ndarray, "n 3"], seed: Float64[ndarray, "n"]
) -> list[Mesh]:
    """Two dormers in the street-facing slope of a high roof."""
    at = chosen & (b.roof == GABLE) & ~b.across & (b.rise > 2.4)
    some = b.some(at)
    w, d, h = some.size.T
    slope = some.rise / (d / 2)
    y, z = -d / 2 + 0.7, h + slope * 0.7 - 0.45
    return [_dormers(some, (x * w, y, z), colour[at], seed[at]) for x in (-0.25, 0.25)]


def _dormers(
    b: Buildings,
    corner: tuple[Float64[ndarray, "n"], Float64[ndarray, "n"], Float64[ndarray, "n"]],
    colour: Float64[ndarray, "n 3"],
    seed: Float64[ndarray, "n"],
) -> Mesh:
    """Windows that project from a roof at ``corner``: a box with one bay of facade in front, and a small roof."""
    if not len(b):
        return Mesh.empty()
    x, y, z = corner
    base = b.beside(x, y + 0.9, z)
    size = np.broadcast_to(np.array([1.25, 2.0, 1.75]), (len(b), 3))
    rows = surface_rows(
        Kind.FACADE, len(b), seed=seed, colour=colour, second=0.8 * colour,
        origin=b.beside(x - 0.625, y - 0.1, z - 0.55), heading=b.heading,
        parameters=(1.25, 2.3, 2.3, 1.0, 1.0, GARAGE, SQUARE, PLASTER, 0.0, 0.0),
    )  # fmt: skip
    body = boxes(base, size, b.heading, rows)
    top = surface_rows(Kind.PLAIN, len(b), colour=DORMER_ROOF)
    cover = boxes(base + np.array([0, 0, 1.75]), size * np.array([1.15, 1.05, 0.06]), b.heading, top, bottom=True)
    return Mesh.join([body, cover])


def _balconies(b: Buildings, seed: Float64[ndarray, "n"], fine: bool) -> list[Mesh]:
    """Balconies in front of some French windows: a slab, and a railing in front and, if ``fine``, at the sides."""
    parts = []
    bays = _bays(b, seed)
    for storey in range(1, BALCONY_STOREYS + 1):
        for k in range(BALCONIES):
            staggered = (k + storey * (seed > 0.5)) % 2 == 0
            at = (b.window == FRENCH) & (b.storeys > 1) & (storey < b.storeys) & (k < bays) & staggered
            some = b.some(at)
            w, d, h = some.size.T
            bay = w / bays[at]
            x, y = (k + 0.5) * bay - w / 2, -d / 2
            z = some.ground + (storey - 1) * ((h - some.ground) / np.maximum(some.storeys - 1, 1))
            wide = np.minimum(1.9, 0.8 * bay)
            parts.append(_boxes(some, (x, y - 0.45, z), (wide, 0.9, 0.12), SLAB))
            parts.append(_boxes(some, (x, y - 0.88, z + 0.12), (wide, 0.04, 0.9), RAILING, Kind.FENCE))
            for end in (-0.5, 0.5) if fine else ():
                place = (x + end * wide, y - 0.45, z + 0.12)
                parts.append(_boxes(some, place, (0.04, 0.88, 0.9), RAILING, Kind.FENCE))
    return parts


def _awnings(b: Buildings) -> Mesh:
    """Awnings over shop windows: cloth with a hem."""
    if not len(b):
        return Mesh.empty()
    w, d, z = b.size[:, 0] - 0.5, b.size[:, 1], b.ground - 0.95
    back, front = -d / 2, -d / 2 - 1.25
    cloth = np.stack([
        np.stack([-w / 2, front, z - 0.65], -1),
        np.stack([w / 2, front, z - 0.65], -1),
        np.stack([w / 2, back, z], -1),
        np.stack([-w / 2, back, z], -1),
    ], 1)  # fmt: skip
    hem = np.stack([cloth[:, 0] - [0, 0, 0.22], cloth[:, 1] - [0, 0, 0.22], cloth[:, 1], cloth[:, 0]], 1)
    triangles = place(quads(np.stack([cloth, hem], 1)).reshape(len(b), -1, 3, 3), b.position, b.heading)
    colour = AWNING_COLOURS[(b.seed * len(AWNING_COLOURS)).astype(int)]
    rows = surface_rows(
        Kind.AWNING, len(b), seed=b.seed, colour=colour, second=(0.75, 0.73, 0.66), origin=b.position,
        heading=b.heading, parameters=(w,),
    )  # fmt: skip
    return instances(triangles, rows)
