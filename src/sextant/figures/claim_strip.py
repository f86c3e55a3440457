"""A small picture of a claim: the interval of each of its comparisons, as SVG text."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

#: of the labels, the intervals and the values beside them; of a row; below the rows
LABELS, INTERVALS, VALUES, ROW, FOOT = 230, 280, 290, 18, 20
WIDTH, MARGIN = LABELS + INTERVALS + VALUES, 10

STYLE = (
    "text{font:11px sans-serif;fill:#444}.axis{stroke:#888}.matters{fill:#8884}.shown{stroke:#0072B2;fill:#0072B2}"
    ".beside{stroke:#999;fill:#999}@media(prefers-color-scheme:dark){text{fill:#bbb}.shown{stroke:#56B4E9;fill:#56B4E9}}"
)


@dataclass(frozen=True)
class Strip:
    """One comparison, positive where it favours the claim; nan where no interval is known.

    Attributes:
        label: name of the comparison.
        value: effect and interval with their unit, as text.
        mean, low, high: the same as numbers.
        matters: the smallest effect that matters.
        counts: whether it decides the claim.
    """

    label: str
    value: str
    mean: float
    low: float
    high: float
    matters: float
    counts: bool


def claim_strips(strips: Sequence[Strip]) -> str:
    """An SVG with a row per comparison: the right favours the claim; what does not count is grey.

    Each row has its label, its value with the unit, and its own scale, since comparisons may have different units. The
    zero line is shared, and the band covers effects too small to matter. Coordinates have one decimal, so that the same
    figures give the same bytes.

    >>> strip = Strip("day", "+1.0 m", 1.0, 0.5, 1.5, matters=0.2, counts=True)
    >>> picture = claim_strips([strip])
    >>> picture.count("<circle"), 'class="shown"' in picture
    (1, True)
    """
    height = ROW * len(strips) + FOOT
    middle, half = LABELS + INTERVALS / 2, INTERVALS / 2 - MARGIN
    parts = [f'<line class="axis" x1="{middle:.1f}" y1="0" x2="{middle:.1f}" y2="{height - FOOT}"/>']
    for number, strip in enumerate(strips):
        y = ROW * number + ROW / 2
        ends = [abs(v) for v in (strip.mean, strip.low, strip.high, strip.matters) if math.isfinite(v)]
        scale = half / (max(ends) or 1.0)
        low, high, mean = (middle + scale * v for v in (strip.low, strip.high, strip.mean))
        kind = "shown" if strip.counts else "beside"
        parts.append(f'<text x="0" y="{y + 4:.1f}">{_cut(strip.label, 38)}</text>')
        parts.append(f'<text x="{LABELS + INTERVALS + MARGIN}" y="{y + 4:.1f}">{_cut(strip.value, 48)}</text>')
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
        f'<text x="{LABELS}" y="{height - 5}">against the claim</text>',
        f'<text x="{LABELS + INTERVALS}" y="{height - 5}" text-anchor="end">for it</text>',
        f'<text x="{LABELS + INTERVALS + MARGIN}" y="{height - 5}">band: too small to matter</text>',
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}">\n'
        f"<style>{STYLE}</style>\n" + "\n".join(parts) + "\n</svg>\n"
    )


def _cut(text: str, most: int) -> str:
    """A text for SVG, of at most so many characters."""
    return escape(text if len(text) <= most else f"{text[: most - 1]}…")
