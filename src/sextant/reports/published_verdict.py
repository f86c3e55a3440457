"""Published figures beside those of a sweep, and what single published runs can support."""

from collections import Counter
from collections.abc import Sequence

from sextant.evaluation import SEEDS_FOR_A_CLAIM
from sextant.reports.contrasts import ContrastRow
from sextant.reports.results import SweepResults
from sextant.reports.section import Summary
from sextant.tables import TextTable, number, with_interval


def beside_published(summaries: Sequence[Summary], results: SweepResults) -> str:
    """Median over converged seeds next to the published single run, for the clean condition; may be empty."""
    known = [s for s in summaries if s.condition == results.conditions[0] and s.published == s.published]
    if not known:
        return ""
    table = TextTable(
        ["setting", "arm", "median over converged seeds", "published", "difference"],
        [
            [s.setting, s.arm, number(s.median), number(s.published), number(s.median - s.published, sign=True)]
            for s in known
        ],
    )
    return (
        f"## {results.conditions[0].capitalize()} {results.measure.quantity} beside the published\n\n"
        + table.markdown()
    )


def published_verdict(rows: Sequence[ContrastRow]) -> str:
    """How many published differences exceed those of two runs of one network, and how many have the measured sign."""
    known = [row for row in rows if row.published == row.published and row.single_pair_reach == row.single_pair_reach]
    if not known:
        return "The sweep has no noise floor to compare the published figures with.\n"
    table = TextTable(
        [
            "setting",
            "condition",
            "published",
            "reach of one pair, seeds alone",
            "beyond it",
            "our difference",
            "reading",
        ],
        [
            [
                row.setting,
                row.condition,
                number(row.published, sign=True),
                f"± {number(row.single_pair_reach)}",
                "yes" if abs(row.published) > row.single_pair_reach else "no",
                with_interval(row.paired, sign=True),
                _reading(row),
            ]
            for row in known
        ],
    )
    beyond = sum(abs(row.published) > row.single_pair_reach for row in known)
    readings = Counter(_reading(row) for row in known)
    return (
        f"Two runs of the *same* convolution that differ only in their seeds differ by less than the reach given "
        f"below 95 times in 100. Of {len(known)} published differences, each of one run against one run, {beyond} lie "
        f"beyond it; a single pair cannot distinguish the other {len(known) - beyond} from chance. Over our seeds, by "
        f"Holm-corrected Wilcoxon tests at 0.05: {readings['same sign']} have the published sign, "
        f"{readings['opposite sign']} the opposite, {readings['undecided']} are undecided, "
        f"{readings['too few pairs']} rest on fewer than {SEEDS_FOR_A_CLAIM} pairs.\n\n" + table.markdown()
    )


def _reading(row: ContrastRow) -> str:
    if row.paired is None or row.exploratory:
        return "too few pairs"
    if not row.p_holm < 0.05:
        return "undecided"
    return "same sign" if row.paired.mean * row.published > 0 else "opposite sign"
