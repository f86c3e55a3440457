"""The board of claims as an HTML page."""

import math
from collections.abc import Sequence

from sextant.figures.charts import Spec
from sextant.figures.interval_chart import IntervalRow, interval_chart
from sextant.reports.claims_board import Comparison, DecidedClaim, advice, replicates_told
from sextant.reports.page.html_page import html_page

VERDICTS = ("holds", "fails", "undecided", "not learnt")
BESIDE = "beside"


def claims_page(claims: Sequence[DecidedClaim], board: str) -> str:
    """The board as an HTML page: its text, with a chart of all claims on top and one per claim instead of its picture.

    Args:
        claims: the decided claims.
        board: their Markdown text from :func:`~sextant.reports.claims_board.board`.
    """
    title, rest = board.split("\n", 1)
    text = f"{title}\n\n![all claims](overview.svg)\n{rest}"
    return html_page("Claims", text, {"overview": [_overview(claims)], **{c.name: _of_claim(c) for c in claims}})


def _overview(claims: Sequence[DecidedClaim]) -> Spec:
    """All claims in units of the smallest effect that matters, except claims for which any effect matters."""
    rows = []
    for claim in claims:
        first = claim.deciding
        if first.matters:
            tip = {
                "claim": claim.stated.sentence,
                "verdict": claim.verdict,
                **_tip(first, len(claim.counting)),
                "published": claim.stated.published,
            }
            rows.append(_row(first, claim.name, claim.verdict, tip, 1 / first.matters, f"#{claim.name}"))
    axis = "effect in favour of the claim, in units of the smallest that matters"
    title = "The comparison that decides each claim; a click leads to it"
    return interval_chart(rows, axis, title, order=VERDICTS, marks=(-1.0, 0.0, 1.0), symlog=True)


def _of_claim(claim: DecidedClaim) -> list[Spec]:
    """One chart of the comparisons per unit."""
    charts, count = [], len(claim.counting)
    for unit in dict.fromkeys(each.unit for each in claim.comparisons):
        rows = []
        for each in (each for each in claim.comparisons if each.unit == unit):
            kind = BESIDE if each.beside else each.verdict(count)
            rows.append(_row(each, each.label, kind, {"comparison": each.label, "verdict": kind, **_tip(each, count)}))
        charts.append(interval_chart(rows, f"{unit} (for the claim: positive)", order=(*VERDICTS, BESIDE)))
    return charts


def _row(
    found: Comparison, label: str, kind: str, tip: dict[str, str], scale: float = 1.0, link: str = ""
) -> IntervalRow:
    strip = found.strip()
    mean, low, high, matters = (scale * value for value in (strip.mean, strip.low, strip.high, strip.matters))
    band = (-matters, matters) if matters else (math.nan, math.nan)
    return IntervalRow(label, mean, low, high, kind, band, tip=tip, link=link)


def _tip(found: Comparison, parts: int) -> dict[str, str]:
    told = {"effect": found.effect(with_unit=True), "asked": found.asked(), "rests on": replicates_told(found)}
    if not found.beside and found.verdict(parts) == "undecided":
        told["to decide"] = advice(found, parts)
    return told | ({"note": found.note} if found.note else {})
