"""The design of a claim before it is run: its power, the effect that it can detect, and its cost."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from scipy import stats

from sextant.config.schema.claims import Claim, Design
from sextant.errors import UserError
from sextant.evaluation.verdict import MOST_SEEDS, POWER, TAIL, Estimate, detectable, equivalence_power, power
from sextant.lifecycle.claim_files import Claims
from sextant.lifecycle.claims import Tables, decide_claims, design_arguments
from sextant.lifecycle.sweep_plan import read_design
from sextant.reports.claims_board import DecidedClaim


@dataclass(frozen=True)
class ClaimPlan:
    """A design and what follows from it, in the unit of the claim.

    Attributes:
        arguments: overrides that run it; empty for a design with a command.
        number, seeds: numbers of replicates, and of seeds in each world.
        spread: standard deviation of one replicate's difference.
        detectable: the least true effect that is detected with probability 0.8; for a claim of a difference, beyond the
            smallest that matters; for a claim of no loss, the loss that can be ruled out if there is none.
        power: probability that each comparison holds if the true effect is the design's.
        needed: least number of replicates whose power is ``POWER``; infinite beyond ``MOST_SEEDS``.
        runs: number of runs.
        core_hours: of all runs.
    """

    name: str
    claim: Claim
    design: Design
    arguments: list[str]
    number: int
    seeds: int
    spread: float
    detectable: float
    power: float
    needed: float
    runs: int
    core_hours: float


def plan_claims(claims: Claims, tables: Tables) -> Iterator[ClaimPlan]:
    """The plan of every claim that has a design; spreads missing in a design are those of the stored pairs."""
    for decided in decide_claims(claims, tables):
        if decided.stated.design is not None:
            yield plan_claim(decided)


def plan_claim(decided: DecidedClaim) -> ClaimPlan:
    """The power, detectable effect and cost of the design of a claim.

    A design without a spread takes the largest of the stored comparisons that count, in the unit and with the smallest
    effect of the claim. Where the replicate is the world, the spread between worlds, which stored runs do
    not give, is assumed equal to that between seeds, so that the mean of s seeds in a world has the variance
    ``spread² (1 + 1 / s)``.
    """
    claim = decided.stated
    design, arguments = claim.design, design_arguments(claim)
    assert design is not None
    over_worlds = design.replicate == "worlds"
    number, seeds, runs = design.replicates, 1, design.replicates
    if not design.command:
        planned = read_design(arguments)
        number, seeds = (len(planned.worlds), len(planned.seeds)) if over_worlds else (len(planned.seeds), 1)
        runs = planned.runs
    spread = design.spread
    if spread is None:
        alike = [each for each in decided.counting if (each.unit, each.matters) == (claim.unit, claim.matters)]
        spreads = [_spread(each.estimate) for each in alike if each.estimate.run]
        if not spreads:
            raise UserError(f"claim {decided.name}: no stored run gives its spread", "Give design.spread in its file.")
        spread = max(spreads)
        if over_worlds:
            spread *= math.sqrt(1 + 1 / seeds)
    expects = decided.counting[0].expects

    def chance(count: int) -> float:
        if expects == "same":
            return equivalence_power(claim.matters + design.effect, claim.matters - design.effect, spread, count)
        border = claim.matters if expects == "better" else -claim.matters
        return power(design.effect - border, spread, count)

    enough = (count for count in range(2, MOST_SEEDS + 1) if chance(count) >= POWER)
    least = detectable(spread, number, (1 + POWER) / 2 if expects == "same" else POWER)  # of two borders, each
    return ClaimPlan(
        decided.name,
        claim,
        design,
        arguments,
        number,
        seeds,
        spread,
        claim.matters + least if expects == "better" else least,
        chance(number),
        next(enough, math.inf),
        runs,
        runs * design.core_hours,
    )


def _spread(found: Estimate) -> float:
    """The standard deviation of one pair of runs, from an estimate's error or interval."""
    error = found.error
    if found.known is not None and found.seeds > 1:
        error = (found.known[1] - found.known[0]) / 2 / float(stats.t.ppf(1 - TAIL, found.seeds - 1))
    return 0.0 if math.isnan(error) else math.sqrt(max(0.0, error**2 - found.images**2) * found.seeds)
