"""``sextant claims``: which claims of the thesis hold."""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field
from rich.table import Table

from sextant.console.arguments import Options, UserPath
from sextant.console.console import console
from sextant.console.written import make_output
from sextant.errors import UserError, command

USAGE = """\
sextant claims plan [claim=<name>|all]
sextant claims [claim=<name>|all] [output=<folder>] [html=<folder>]
sextant claims preset=quick|full [workers=2] [launcher=slurm launcher.<key>=<value> tracking=<option>]"""
#: config groups that are passed on to a preset's sweeps
GROUPS = ("launcher", "tracking")


class ClaimsOptions(Options):
    """What the user chose."""

    claim: str = "all"
    """name of a claim in conf/claim (default: all)"""
    preset: Literal["stored", "quick", "full"] = "stored"
    """run the missing cells of the claims' sweeps, full or quick; without it, the stored results are used"""
    workers: int | None = Field(None, ge=1, examples=[2])
    """parallel processes for a preset's sweeps; launcher.* and tracking.* are passed on to the sweeps"""
    output: UserPath | None = None
    """folder for claims.md and its figures (default for all claims: results, or outputs/claims/<preset>)"""
    html: UserPath | None = None
    """folder for claims.html: the summary as a self-contained page with charts"""
    digests: Literal["check", "renew"] = "check"
    """renew: accept the current stored results, for example after rerunning their sweeps"""


def main(arguments: Sequence[str]) -> None:
    """Decide claims, write their board, and list the verdicts; or list what their designs can detect."""
    if arguments[:1] == ["plan"]:
        _plan(ClaimsOptions.parse(arguments[1:], USAGE))
        return
    handed_on = [each for each in arguments if each.partition("=")[0].partition(".")[0] in GROUPS]
    options = ClaimsOptions.parse([each for each in arguments if each not in handed_on], USAGE)
    of_sweeps = handed_on + [f"workers={options.workers}"] * bool(options.workers)
    if of_sweeps and options.preset == "stored":
        raise UserError(f"{of_sweeps[0]} needs a preset: it applies to its sweeps", "Add preset=quick or full")
    if options.workers and any(each.startswith("launcher=") and each != "launcher=joblib" for each in handed_on):
        raise UserError(f"workers={options.workers} requires launcher=joblib")
    for key in ("output", "html"):
        if (folder := getattr(options, key)) is not None:
            make_output(folder, key)
    from sextant.lifecycle import claims as life
    from sextant.lifecycle.claim_files import read_claims
    from sextant.reports.claims_board import advice, replicates_told
    from sextant.runs.outputs_folder import default_outputs
    from sextant.tables import counted

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
        which = f"none of {counted(len(claims), 'claim')}"
        raise UserError(f"{which} could be decided: none of their sweeps was run, see above")
    chosen = options.output or (output if options.claim == "all" else None)  # the board in results covers all claims
    pages = life.write_board(claims, tables, command, chosen, options.html)
    table = Table("claim", "verdict", "runs", "effect in its favour, 95 %", "required", "rests on", "to decide")
    for claim in decided:
        first = claim.deciding
        more = advice(first, len(claim.counting)) if claim.verdict == "undecided" else ""
        shown = (claim.name, claim.verdict, claim.status, first.effect(with_unit=True), first.asked())
        table.add_row(*shown, replicates_told(first), more)
    console.print(table)
    for page in pages:
        console.print(str(page), markup=False)


def _plan(options: ClaimsOptions) -> None:
    """List the power and cost of the designs of claims."""
    if extra := sorted(options.model_fields_set - {"claim"}):
        raise UserError(f"claims plan: {extra[0]} applies only to verdicts", "claims plan claim=<name>")
    from sextant.lifecycle import claims as life
    from sextant.lifecycle.claim_files import read_claims
    from sextant.lifecycle.claim_plan import plan_claims

    claims = read_claims(options.claim)
    plans = list(plan_claims(claims, life.Tables(life.stored_results())))
    if not plans:
        raise UserError(f"claim={options.claim} rests on counts: it has no design and needs no replicates")
    table = Table("claim", "replicates", "spread", "detectable", "power", "needed", "runs", "core-hours")
    for plan in plans:
        each = f" x {plan.seeds} seeds" * (plan.seeds > 1)
        table.add_row(
            *(plan.name, f"{plan.number} {plan.design.replicate}{each}", f"{plan.spread:.3g}"),
            *(f"{plan.detectable:.3g} {plan.claim.unit}", f"{plan.power:.2f} at {plan.design.effect:g}"),
            *(f"{plan.needed:g}", str(plan.runs), f"{plan.core_hours:.1f}"),
        )
    console.print(table)
    hours = sum(plan.core_hours for plan in plans)
    console.print(f"{hours:.0f} core-hours in total; the power of each comparison is at the effect next to it")
    for plan in plans if options.claim != "all" else []:
        said = f"fixed {plan.claim.date}; at least {plan.claim.matters:g} {plan.claim.unit}: {plan.claim.reason}"
        console.print(said, markup=False)
        told = plan.design.command or command("train", "-m", *plan.arguments)
        console.print(told, markup=False, soft_wrap=True)
