"""The board of claims: a verdict for each claim, as Markdown, with a small picture."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sextant.evaluation.protocols import SEEDS_FOR_A_CLAIM
from sextant.evaluation.verdict import MOST_SEEDS, TAIL, Estimate, Expectation, Verdict, decide, further_seeds, together
from sextant.figures.claim_strip import Strip, claim_strips
from sextant.reports.tables import NOTHING, TextTable, counted, decimals

SAYS: Mapping[Expectation, str] = {"better": "more than", "as_good": "not worse than by", "same": "the same within"}
#: largest possible difference of shares, in points
LARGEST = 100.0
HOW_TO_READ = """\
Effects are signed so that a positive one supports the claim, and come with their 95 % interval over seeds. A claim of
a difference *holds* if the interval lies beyond the smallest effect that matters (and, where it was measured, beyond
what a change of seeds alone makes). It *fails* if the interval rules out an effect that matters: then there is none,
or the opposite is true. A claim that nothing is lost holds if the interval rules out a loss that matters. Everything
else is *undecided*, and so is every claim that rests on fewer than {least} seeds. Beside an undecided claim stands how
many more seeds would decide it four times in five, if mean and spread stay as they are. A claim of several parts
holds if all of them hold; whether one fails is tested with Bonferroni's correction for their number. Comparisons
marked *beside* are shown for context and do not count. The smallest effects that matter were written down after the
stored runs and before any others. Claims in the same unit share them where they measure the same thing.

The repository stores the tables of each sweep's report, with the mean, spread and number of the pairs. Those of
`recorded.csv` are figures from the chapters' pages and reports, without their pairs. *Cut short* is the verdict of the
shorter runs of `preset=quick`, whose values are stored seed by seed in `claims/quick`.

