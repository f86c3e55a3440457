"""``sextant claims``: which claims of the thesis hold."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field
from rich.table import Table

from sextant.cli.arguments import Options, UserPath
from sextant.cli.console import console
from sextant.cli.output_folder import make_output
from sextant.errors import UserError

USAGE = """\
sextant claims [claim=<name>|all] [output=<folder>] [html=<folder>]
sextant claims preset=quick|full [workers=2] [launcher=slurm launcher.<key>=<value> tracking=<option>]"""
#: config groups that are passed on to a preset's sweeps
GROUPS = ("launcher", "tracking")


class ClaimsOptions(Options):
    """What the user chose."""

    claim: str = "all"
    """one of conf/claim (default: all)"""
    preset: Literal["stored", "quick", "full"] = "stored"
    """run what is missing of the claims' sweeps, full or quick; without it, the stored results decide"""
    workers: int | None = Field(None, ge=1, examples=[2])
    """processes on this machine for the sweeps of a preset; launcher.* and tracking.* are passed on to the sweeps"""
    output: UserPath | None = None
    """folder for claims.md and its pictures (default for all claims: docs, or outputs/claims/<preset> with a preset)"""
    html: UserPath | None = None
    """folder for claims.html: the board as one page with charts, without server or network"""
    digests: Literal["check", "renew"] = "check"
    """renew: accept the stored results as they are, after their sweeps were run again"""


def main(arguments: Sequence[str]) -> None:
    """Decide claims, write their board, and list the verdicts."""
    handed_on = [each for each in arguments if each.partition("=")[0].partition(".")[0] in GROUPS]
    options = ClaimsOptions.parse([each for each in arguments if each not in handed_on], USAGE)
    of_sweeps = handed_on + [f"workers={options.workers}"] * bool(options.workers)
    if of_sweeps and options.preset == "stored":
        raise UserError(f"{of_sweeps[0]} is of the sweeps of a preset, and none is chosen", "Add preset=quick or full")
    if options.workers and any(each.startswith("launcher=") and each != "launcher=joblib" for each in handed_on):
        raise UserError(f"workers={options.workers} goes with launcher=joblib alone")
    for key in ("output", "html"):
        if (folder := getattr(options, key)) is not None:
            make_output(folder, key)
    from sextant.lifecycle import claims as life
    from sextant.lifecycle.claim_files import read_claims
    from sextant.reports.claims_board import seeds_told
    from sextant.runs.outputs_folder import default_outputs

    claims, stored = read_claims(options.claim), life.stored_results()
    if options.digests == "renew":
        life.renew_digests(read_claims(), stored)
    else:
        life.check_digests(claims, stored)
    tables, output, command = life.Tables(stored), stored, "sextant claims"
    if options.preset != "stored":
        from sextant.cli.terminal import TERMINAL
        from sextant.tracking.environment import quiet_libraries

        quiet_libraries()
        overrides = handed_on + [f"launcher.workers={options.workers}"] * bool(options.workers)
        tables = life.run_claims(claims, options.preset, stored, overrides, TERMINAL, TERMINAL)
        output, command = default_outputs() / "claims" / options.preset, f"{command} preset={options.preset}"
    decided = life.decide_claims(claims, tables)
    for sweep, why in tables.left_out.items():
        console.print(f"not run: {sweep}: {why}", markup=False)
    if not decided:
        raise UserError(f"none of {len(claims)} claims could be decided: none of their sweeps was run, as said above")
    chosen = options.output or (output if options.claim == "all" else None)  # the board in docs covers all claims
    pages = life.write_board(claims, tables, command, chosen, options.html)
    table = Table("claim", "verdict", "effect in its favour, 95 %", "asked", "seeds")
    for claim in decided:
        first = claim.deciding
        told = seeds_told(first, claim.verdict, len(claim.counting))
        table.add_row(claim.name, claim.verdict, f"{first.effect()} {first.unit}", first.asked(), told)
    console.print(table)
    for page in pages:
        console.print(str(page), markup=False)
