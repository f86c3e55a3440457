"""A small picture of a claim: the interval of each of its comparisons, as SVG text."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH, ROW, MARGIN, FOOT = 360, 16, 12, 18

STYLE = (
    "text{font:11px sans-serif;fill:#444}.axis{stroke:#888}.matters{fill:#8884}.shown{stroke:#0072B2;fill:#0072B2}"
    ".beside{stroke:#999;fill:#999}@media(prefers-color-scheme:dark){text{fill:#bbb}.shown{stroke:#56B4E9;fill:#56B4E9}}"
)


@dataclass(frozen=True)
class Strip:
    """One comparison, positive where it favours the claim; nan where no interval is known."""

    mean: float
    low: float
    high: float
    matters: float
    counts: bool


def claim_strips(strips: Sequence[Strip]) -> str:
    """An SVG with a row per comparison: the right favours the claim; what does not count is grey.

    Each row has its own scale, since comparisons may have different units. The zero line is shared, and the band covers
    effects too small to matter. Coordinates have one decimal, so that the same figures give the same bytes.

    >>> picture = claim_strips([Strip(mean=1.0, low=0.5, high=1.5, matters=0.2, counts=True)])
    >>> picture.count("<circle"), 'class="shown"' in picture
    (1, True)
    """
    height = ROW * len(strips) + FOOT
    middle, half = WIDTH / 2, WIDTH / 2 - MARGIN
    parts = [f'<line class="axis" x1="{middle:.1f}" y1="0" x2="{middle:.1f}" y2="{height - FOOT}"/>']
    for number, strip in enumerate(strips):
        y = ROW * number + ROW / 2
        ends = [abs(v) for v in (strip.mean, strip.low, strip.high, strip.matters) if math.isfinite(v)]
        scale = half / (max(ends) or 1.0)
        low, high, mean = (middle + scale * v for v in (strip.low, strip.high, strip.mean))
        kind = "shown" if strip.counts else "beside"
        if strip.matters:
            left, width = middle - scale * strip.matters, 2 * scale * strip.matters
            box = f'x="{left:.1f}" y="{y - ROW / 2 + 1:.1f}" width="{width:.1f}" height="{ROW - 2}"'
            parts.append(f'<rect class="matters" {box}/>')
        if math.isfinite(low) and math.isfinite(high):
            parts.append(
                f'<line class="{kind}" stroke-width="2" x1="{low:.1f}" y1="{y:.1f}" x2="{high:.1f}" y2="{y:.1f}"/>'
            )
        if math.isfinite(mean):
            parts.append(f'<circle class="{kind}" cx="{mean:.1f}" cy="{y:.1f}" r="3.5"/>')
    parts += [
        f'<text x="{MARGIN}" y="{height - 5}">against the claim</text>',
        f'<text x="{WIDTH - MARGIN}" y="{height - 5}" text-anchor="end">for it</text>',
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}">\n'
        f"<style>{STYLE}</style>\n" + "\n".join(parts) + "\n</svg>\n"
    )
