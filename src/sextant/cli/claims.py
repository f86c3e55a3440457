"""``sextant claims``: which claims of the thesis hold."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field
from rich.table import Table

from sextant.cli.arguments import Options, UserPath
from sextant.cli.console import console

USAGE = """\
sextant claims [claim=<name>|all] [output=<folder>] [html=<folder>]
sextant claims preset=quick|full [launcher=joblib workers=2]"""


class ClaimsOptions(Options):
    """What the user chose."""

    claim: str = "all"
    """one of conf/claim; all unless given"""
    preset: Literal["stored", "quick", "full"] = "stored"
    """run what is missing of the sweeps, at full size or quick; without it, the stored results decide"""
    launcher: str | None = None
    """of a preset's sweeps: an option of conf/launcher; each sweep's own unless given"""
    workers: int | None = Field(None, ge=1, examples=[2])
    """processes of the launcher"""
    output: UserPath | None = None
    """folder of claims.md and its pictures; for all claims docs, or outputs/claims/<preset> of a preset"""
    html: UserPath | None = None
    """folder of claims.html: the board as one page with charts, which needs no server and no network"""
    digests: Literal["check", "renew"] = "check"
    """renew: take in the stored results as they are, after their sweeps were run anew"""


def main(arguments: Sequence[str]) -> None:
    """Decide claims, write their board, and list the verdicts."""
    options = ClaimsOptions.parse(arguments, USAGE)
    from sextant.lifecycle import claims as life
    from sextant.lifecycle.claim_files import read_claims
    from sextant.reports.claims_board import seeds_told
    from sextant.runs.outputs_folder import default_outputs

    claims, stored = read_claims(options.claim), life.stored_results()
    if options.digests == "renew":
        life.renew_digests(read_claims(), stored)
    life.check_digests(claims, stored)
    tables, output, command = life.Tables(stored), stored, "sextant claims"
    if options.preset != "stored":
        from sextant.cli.terminal import TERMINAL
        from sextant.tracking.environment import quiet_libraries

        quiet_libraries()
        given = {"launcher": options.launcher, "launcher.workers": options.workers}
        overrides = [f"{key}={value}" for key, value in given.items() if value is not None]
        tables = life.run_claims(claims, options.preset, stored, overrides, TERMINAL, TERMINAL)
        output, command = default_outputs() / "claims" / options.preset, f"{command} preset={options.preset}"
    decided = life.decide_claims(claims, tables)
    chosen = options.output or (output if options.claim == "all" else None)  # the board in docs is of all
    pages = life.write_board(claims, tables, command, chosen, options.html)
    table = Table("claim", "verdict", "effect in its favour, 95 %", "asked", "seeds")
    for claim in decided:
        first = claim.deciding
        told = seeds_told(first, claim.verdict, len(claim.counting))
        table.add_row(claim.name, claim.verdict, f"{first.effect()} {first.unit}", first.asked(), told)
    console.print(table)
    for sweep, why in tables.left_out.items():
        console.print(f"not run: {sweep}: {why}", markup=False)
    for page in pages:
        console.print(str(page), markup=False)
