"""The board of claims: a verdict for each claim, as Markdown, with a small picture."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Literal

from sextant.config.schema.claims import Claim
from sextant.evaluation.protocols import SEEDS_FOR_A_CLAIM, WORLDS_FOR_A_CLAIM
from sextant.evaluation.verdict import (
    MOST_SEEDS,
    TAIL,
    Estimate,
    Expectation,
    Verdict,
    decide,
    further_images,
    further_seeds,
    together,
)
from sextant.figures.claim_strip import Strip, claim_strips
from sextant.tables import NOTHING, TextTable, counted, decimals

SAYS: Mapping[Expectation, str] = {"better": "more than", "as_good": "not worse than by", "same": "the same within"}
#: what a claim requires, in a sentence
REQUIRES: Mapping[Expectation, str] = {
    "better": "a gain of more than",
    "as_good": "a loss of less than",
    "same": "a difference of less than",
}
#: whether the runs of a claim tested it as it was fixed before them
Status = Literal["counted", "planned", "explored", "confirmed", "refuted", "open"]
#: effect of a comparison without runs
NOT_YET = "not run yet"
#: verdicts from the one that decides a claim to the one that does not
ORDER: tuple[Verdict, ...] = ("fails", "not learnt", "undecided", "holds")
HOW_TO_READ = """\
Effects are positive where they support the claim, with 95 % intervals over seeds (or worlds) and, where stored, test
images. A claim

- *holds* if the interval lies beyond the smallest effect that matters and that of seeds alone, or excludes a loss that
  matters;
- *fails* if the interval excludes what the claim requires;
- is *not learnt* if an arm is no better than a constant or than methods that learn nothing;
- is *undecided* otherwise, with fewer than {seeds} seeds or {worlds} worlds, or if runs were cut short.

Several comparisons must all hold, and one that fails decides, with Bonferroni's correction. If verdicts differ, a table
has the worst conditions that do not hold; [comparisons.csv](claims/comparisons.csv) has everything. Runs older than
the claim, and figures without a date, *explore* it, later ones *confirm* or *refute* it, and without runs it is
*planned*. `sextant claims plan` lists the next runs. If all {estimated} estimated effects were at their borders, at
most {chance:.1f} would be decided by chance; {decided} are.
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

    def effect(self, *, with_unit: bool = False) -> str:
        """The effect with its interval, positive where it favours the claim, and its unit if requested."""
        if with_unit:
            return f"{self.effect()} {self.unit}" if self.estimate.run else NOT_YET
        found, (low, high) = self.estimate, self._ends()
        if math.isnan(found.mean):
            return NOTHING if found.run else NOT_YET
        digits = decimals(max(abs(found.mean), abs(high - low) if math.isfinite(high - low) else 0.0), 3)
        if found.counted or not math.isfinite(low):
            return f"{found.mean:+.{digits}f}"
        return f"{found.mean:+.{digits}f} [{low:+.{digits}f}, {high:+.{digits}f}]"

    def strip(self) -> Strip:
        """The interval as it is drawn in the picture."""
        value = self.effect(with_unit=True)
        return Strip(self.label, value, self.estimate.mean, *self._ends(), self.matters, not self.beside)

    def asked(self) -> str:
        """The requirement of the claim, in words."""
        floor = abs(self.estimate.floor)
        above = f" (seeds alone: {floor:.3g})" if self.expects == "better" and floor > self.matters else ""
        return f"{SAYS[self.expects]} {self.matters:g}{above}"

    def _ends(self) -> tuple[float, float]:
        (low, high), most = self.estimate.interval(), self.estimate.most
        return (max(low, -most), min(high, most))


