"""``sextant doctor``: check that this machine meets the conditions on which results rest."""

import math
import os
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from sextant.console.console import console
from sextant.errors import UserError

if TYPE_CHECKING:
    from sextant.chapters.calibration.metrics.doctor import CrossTalk, Finding

USAGE = "sextant doctor [calibration]"


def main(arguments: Sequence[str]) -> None:
    """Check this machine, or run the checks of one chapter; exit status 1 if one fails."""
    if any(argument in ("-h", "--help") for argument in arguments):
        print(
            f"{USAGE}\n\n  no argument  check versions, data, runs and their store, threads, disk and GPU"
            "\n  calibration  check the geometry, losses and crops of single-image calibration; takes seconds"
        )
    elif not arguments:
        _machine()
    elif list(arguments) == ["calibration"]:
        _calibration()
    else:
        raise UserError(f"doctor {' '.join(arguments)}: not understood".replace("  ", " "), USAGE)


def _machine() -> None:
    from sextant.runs.machine import machine_facts
    from sextant.runs.outputs_folder import default_outputs

    table, bad = Table(box=None, show_header=False), 0
    shown = {"good": "[green]good[/]", "note": "[yellow]note[/]", "bad": "[red]BAD[/]"}
    before = ""
    for fact in machine_facts(default_outputs(), os.environ.get("SEXTANT_DATA")):
        topic = fact.topic if fact.topic != before else ""
        table.add_row(f"[bold]{topic}[/]", escape(fact.name), escape(fact.found), shown[fact.state])
        before, bad = fact.topic, bad + (fact.state == "bad")
    console.print(table)
    if bad:
        raise SystemExit(1)


def _calibration() -> None:
    from sextant.chapters.calibration.data.crops import crop_panoramas
    from sextant.chapters.calibration.metrics.doctor import examine

    began = time.monotonic()
    findings, cross_talk = examine(crop_panoramas)
    console.print(_findings_table(findings))
    console.print(_cross_talk_table(cross_talk))
    failed = sum(not finding.passed for finding in findings)
    console.print(f"{len(findings) - failed} passed, {failed} failed, in {time.monotonic() - began:.1f} s")
    if failed:
        raise SystemExit(1)


def _findings_table(findings: "Sequence[Finding]") -> Table:
    table = Table(title="calibration", title_justify="left", title_style="bold")
    for name, side in (("check", "left"), ("figure", "left"), ("measured", "right"), ("limit", "right"), ("", "left")):
        table.add_column(name, justify=side)  # type: ignore[arg-type]
    before = None
    for finding in findings:
        state = "[green]pass[/]" if finding.passed else "[red]FAIL[/]"
        name = finding.check if finding.check != before else ""
        table.add_row(escape(name), escape(finding.figure), f"{finding.value:.3g}", _limit(finding), state)
        before = finding.check
    return table


def _limit(finding: "Finding") -> str:
    if math.isinf(finding.high):
        return f">= {finding.low:g}"
    return f"<= {finding.high:g}" if finding.low == 0 else f"{finding.low:g} to {finding.high:g}"


def _cross_talk_table(rows: "Sequence[CrossTalk]") -> Table:
    table = Table(
        title="cross-talk: one number wrong, errors of the others at the minimum of the joint loss (disentangled: 0)",
        title_justify="left",
        title_style="bold",
    )
    headings = ("wrong", "bearing, deg", "then", "rho", "roll, deg", "vfov, deg", "k1_hat", "disentangled")
    for i, name in enumerate(headings):
        table.add_column(name, justify="left" if i == 0 else "right")
    for row in rows:
        rho, roll, vfov, k1_hat = row.joint
        biases = (rho, math.degrees(roll), math.degrees(vfov), k1_hat)
        shown = ["" if bias == 0 else f"{bias:+.{digits}f}" for bias, digits in zip(biases, (3, 2, 1, 3), strict=True)]
        largest = f"{max(map(abs, row.disentangled)):.0e}"
        table.add_row(row.wrong, f"{row.before_deg:.2f}", f"{row.after_deg:.2f}", *shown, largest)
    return table