**Multiplicity.** {estimated} of the {claims} claims are estimates; the others are counted. If each of their effects
were exactly at its border, at most {chance:.1f} would be expected to be called one way or the other by chance;
{decided} are.
"""


@dataclass(frozen=True)
class Comparison:
    """One comparison that a claim rests on; see :class:`sextant.config.schema.claims.ClaimPart`."""

    label: str
    estimate: Estimate
    expects: Expectation
    matters: float
    unit: str
    beside: bool = False
    note: str = ""

    def verdict(self, parts: int) -> Verdict:
        """The verdict of this comparison as one of ``parts`` that decide a claim."""
        return decide(self.estimate, self.expects, self.matters, parts)

    def effect(self) -> str:
        """The effect with its interval, positive where it favours the claim."""
        found, (low, high) = self.estimate, self._ends()
        if math.isnan(found.mean):
            return NOTHING
        digits = decimals(max(abs(found.mean), abs(high - low) if math.isfinite(high - low) else 0.0), 3)
        if found.counted or not math.isfinite(low):
            return f"{found.mean:+.{digits}f}"
        return f"{found.mean:+.{digits}f} [{low:+.{digits}f}, {high:+.{digits}f}]"

    def strip(self) -> Strip:
        """The interval as it is drawn in the picture."""
        return Strip(self.estimate.mean, *self._ends(), self.matters, not self.beside)

    def asked(self) -> str:
        """What the claim requires of the effect, in words."""
        floor = abs(self.estimate.floor)
        above = f" (seeds alone: {floor:.3g})" if self.expects == "better" and floor > self.matters else ""
        return f"{SAYS[self.expects]} {self.matters:g}{above}"

    def _ends(self) -> tuple[float, float]:
        low, high = self.estimate.interval()
        return (max(low, -LARGEST), min(high, LARGEST)) if self.unit.startswith("points") else (low, high)


@dataclass(frozen=True)
class DecidedClaim:
    """A claim and the comparisons that decide it; see :class:`sextant.config.schema.claims.Claim`."""

    name: str
    chapter: int
    sentence: str
    published: str
    page: str
    unit: str
    matters: float
    reason: str
    runs: str
    commands: Sequence[str]
    comparisons: Sequence[Comparison]

    @property
    def counting(self) -> list[Comparison]:
        """The comparisons that decide the claim."""
        return [each for each in self.comparisons if not each.beside]

    @property
    def verdicts(self) -> list[Verdict]:
        """The verdicts of the comparisons that decide the claim."""
        return [each.verdict(len(self.counting)) for each in self.counting]

    @property
    def verdict(self) -> Verdict:
        """The verdict of the whole claim."""
        return together(self.verdicts)

    @property
    def deciding(self) -> Comparison:
        """The comparison that determines the verdict.

        If all hold, this is the one nearest to its border; if more seeds are needed, the one that needs most.
        """
        made = [each for each, verdict in zip(self.counting, self.verdicts, strict=True) if verdict == self.verdict]
        if self.verdict == "undecided":
            return max(made, key=lambda each: _needed(each, len(self.counting)))
        return made[0] if self.verdict == "fails" else min(made, key=_distance)

    @property
    def counted(self) -> bool:
        """Whether all deciding figures are exact, so that nothing is estimated."""
        return all(each.estimate.counted for each in self.counting)


def board(
    claims: Sequence[DecidedClaim],
    pictures: str,
    command: str,
    left_out: Mapping[str, str],
    cut_short: Sequence[DecidedClaim] = (),
) -> str:
    """The board as a Markdown page.

    Args:
        claims: claims in the order of the page.
        pictures: folder of the pictures, relative to the page.
        command: command that writes the page.
        left_out: claims that were not measured, with the reason.
        cut_short: those of the same claims that shorter runs decide too.
    """
    again = {claim.name: claim for claim in cut_short}
    held, failed, open_ = (sum(c.verdict == verdict for c in claims) for verdict in ("holds", "fails", "undecided"))
    parts = [
        "# The claims of the thesis\n",
        f"Written by `{command}`; changes made by hand are lost. {counted(len(claims), 'claim')}: "
        f"{held} {'holds' if held == 1 else 'hold'}, {failed} {'fails' if failed == 1 else 'fail'}, "
        f"{open_} {'is' if open_ == 1 else 'are'} undecided.\n",
        _how_to_read(claims),
        TextTable(
            ["claim", "chapter", "verdict", "effect in its favour, 95 %", "asked", "unit", "published", "seeds"],
            [_row(claim) for claim in claims],
        ).markdown(),
        *(_section(claim, pictures, again.get(claim.name)) for claim in claims),
    ]
    if left_out:
        parts.append("## Not measured\n")
        parts.append("".join(f"- `{name}`: {why}\n" for name, why in left_out.items()))
    return "\n".join(parts)


def picture(claim: DecidedClaim) -> str:
    """The picture of a claim, as SVG text."""
    return claim_strips([each.strip() for each in claim.comparisons])


def seeds_told(comparison: Comparison, verdict: Verdict, parts: int) -> str:
    """The seeds of a comparison and, if undecided, the further ones it needs as one of ``parts`` of a claim."""
    found = comparison.estimate
    if found.counted:
        return NOTHING
    if verdict != "undecided":
        return str(found.seeds)
    more = further_seeds(found, comparison.expects, comparison.matters, parts)
    if more is None:
        return f"{found.seeds}; how many more is not known"
    if math.isinf(more):
        return f"{found.seeds}; more than {MOST_SEEDS:,} needed"
    return f"{found.seeds}; {'at least' if found.seeds < SEEDS_FOR_A_CLAIM else 'about'} {more} more needed"


def _how_to_read(claims: Sequence[DecidedClaim]) -> str:
    estimated = [claim for claim in claims if not claim.counted]
    by_chance = 2 * TAIL * len(estimated)
    decided = sum(claim.verdict != "undecided" for claim in estimated)
    return HOW_TO_READ.format(
        least=SEEDS_FOR_A_CLAIM, estimated=len(estimated), claims=len(claims), chance=by_chance, decided=decided
    )


def _row(claim: DecidedClaim) -> list[str]:
    first = claim.deciding
    return [
        *(f"[{claim.sentence}](#{claim.name})", str(claim.chapter), f"**{claim.verdict}**"),
        *(first.effect(), first.asked(), first.unit),
        *(claim.published, seeds_told(first, claim.verdict, len(claim.counting))),
    ]


def _section(claim: DecidedClaim, pictures: str, again: DecidedClaim | None) -> str:
    count = len(claim.counting)
    rows = []
    for each in claim.comparisons:
        verdict = each.verdict(count)
        told = "beside" if each.beside else verdict
        seeds = str(each.estimate.seeds) if each.beside else seeds_told(each, verdict, count)
        rows.append([each.label, each.effect(), each.unit, each.asked(), seeds, told, each.note])
    table = TextTable(["comparison", "effect in its favour, 95 %", "unit", "asked", "seeds", "verdict", "note"], rows)
    commands = "\n".join(claim.commands)
    return (
        f'## <a name="{claim.name}"></a>`{claim.name}`: {claim.verdict}\n\n{claim.sentence} '
        f"(Chapter {claim.chapter}, [{claim.page}]({claim.page}).)\n\n"
        f"- Published: {claim.published}.\n"
        f"- Smallest effect that matters: {claim.matters:g} {claim.unit}: {claim.reason}.\n"
        f"- Measured: {claim.runs}.\n{'' if again is None else _cut_short(again)}\n"
        f"![intervals of the comparisons]({pictures}/{claim.name}.svg)\n\n{table.markdown()}\n"
        f"```bash\n{commands}\n```\n"
    )


def _cut_short(claim: DecidedClaim) -> str:
    first = claim.deciding
    seeds = seeds_told(first, claim.verdict, len(claim.counting))
    return (
        f"- Cut short (`sextant claims claim={claim.name} preset=quick`): {claim.verdict}; {first.label}: "
        f"{first.effect()} {first.unit}{'' if seeds == NOTHING else f', seeds: {seeds}'}.\n"
    )


def _needed(comparison: Comparison, parts: int) -> float:
    more = further_seeds(comparison.estimate, comparison.expects, comparison.matters, parts)
    return math.inf if more is None else more


def _distance(comparison: Comparison) -> float:
    """How far the interval of an effect that holds lies beyond its border, relative to the interval's width."""
    low, high = comparison.estimate.interval()
    border = comparison.matters if comparison.expects == "better" else -comparison.matters
    return (low - border) / (high - low) if high > low else math.inf