@dataclass(frozen=True)
class DecidedClaim:
    """A claim and the comparisons that decide it.

    Attributes:
        name: name of the claim.
        stated: the claim as it was fixed.
        runs: how the results were measured.
        begun: start of the first run that decides it; empty if not recorded.
        commands: commands that measure it.
        comparisons: those that decide it, and those beside them.
    """

    name: str
    stated: Claim
    runs: str
    begun: str
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

    @property
    def status(self) -> Status:
        """Whether runs after the claim was fixed confirm or refute it, earlier ones explore it, or there is none."""
        if self.counted:
            return "counted"
        if all(not each.estimate.run for each in self.counting):
            return "planned"
        if not self.begun or datetime.fromisoformat(self.begun) < datetime.fromisoformat(self.stated.date):
            return "explored"
        later: dict[Verdict, Status] = {"holds": "confirmed", "fails": "refuted"}
        return later.get(self.verdict, "open")


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
        cut_short: the same claims as decided by shortened runs, where there are such runs.
    """
    again = {claim.name: claim for claim in cut_short}
    found = [claim.verdict for claim in claims]
    told = [f"{found.count(verdict)} {words}" for verdict, words in SUMMARY.items() if verdict in found]
    parts = [
        "# The claims of the thesis\n",
        f"Written by `{command}`; changes made by hand are lost. {counted(len(claims), 'claim')}: {', '.join(told)}.\n",
        _how_to_read(claims),
        TextTable(["claim", "chapter", "verdict", "runs", "effect in its favour"], [*map(_row, claims)]).markdown(),
        *(_section(claim, pictures, again.get(claim.name)) for claim in claims),
    ]
    if left_out:
        parts.append("## Not measured\n")
        parts.append("".join(f"- `{name}`: {why}\n" for name, why in left_out.items()))
    return "\n".join(parts)


def picture(claim: DecidedClaim) -> str:
    """The picture of a claim, as SVG text."""
    return claim_strips([each.strip() for each in claim.comparisons])


def comparison_rows(claims: Sequence[DecidedClaim]) -> TextTable:
    """Every comparison of every claim, for a file."""
    columns = [
        "claim",
        "comparison",
        "effect",
        "low",
        "high",
        "unit",
        "expects",
        "matters",
        "verdict",
        "counts",
        "note",
    ]
    rows = []
    for claim in claims:
        for each in claim.comparisons:
            low, high = each.estimate.interval()
            numbers = (f"{value:.6g}" for value in (each.estimate.mean, low, high))
            verdict = each.verdict(len(claim.counting))
            counts = "beside" if each.beside else "counts"
            asked = (each.unit, each.expects, f"{each.matters:g}")
            rows.append([claim.name, each.label, *numbers, *asked, verdict, counts, each.note])
    return TextTable(columns, rows)


def replicates_told(comparison: Comparison) -> str:
    """The number of replicates of a comparison, in words."""
    found = comparison.estimate
    if found.counted or not found.run:
        return NOTHING
    return f"{found.seeds} {found.replicate if found.seeds != 1 else found.replicate[:-1]}"


def advice(comparison: Comparison, parts: int) -> str:
    """What would decide an undecided comparison, as one of ``parts`` of a claim.

    More seeds or worlds are advised only where they, and not the test images, determine the width of the interval.
    """
    found = comparison.estimate
    if found.cut_short or not found.run:
        return "the runs of its plan (`sextant claims plan`)"
    asked = (found, comparison.expects, comparison.matters, parts)
    more, times, unit = further_seeds(*asked), further_images(*asked), found.replicate
    if more is None:
        return f"how many more {unit} is not known"
    if math.isfinite(more):
        return f"{'at least' if more and (found.alike or math.isnan(found.error)) else 'about'} {more:.0f} more {unit}"
    if math.isfinite(times):
        return f"not more {unit}, but about {times:.0f} times as many test images"
    seeds_alone = replace(found, error=math.sqrt(max(0.0, found.error**2 - found.images**2)), images=0.0)
    if found.images > 0 and math.isfinite(further_seeds(seeds_alone, *asked[1:]) or 0):
        return f"more {unit} and more test images together"
    return f"more than {MOST_SEEDS:,} more {unit}, as the effect lies at the border"


SUMMARY: Mapping[Verdict, str] = {
    "holds": "held up",
    "fails": "failed",
    "undecided": "undecided",
    "not learnt": "not learnt",
}


def _how_to_read(claims: Sequence[DecidedClaim]) -> str:
    estimated = [claim for claim in claims if claim.status not in ("counted", "planned")]
    return HOW_TO_READ.format(
        seeds=SEEDS_FOR_A_CLAIM,
        worlds=WORLDS_FOR_A_CLAIM,
        estimated=len(estimated),
        chance=2 * TAIL * len(estimated),
        decided=sum(claim.verdict in ("holds", "fails") for claim in estimated),
    )


def _row(claim: DecidedClaim) -> list[str]:
    first = claim.deciding
    link = f"[{claim.name}](#{claim.name})"
    return [link, str(claim.stated.chapter), f"**{claim.verdict}**", claim.status, first.effect(with_unit=True)]


def _section(claim: DecidedClaim, pictures: str, again: DecidedClaim | None) -> str:
    stated = claim.stated
    required = stated.requires or f"{REQUIRES[claim.counting[0].expects]} {stated.matters:g} {stated.unit}"
    published = "" if stated.published.startswith("claimed;") else f" Published: {stated.published}."
    quick = "" if again is None else f" Runs cut short: {again.verdict}."
    commands = "\n".join(claim.commands)
    return (
        f'## <a name="{claim.name}"></a>`{claim.name}`: {claim.verdict}\n\n{stated.sentence} '
        f"[Details]({stated.page})\n\n"
        f"- **Requires** {required} ({stated.reason}).{published}\n"
        f"- **Found**: {' '.join(filter(None, (_answer(claim), _how_sure(claim))))}{quick}\n"
        f"- **Not covered**: {stated.not_covered}\n\n"
        f"![intervals]({pictures}/{claim.name}.svg)\n{_table(claim)}\n"
        f"```bash\n{commands}\n```\n"
    )


def _table(claim: DecidedClaim) -> str:
    """The worst condition of each contrast that was run and does not hold, if verdicts differ."""
    groups: dict[tuple[str, str, float, str], list[Comparison]] = {}
    for each in claim.counting:
        name = each.label.partition(", ")[0]
        groups.setdefault((name, each.unit, each.matters, each.note), []).append(each)
    notes = {note for *_, note in groups}
    shared = notes.pop() if len(notes) == 1 else ""
    told = f"\n{shared[0].upper()}{shared[1:]}.\n" if shared else ""
    if len(groups) == 1 or len(set(claim.verdicts)) == 1:
        return told
    rows = []
    for (name, *_), alike in groups.items():
        worst = min(alike, key=lambda each: (ORDER.index(each.verdict(len(claim.counting))), _distance(each)))
        if not worst.estimate.run or worst.verdict(len(claim.counting)) == "holds":
            continue
        label = worst.label if len(alike) == 1 else f"{name}, worst of {len(alike)}"
        unit = "" if worst.unit == claim.stated.unit else f" {worst.unit}"
        asked = "" if worst.matters == claim.stated.matters else f", required: {worst.matters:g}"
        note = f" ({worst.note})" if worst.note != shared else ""
        effect = worst.effect() + (unit + asked) * worst.estimate.run
        rows.append([label + note, effect, worst.verdict(len(claim.counting))])
    if len(rows) < 2:  # the answer names a single one
        return told
    return "\n" + TextTable(["comparison", "effect in its favour", "verdict"], rows).markdown() + told


def _answer(claim: DecidedClaim) -> str:
    """The verdict in words, with the figure that decides it."""
    first, total, alike = claim.deciding, len(claim.counting), claim.verdicts.count(claim.verdict)
    if claim.verdict == "not learnt":
        where = "" if total == 1 else f" in {alike} of {total} comparisons"
        return f"an arm learnt nothing{where}."
    some = f"{alike} of {total} comparisons {'is' if alike == 1 else 'are'}"
    which = {
        "holds": f"{'both' if total == 2 else f'all {total}'} comparisons hold, the closest",
        "fails": f"{some} excluded,",
        "undecided": f"{some} undecided,",
    }[claim.verdict]
    waiting = sum(not each.estimate.run for each in claim.counting)
    if waiting == total:
        return "no comparison has been run yet."
    if claim.verdict == "undecided" and waiting:
        others = f"; {alike - waiting} of the others undecided" if alike > waiting else ""
        return f"{waiting} of {counted(total, 'comparison')} {'is' if waiting == 1 else 'are'} not run yet{others}."
    figure = f"{first.effect()} {first.unit} ({first.label})"
    return f"{figure}." if total == 1 else f"{which} with {figure}."


def _how_sure(claim: DecidedClaim) -> str:
    """What the interval is over, and what would decide the claim."""
    if claim.counted:
        return f"{claim.runs}." if claim.runs.startswith("sextant ") else f"{claim.runs[:1].upper()}{claim.runs[1:]}."
    first = claim.deciding
    images = " and a sample of images" if first.estimate.images > 0 else ""
    if not first.estimate.run:
        return ""
    text = f"Over {replicates_told(first)}{images}."
    if claim.verdict == "undecided":
        text += f" To decide: {advice(first, len(claim.counting))}."
    return text


def _needed(comparison: Comparison, parts: int) -> float:
    """Further replicates that a comparison needs; infinite if they would not decide it or are unknown."""
    more = further_seeds(comparison.estimate, comparison.expects, comparison.matters, parts)
    return math.inf if more is None else more


def _distance(comparison: Comparison) -> float:
    """How far the interval of an effect that holds lies beyond its border, relative to the interval's width."""
    low, high = comparison.estimate.interval()
    border = comparison.matters if comparison.expects == "better" else -comparison.matters
    return (low - border) / (high - low) if 0 < high - low < math.inf else math.inf
