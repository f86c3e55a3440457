"""Trees: trunks, branches and foliage; hedges are boxes."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from sextant.worlds.mesh import Mesh, instances, limb, place, prism
from sextant.worlds.surfaces import Kind, palette, surface_rows

FORMS = 6
GREENS = palette("#5f7a33", "#4f6f2c", "#6f8a3c", "#567438", "#7a8f45", "#48652c")


@dataclass(frozen=True)
class Trees:
    """Many trees, one array per attribute; ``size`` scales a tree of about eight metres, or a conifer of eleven."""

    position: Float64[ndarray, "n 3"]
    heading: Float64[ndarray, "n"]
    size: Float64[ndarray, "n"]
    conifer: Bool[ndarray, "n"]
    seed: Float64[ndarray, "n"]

    def __len__(self) -> int:
        return len(self.position)


def tree_mesh(trees: Trees, foliage: float, leaves: int) -> Mesh:
    """Triangles of all trees; ``foliage`` (0 to 1) is the share of ``leaves`` that broad-leaved trees still have."""
    parts = []
    form = (trees.seed * 997 % 1 * FORMS).astype(int)
    for k in range(FORMS):
        broad = np.flatnonzero(~trees.conifer & (form == k))
        if len(broad):
            parts.append(_broad(trees, broad, k, foliage, leaves))
    needles = np.flatnonzero(trees.conifer)
    if len(needles):
        parts.append(_conifers(trees, needles))
    return Mesh.join(parts)


@dataclass(frozen=True)
class _Form:
    wood: Float64[ndarray, "t 3 3"]
    leaves: Float64[ndarray, "l 3 3"]
    centre: Float64[ndarray, "3"]
    radius: float


@lru_cache(maxsize=64)
def _form(k: int, leaves: int) -> _Form:
    """A template of eight metres: a trunk, forking branches, and ``leaves`` in clumps around their ends."""
    rng = np.random.default_rng([41, k])
    tall, wide = 4.9 + 0.8 * rng.random(), 2.3 + 0.9 * rng.random()
    stem = 1.9 + 0.6 * rng.random()
    centre = np.array([0.0, 0.0, stem + 0.52 * tall])
    detailed = leaves > 200
    wood = [limb(np.zeros(3), np.array([0.05, 0.0, stem + 0.25 * tall]), 0.2, 0.12 * detailed, 6 if detailed else 3)]
    tips = []
    for i in range(9 if detailed else 6):
        angle, rise = 2.4 * i + rng.random(), 0.15 + 0.8 * rng.random()
        start = np.array([0.05, 0.0, stem * (0.8 + 0.25 * rng.random()) + 0.18 * tall * (i % 3) / 3])
        reach = wide * (0.95 - 0.45 * rise)
        end = np.array([reach * np.cos(angle), reach * np.sin(angle), stem + tall * (0.25 + 0.65 * rise)])
        wood.append(limb(start, end, 0.085, 0.02 * detailed, 3))
        tips.append(end)
        for _ in range(4 if detailed else 1):
            share = 0.35 + 0.5 * rng.random()
            knee = start + share * (end - start)
            twig = knee + (0.5 + 0.3 * wide * rng.random()) * _unit(
                rng.normal(size=3) + 0.6 * _unit(end - start) + [0, 0, 0.5]
            )
            wood.append(limb(knee, twig, 0.035, 0.0, 3))
            tips.append(twig)
    tips.append(np.array([0.0, 0.0, stem + 0.97 * tall]))
    clumps = np.array(tips)
    pick = rng.integers(0, len(clumps), leaves)
    offset = rng.normal(size=(leaves, 3))
    offset *= (0.3 + 0.55 * rng.random((leaves, 1))) * (0.42 * wide) / np.linalg.norm(offset, axis=1, keepdims=True)
    middle = clumps[pick] + offset
    size = (2.6 if detailed else 3.4) * wide / np.sqrt(leaves) * (0.75 + 0.5 * rng.random(leaves))
    outward = middle - centre
    normal = outward / np.linalg.norm(outward, axis=1, keepdims=True) + 0.9 * rng.normal(size=(leaves, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    side = np.cross(normal, rng.normal(size=(leaves, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(normal, side)
    turn = 2 * np.pi / 3 * np.arange(3)
    corners = middle[:, None] + size[:, None, None] * (
        np.cos(turn)[:, None] * side[:, None] + np.sin(turn)[:, None] * other[:, None]
    )
    radius = float(np.percentile(np.linalg.norm(middle - centre, axis=1), 95))
    return _Form(np.concatenate(wood), corners, centre, radius)


def _unit(v: Float64[ndarray, "3"]) -> Float64[ndarray, "3"]:
    return np.asarray(v / np.linalg.norm(v))


def _broad(trees: Trees, at: Int64[ndarray, "k"], k: int, foliage: float, leaves: int) -> Mesh:
    form, size = _form(k, leaves), trees.size[at]
    scale = size[:, None, None, None]
    wood = place(form.wood[None] * scale, trees.position[at], trees.heading[at])
    bark = surface_rows(Kind.BARK, len(at), seed=trees.seed[at], colour=palette("#5a4a3a"), origin=trees.position[at])
    parts = [instances(wood, bark)]
    kept = round(foliage * leaves)
    if kept:
        crown = place(form.leaves[None, :kept] * scale, trees.position[at], trees.heading[at])
        green = GREENS[(trees.seed[at] * 31 % 1 * len(GREENS)).astype(int)]
        centre = trees.position[at] + np.array([0.0, 0.0, 1.0]) * (form.centre[2] * size)[:, None]
        rows = surface_rows(
            Kind.LEAVES, len(at), seed=trees.seed[at], colour=green, origin=centre, parameters=(form.radius * size,)
        )
        parts.append(instances(crown, rows))
    return Mesh.join(parts)


def _conifers(trees: Trees, at: Int64[ndarray, "k"]) -> Mesh:
    """Tiers of jagged cones on a trunk."""
    rng = np.random.default_rng(43)
    layers = []
    for i in range(6):
        low, radius = 1.1 + 1.55 * i, 2.1 * (1 - i / 7.2)
        cone = prism(radius, 0.0, 2.6, 9)
        jag = 1 + 0.32 * (rng.random(len(cone)) - 0.5)
        cone[:, :2, :2] *= jag[:, None, None]
        layers.append(cone + np.array([0, 0, low]))
    needles = np.concatenate(layers)
    scale = trees.size[at][:, None, None, None]
    crown = place(needles[None] * scale, trees.position[at], trees.heading[at])
    dark = palette("#2f4a2c", "#36523a", "#28402b")[(trees.seed[at] * 3).astype(int)]
    trunk = place(prism(0.2, 0.1, 3.0, 4)[None] * scale, trees.position[at], trees.heading[at])
    bark = surface_rows(Kind.BARK, len(at), seed=trees.seed[at], colour=palette("#4d3b2c"), origin=trees.position[at])
    rows = surface_rows(Kind.CONIFER, len(at), seed=trees.seed[at], colour=dark, origin=trees.position[at])
    return Mesh.join([instances(crown, rows), instances(trunk, bark)])
