"""Filters of made-up parts, images and options, as hypothesis strategies."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from hypothesis import strategies as st
from layers.cosfire.plain_cosfire import dog, gabor, plain_response

from sextant.layers.cosfire import Blur, Cosfire, DoGBank, GaborBank, Strategy, Tolerance, Tuples

BORDERS = ["zeros", "replicate", "reflect", "circular"]
MEANS = ["geometric", "arithmetic", "harmonic", "trimmed", "median"]


@dataclass(frozen=True)
class Given(Strategy):
    """Parts that are told, whatever the example shows: each is (channel, rho, phi)."""

    parts: tuple

    def tuples(self, maps, grid, point):
        channels, rho, phi = zip(*self.parts, strict=True)
        return Tuples(*(torch.tensor(values, dtype=torch.float64) for values in (channels, rho, phi)))


def with_parts(bank, *filters, **options):
    """One filter for each of ``filters``, a sequence of parts."""
    layer = Cosfire(bank, **options)
    example = torch.rand(1, 9, 9, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    for parts in filters:
        layer.strategy = Given(tuple(parts))
        layer.configure(example)
    return layer


def random_images(seed, *shape, dtype=torch.float64):
    return torch.rand(*shape, dtype=dtype, generator=torch.Generator().manual_seed(seed))


@st.composite
def banks(draw):
    border = draw(st.sampled_from(BORDERS))
    if draw(st.booleans()):
        phase = draw(st.sampled_from([0.0, 90.0, 180.0]))
        return GaborBank((2.6, 4.0), draw(st.integers(1, 6)), phase_deg=phase, border=border)
    return DoGBank((1.0, 1.6), (1, -1), ratio=draw(st.sampled_from([0.4, 0.5])), border=border)


@st.composite
def part_lists(draw, bank):
    channels = [tuple(row) for row in bank.grid().tolist()]
    part = st.tuples(st.sampled_from(channels), st.sampled_from([0.0, 1.0, 2.5, 4.0]), st.floats(0.0, 2 * math.pi))
    return draw(st.lists(part, min_size=1, max_size=6))


@st.composite
def layers(draw, shift="whole", means=("geometric",), tolerant=True):
    """A layer with one to three filters, and their parts."""
    bank = draw(banks())
    filters = [draw(part_lists(bank)) for _ in range(draw(st.integers(1, 3)))]
    blur = Blur(
        draw(st.sampled_from([0.0, 0.67, 1.5])),
        draw(st.sampled_from([0.0, 0.1])),
        kind=draw(st.sampled_from(["max", "sum"])),
        reach=draw(st.sampled_from([3.0, 3.5])),
        fixed_reach=draw(st.sampled_from([None, None, 2])),
        border=draw(st.sampled_from(BORDERS)),
    )
    tolerance = Tolerance(
        draw(st.integers(1, 3)),
        draw(st.sampled_from([180.0, 360.0])),
        (0.8, 1.0)[draw(st.integers(0, 1)) :],
        draw(st.booleans()),
    )
    layer = with_parts(
        bank,
        *filters,
        blur=blur,
        mean=draw(st.sampled_from(means)),
        least_weight=draw(st.sampled_from([0.5, 1.0])),
        tolerance=tolerance if tolerant else None,
        t1=draw(st.sampled_from([0.0, 0.2])),
        t3=draw(st.sampled_from([0.0, 0.3])),
        floor=draw(st.sampled_from([0.0, 0.05])),
        shift=shift,
        border=draw(st.sampled_from(BORDERS)),
    )
    return layer, filters


def plain_responses(layer, filters, images):
    """What the layer must give, (b, n, h, w): loops over images and filters, and within those over all else."""
    bank = layer.bank

    def maps(image, channel):
        if isinstance(bank, DoGBank):
            return dog(image, channel, ratio=bank.ratio, border=bank.border)
        return gabor(image, channel, phase=math.radians(bank.phase_deg), border=bank.border)

    def moved(channel, move):
        if isinstance(bank, DoGBank):
            return channel[0] * move.scale, channel[1]
        theta = math.pi - channel[1] if move.mirrored else channel[1]
        return channel[0] * move.scale, theta + move.rotation_rad

    found = []
    for image in images.double().numpy():
        strongest = max(maps(image[0], channel).max() for channel in bank.grid().tolist())
        moves = list(layer.tolerance.moves())
        found.append([plain_response(image[0], maps, strongest, parts, moved, moves, layer) for parts in filters])
    return np.array(found)
