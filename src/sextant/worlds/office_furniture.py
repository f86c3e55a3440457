"""Furniture: each piece made of boxes in its own frame, with its back at y = 0 and its front towards +y."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from numpy.random import Generator

from sextant.worlds.mesh import prism
from sextant.worlds.office_parts import Frame, Parts
from sextant.worlds.surfaces import Kind, linear, palette

WOODS = palette("#c8a676", "#b5875a", "#d9cbb2", "#e4e1d8")
METAL, DARK, WHITE, STEEL = linear("#8d9092"), linear("#26282b"), linear("#e6e4de"), linear("#b4b7b9")
FABRICS = palette("#2f3a4a", "#4a2f33", "#33473c", "#55504a", "#26282b", "#3d5a80")
BINDINGS = palette("#7d2b28", "#24476b", "#2f5b45", "#c8c2b0", "#3b3b3f", "#b88a2e")
PRINTS = palette("#2f5d8a", "#8a2f3a", "#3c7a4c", "#c27c1f", "#4a3f7a", "#1f7a78")
PAPER = linear("#f0eee8")


def desk(parts: Parts, frame: Frame, width: float, colour: object, *, depth: float = 0.78) -> None:
    """A table top on two panels, with a drawer unit."""
    wood = {"kind": Kind.WOOD, "parameters": ()}
    parts.box(frame, (0, depth / 2, 0.71), (width, depth, 0.028), colour, seed=0.2, **wood)  # type: ignore[arg-type]
    for x in (-width / 2 + 0.03, width / 2 - 0.03):
        parts.box(frame, (x, depth / 2, 0.0), (0.03, depth - 0.12, 0.71), METAL)
    parts.box(frame, (0, 0.1, 0.3), (width - 0.1, 0.02, 0.4), colour, seed=0.3, **wood)  # type: ignore[arg-type]
    if width > 1.3:
        unit = width / 2 - 0.27
        parts.box(frame, (unit, depth / 2, 0.06), (0.42, depth - 0.2, 0.54), STEEL)
        for z in (0.2, 0.36, 0.5):
            parts.box(frame, (unit, depth - 0.1, z), (0.36, 0.012, 0.015), DARK)


def monitor(parts: Parts, frame: Frame, z: float, seed: float, *, on: bool, width: float = 0.52) -> None:
    """A screen on a stand, facing y."""
    parts.box(frame, (0, 0.0, z), (0.22, 0.16, 0.012), DARK, gloss=0.2)
    parts.box(frame, (0, -0.02, z), (0.05, 0.03, 0.2), DARK, gloss=0.2)
    parts.box(frame, (0, 0.0, z + 0.11), (width, 0.035, 0.62 * width), DARK, gloss=0.2)
    parts.panel(
        frame, (0, 0.0195, z + 0.11), (width, 0.62 * width), Kind.SCREEN, DARK, parameters=(float(on),), seed=seed
    )


def clutter(parts: Parts, frame: Frame, z: float, rng: Generator) -> None:
    """A keyboard, papers, books and a mug, placed at random on a desk of 1.2 by 0.7 m."""
    parts.box(
        frame.inner(rng.uniform(-0.1, 0.1), rng.uniform(0.5, 0.58), rng.uniform(-0.15, 0.15)),
        (0, 0, z),
        (0.42, 0.14, 0.018),
        DARK,
    )
    for _ in range(int(rng.integers(1, 4))):
        at = frame.inner(rng.uniform(-0.55, 0.55), rng.uniform(0.3, 0.62), rng.uniform(-0.5, 0.5))
        parts.box(at, (0, 0, z + 0.019), (0.21, 0.297, 0.003 + 0.012 * rng.random()), PAPER)
    for _ in range(int(rng.integers(0, 3))):
        at = frame.inner(
            rng.choice([-0.5, 0.5]) + rng.uniform(-0.08, 0.08), rng.uniform(0.12, 0.3), rng.uniform(-0.4, 0.4)
        )
        colour = BINDINGS[int(rng.integers(len(BINDINGS)))]
        parts.box(at, (0, 0, z), (0.17, 0.24, 0.03 + 0.06 * rng.random()), colour, gloss=0.2)
    if rng.random() < 0.6:
        at = frame.inner(rng.uniform(-0.45, 0.45), rng.uniform(0.25, 0.6))
        parts.template(at, prism(0.035, 0.042, 0.1, 10), z, PRINTS[int(rng.integers(len(PRINTS)))], gloss=0.4)


@lru_cache(maxsize=1)
def _star() -> Float64[ndarray, "t 3 3"]:
    return np.concatenate([prism(0.3, 0.05, 0.09, 5), prism(0.03, 0.03, 0.42, 6)])


def office_chair(parts: Parts, frame: Frame, colour: object) -> None:
    """A swivel chair facing -y, centred at the origin."""
    parts.template(frame, _star(), 0.02, DARK)
    parts.box(frame, (0, 0, 0.42), (0.48, 0.46, 0.07), colour)
    parts.box(frame, (0, 0.23, 0.55), (0.43, 0.05, 0.46), colour)
    parts.box(frame, (0, 0.25, 0.3), (0.06, 0.03, 0.4), DARK)
    for x in (-0.26, 0.26):
        parts.box(frame, (x, 0.0, 0.64), (0.05, 0.26, 0.03), DARK)
        parts.box(frame, (x, 0.08, 0.44), (0.03, 0.04, 0.2), DARK)


def chair(parts: Parts, frame: Frame, colour: object) -> None:
    """A chair on four legs facing -y, centred at the origin."""
    for x in (-0.2, 0.2):
        for y in (-0.2, 0.2):
            parts.box(frame, (x, y, 0.0), (0.025, 0.025, 0.44 if y < 0 else 0.84), STEEL, gloss=0.3)
    parts.box(frame, (0, 0, 0.43), (0.44, 0.44, 0.035), colour)
    parts.box(frame, (0, 0.21, 0.58), (0.42, 0.025, 0.28), colour)


def shelf(
    parts: Parts, frame: Frame, width: float, height: float, colour: object, seed: float, *, depth: float = 0.32
) -> None:
    """Open shelves with books and binders."""
    boards = float(max(2, round(height / 0.37)))
    parts.box(
        frame,
        (0, depth / 2 + 0.004, 0.0),
        (width, depth, height),
        colour,
        kind=Kind.SHELF,
        parameters=(width, height, boards),
        seed=seed,
    )


def cupboard(parts: Parts, frame: Frame, width: float, height: float, colour: object, *, depth: float = 0.42) -> None:
    """A cupboard with two doors."""
    parts.box(
        frame,
        (0, depth / 2 + 0.004, 0.05),
        (width, depth, height - 0.05),
        colour,
        kind=Kind.WOOD,
        parameters=(),
        seed=0.6,
    )
    parts.box(frame, (0, depth / 2, 0.0), (width - 0.06, depth - 0.06, 0.05), DARK)
    parts.box(frame, (0, depth + 0.003, 0.08), (0.008, 0.006, height - 0.11), DARK)
    for x in (-0.05, 0.05):
        parts.box(frame, (x, depth + 0.012, 0.5 * height), (0.015, 0.02, 0.14), METAL, gloss=0.4)


def table(parts: Parts, frame: Frame, width: float, depth: float, colour: object, height: float = 0.73) -> None:
    """A table, centred at the origin."""
    parts.box(frame, (0, 0, height - 0.03), (width, depth, 0.03), colour, kind=Kind.WOOD, parameters=(), seed=0.4)
    for x in (-width / 2 + 0.08, width / 2 - 0.08):
        for y in (-depth / 2 + 0.08, depth / 2 - 0.08):
            parts.box(frame, (x, y, 0), (0.05, 0.05, height - 0.03), METAL, gloss=0.2)


def bench(parts: Parts, frame: Frame, width: float, seed: int) -> None:
    """A laboratory bench with instruments on it and a shelf above."""
    rng = np.random.default_rng(seed)
    parts.box(frame, (0, 0.38, 0.86), (width, 0.76, 0.035), linear("#3a3d40"), gloss=0.5)
    parts.box(frame, (0, 0.36, 0.08), (width - 0.04, 0.66, 0.78), WHITE, gloss=0.15)
    for k in range(int(width / 0.6)):
        parts.box(frame, (-width / 2 + 0.6 * (k + 1), 0.693, 0.12), (0.006, 0.006, 0.7), DARK)
    parts.box(frame, (0, 0.16, 1.42), (width, 0.3, 0.025), STEEL, gloss=0.3)
    for x in (-width / 2 + 0.05, width / 2 - 0.05):
        parts.box(frame, (x, 0.05, 0.89), (0.04, 0.06, 0.53), STEEL)
    x = -width / 2 + 0.3
    while x < width / 2 - 0.3:
        what = rng.random()
        if what < 0.35:
            size = (rng.uniform(0.3, 0.45), 0.36, rng.uniform(0.2, 0.4))
            parts.box(
                frame, (x, 0.3, 0.895), size, palette("#cfd2d0", "#7d8a94", "#e2dfd6")[int(rng.integers(3))], gloss=0.1
            )
            parts.panel(
                frame,
                (x - 0.04, 0.482, 0.895 + size[2] * 0.35),
                (0.16, 0.1),
                Kind.SCREEN,
                DARK,
                parameters=(1.0,),
                seed=rng.random(),
            )
        elif what < 0.6:
            monitor(parts, frame.inner(x, 0.3), 0.895, rng.random(), on=bool(rng.random() < 0.8))
        elif what < 0.85:
            for k in range(3):
                at = frame.inner(x + 0.1 * k - 0.1, rng.uniform(0.25, 0.5))
                parts.template(
                    at,
                    prism(0.04, 0.03, rng.uniform(0.12, 0.25), 8),
                    0.895,
                    PRINTS[int(rng.integers(len(PRINTS)))],
                    gloss=0.5,
                )
        if rng.random() < 0.6:
            parts.box(
                frame,
                (x, 0.16, 1.445),
                (rng.uniform(0.2, 0.4), 0.24, rng.uniform(0.12, 0.3)),
                BINDINGS[int(rng.integers(len(BINDINGS)))],
            )
        x += rng.uniform(0.5, 0.75)


def kitchen_row(parts: Parts, frame: Frame, width: float, colour: object, seed: int) -> None:
    """Base units with a worktop and sink, and wall units above."""
    rng = np.random.default_rng(seed)
    parts.box(frame, (0, 0.3, 0.1), (width, 0.58, 0.76), colour, gloss=0.2)
    parts.box(frame, (0, 0.27, 0.0), (width, 0.5, 0.1), DARK)
    parts.box(frame, (0, 0.31, 0.86), (width, 0.62, 0.035), linear("#4b443d"), gloss=0.5)
    parts.box(frame, (0, 0.18, 1.45), (width, 0.34, 0.68), colour, gloss=0.2)
    for k in range(1, int(width / 0.6)):
        x = -width / 2 + 0.6 * k
        parts.box(frame, (x, 0.59, 0.12), (0.008, 0.006, 0.72), DARK)
        parts.box(frame, (x, 0.35, 1.47), (0.008, 0.006, 0.64), DARK)
        parts.box(frame, (x + 0.1, 0.6, 0.74), (0.12, 0.02, 0.015), METAL, gloss=0.5)
    parts.box(frame, (-width / 4, 0.32, 0.893), (0.5, 0.4, 0.006), STEEL, gloss=0.8)
    parts.template(frame.inner(-width / 4, 0.1), prism(0.018, 0.018, 0.28, 6), 0.895, STEEL, gloss=0.8)
    parts.box(frame, (width / 4, 0.28, 0.895), (0.28, 0.24, 0.36), DARK, gloss=0.4)
    for _ in range(4):
        at = frame.inner(rng.uniform(-0.1, 0.45) * width, rng.uniform(0.2, 0.5))
        parts.template(at, prism(0.035, 0.042, 0.1, 8), 0.895, PRINTS[int(rng.integers(len(PRINTS)))], gloss=0.4)


def fridge(parts: Parts, frame: Frame) -> None:
    """A tall fridge."""
    parts.box(frame, (0, 0.32, 0.02), (0.6, 0.62, 1.8), WHITE, gloss=0.4)
    parts.box(frame, (0, 0.632, 1.2), (0.58, 0.006, 0.012), DARK)
    parts.box(frame, (-0.24, 0.65, 0.9), (0.025, 0.03, 0.25), METAL, gloss=0.5)
    parts.box(frame, (-0.24, 0.65, 1.28), (0.025, 0.03, 0.3), METAL, gloss=0.5)


def sofa(parts: Parts, frame: Frame, width: float, colour: object) -> None:
    """A low sofa."""
    parts.box(frame, (0, 0.4, 0.1), (width, 0.78, 0.3), colour, gloss=0.0)
    parts.box(frame, (0, 0.12, 0.4), (width, 0.22, 0.38), colour, gloss=0.0)
    for x in (-width / 2 + 0.08, width / 2 - 0.08):
        parts.box(frame, (x, 0.4, 0.4), (0.16, 0.78, 0.18), colour, gloss=0.0)


@lru_cache(maxsize=8)
def _foliage(seed: int) -> Float64[ndarray, "t 3 3"]:
    """Forty bent leaves rising from a pot."""
    rng = np.random.default_rng([seed, 71])
    n = 42
    angle, lean = rng.uniform(0, 2 * np.pi, n), rng.uniform(0.05, 0.3, n)
    stem, reach, wide = rng.uniform(0.45, 1.0, n), rng.uniform(0.14, 0.26, n), rng.uniform(0.03, 0.06, n)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], -1)
    side = np.stack([-np.sin(angle), np.cos(angle), np.zeros(n)], -1) * wide[:, None]
    up = np.array([0.0, 0.0, 1.0])
    foot = out * (0.25 * lean)[:, None] + up * (stem - 0.25)[:, None]
    knee = out * lean[:, None] + up * (stem + 0.06)[:, None]
    tip = out * (lean + 0.7 * reach)[:, None] + up * (stem - 0.1 + 0.5 * reach)[:, None]
    stalk = np.stack([out * 0.02 - side * 0.1, out * 0.02 + side * 0.1, foot], 1)
    return np.concatenate(
        [stalk, np.stack([foot, knee - side, knee + side], 1), np.stack([knee - side, tip, knee + side], 1)]
    )


def plant(parts: Parts, frame: Frame, seed: float) -> None:
    """A plant in a pot, centred at the origin."""
    parts.template(
        frame, prism(0.13, 0.17, 0.3, 12), 0.0, palette("#8a4b32", "#dcd8ce", "#3a3c40")[int(seed * 3)], gloss=0.2
    )
    parts.template(frame, prism(0.15, 0.15, 0.29, 8)[-8:], 0.0, linear("#2b2119"))
    for k, green in enumerate(palette("#3f6b35", "#55803f")):
        parts.template(frame.inner(0, 0, 1.3 * k), _foliage(int(seed * 4) + 4 * k), 0.25, green, gloss=0.1)


def radiator(parts: Parts, frame: Frame, width: float) -> None:
    """A panel radiator under a window."""
    parts.box(frame, (0, 0.06, 0.14), (width, 0.05, 0.56), WHITE, gloss=0.25)
    for k in range(int(width / 0.1)):
        parts.box(frame, (-width / 2 + 0.05 + 0.1 * k, 0.09, 0.17), (0.05, 0.016, 0.5), WHITE, gloss=0.25)


def extinguisher(parts: Parts, frame: Frame) -> None:
    """A fire extinguisher on a wall, with its sign."""
    red = linear("#b3201c")
    at = frame.inner(0, 0.1)
    parts.template(at, prism(0.078, 0.078, 0.42, 12), 0.62, red, gloss=0.6)
    parts.template(at, prism(0.078, 0.03, 0.07, 12), 1.04, red, gloss=0.6)
    parts.box(frame, (0, 0.1, 1.11), (0.05, 0.09, 0.05), DARK)
    parts.box(frame, (0, 0.015, 0.8), (0.06, 0.03, 0.12), METAL)
    parts.box(frame, (0, 0.006, 1.62), (0.18, 0.008, 0.18), red, gloss=0.1)
    parts.box(frame, (0, 0.011, 1.67), (0.05, 0.002, 0.09), PAPER)


def sheet(parts: Parts, frame: Frame, size: tuple[float, float], z: float, seed: float, print_seed: float) -> None:
    """A poster on the wall, or a pinboard where ``seed`` is above 0.7."""
    colour = PRINTS[int(print_seed * len(PRINTS))]
    parts.box(frame, (0, 0.008, z), (size[0], 0.012, size[1]), linear("#d8d4ca"))
    ground = palette("#efece4", "#e6e9ec", "#f2e9d2", "#dfe6dc")[int(print_seed * 97 % 4)]
    parts.panel(frame, (0, 0.0165, z), size, Kind.POSTER, ground, second=colour, seed=seed)


def name_plate(parts: Parts, frame: Frame, seed: float) -> None:
    """The plate beside a door."""
    parts.box(frame, (0, 0.006, 1.5), (0.17, 0.008, 0.12), METAL, gloss=0.3)
    parts.panel(frame, (0, 0.012, 1.505), (0.16, 0.11), Kind.POSTER, PAPER, seed=0.69 * seed)


def copier(parts: Parts, frame: Frame) -> None:
    """A copier on wheels."""
    parts.box(frame, (0, 0.36, 0.04), (0.62, 0.6, 0.82), linear("#c9ccc9"), gloss=0.2)
    parts.box(frame, (0, 0.36, 0.9), (0.66, 0.62, 0.14), DARK, gloss=0.3)
    parts.box(frame, (0, 0.36, 0.86), (0.56, 0.5, 0.04), DARK)
    for z in (0.2, 0.38, 0.56):
        parts.box(frame, (0, 0.662, z), (0.5, 0.008, 0.012), DARK)
    parts.box(frame, (0.2, 0.6, 1.04), (0.2, 0.14, 0.015), linear("#5b7f8f"), gloss=0.4)


def bin_(parts: Parts, frame: Frame) -> None:
    """A waste-paper basket, centred at the origin."""
    parts.template(frame, prism(0.12, 0.15, 0.32, 10)[:-10], 0.0, DARK)
    parts.template(frame, prism(0.12, 0.12, 0.05, 10)[-10:], 0.0, DARK)
