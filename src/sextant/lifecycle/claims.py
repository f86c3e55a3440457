"""Deciding the claims of the thesis from stored results, or from sweeps that are run for it."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from sextant.atomic_files import write_atomically
from sextant.composing.config_files import read_config_file
from sextant.config.schema.claims import Claim, ClaimPart
from sextant.errors import UserError, command, one_line
from sextant.lifecycle.claim_files import Claims
from sextant.lifecycle.run_reporter import SILENT_RUN, RunReporter
from sextant.reports.claim_evidence import BASELINES, REPLICATE_TABLE, SEEDS, evidence, read_table
from sextant.reports.claims_board import Comparison, DecidedClaim, board, comparison_rows, picture
from sextant.runs.outputs_folder import conf_dir
from sextant.tables import TextTable, counted

Preset = Literal["quick", "full"]

#: folder of figures recorded from pages, which have no dates of their own
CLAIMS = "claims"
#: digests of the stored results that the claims rest on, in the format of sha256sum
DIGESTS = "claims/results.sha256"
#: when the first run of each of these results was begun, in UTC
BEGUN = "claims/begun.csv"
#: folder of the stored tables of ``preset=quick``, by sweep
QUICK = "claims/quick"


@dataclass(frozen=True)
class Tables:
    """Locations of the tables of the sweeps.

    Attributes:
        stored: folder of the stored reports.
        reports: report folders of the sweeps of a preset; without a preset all tables are stored ones.
        left_out: sweeps that the preset lacks, with the reason.
        preset: the preset, None for the stored results.
    """

    stored: Path
    reports: Mapping[str, Path] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    preset: Preset | None = None

    def file(self, part: ClaimPart) -> Path:
        """The file of the table that a part rests on."""
        if self.preset is None or part.table == "recorded":
            return self.stored / part.stored / f"{part.table}.csv"
        return self.reports[part.sweep] / f"{part.table}.csv"


def stored_results() -> Path:
    """The folder of stored reports: ``results`` of the checkout."""
    folder = conf_dir().parent / "results"
    if not (folder / DIGESTS).is_file():
        raise UserError("the stored results are not there", "They come with the repository, in results.")
    return folder


def quick_tables(claims: Claims, stored: Path) -> Tables:
    """The stored tables of ``preset=quick``; sweeps without stored tables are left out."""
    sweeps = dict.fromkeys(part.sweep for claim in claims.values() for part in claim.parts if part.sweep)
    reports = {sweep: stored / QUICK / sweep for sweep in sweeps if (stored / QUICK / sweep).is_dir()}
    return Tables(stored, reports, {sweep: "not stored" for sweep in sweeps if sweep not in reports}, "quick")


def decide_claims(claims: Claims, tables: Tables) -> list[DecidedClaim]:
    """Decide every claim whose sweeps are all available.

    Raises:
        UserError: a table lacks a row that a claim names.
    """
    return [
        _decided(name, claim, tables)
        for name, claim in claims.items()
        if not any(part.sweep in tables.left_out for part in _measured(claim, tables.preset))
    ]


def decide_quick_claims(claims: Claims, stored: Path) -> list[DecidedClaim]:
    """Decide the claims whose tables under ``preset=quick`` are stored.

    Raises:
        UserError: as :func:`decide_claims`.
    """
    measured = {name: claim for name, claim in claims.items() if any(part.sweep for part in _measured(claim, "quick"))}
    return decide_claims(measured, quick_tables(claims, stored))


def write_board(
    claims: Claims, tables: Tables, command: str, output: Path | None = None, html: Path | None = None
) -> list[Path]:
    """Write the board of claims with its pictures; the same results give the same bytes.

    Args:
        claims: claims to decide.
        tables: tables that decide them.
        command: command that the board names as its origin.
        output: folder for ``claims.md`` and its pictures.
        html: folder for ``claims.html``, a self-contained page.

    Returns:
        The pages that were written.

    Raises:
        UserError: a table lacks a row that a claim names.
    """
    decided = decide_claims(claims, tables)
    there = {claim.name for claim in decided}
    left_out = {
        name: "; ".join(dict.fromkeys(tables.left_out[p.sweep] for p in claim.parts if p.sweep in tables.left_out))
        for name, claim in claims.items()
        if name not in there
    }
    again = [] if tables.preset is not None else decide_quick_claims(claims, tables.stored)
    text, written = board(decided, "claims", command, left_out, again), {}
    if output is not None:
        for claim in decided:
            _write(output / "claims" / f"{claim.name}.svg", picture(claim))
        _write(output / "claims" / "comparisons.csv", comparison_rows(decided).csv())
        written[output / "claims.md"] = text
    if html is not None:
        from sextant.reports.page.claims_page import claims_page

        written[html / "claims.html"] = claims_page(decided, text)
    for path, page in written.items():
        _write(path, page)
    return list(written)


def check_digests(claims: Claims, stored: Path) -> None:
    """Check the stored files that claims rest on against their digests.

    Raises:
        UserError: a file is missing or has changed since its digest was written.
    """
    known = _known_digests(stored)
    for name, digest in digests(claims, stored).items():
        if known.get(name) != digest:
            raise UserError(
                f"{stored / name} does not match its digest in {stored / DIGESTS}",
                f"Restore it (git checkout {stored / name}), or if its sweep ran anew: sextant claims digests=renew",
            )


def digests(claims: Claims, stored: Path) -> dict[str, str]:
    """SHA-256 digests of the stored files that claims rest on, by path."""
    tables = Tables(stored)
    files = {tables.file(part) for claim in claims.values() for part in claim.parts}
    beside = (BASELINES, SEEDS, REPLICATE_TABLE)
    files |= {path for file in files for name in beside if (path := file.with_name(name)).is_file()}
    files |= {path for report in quick_tables(claims, stored).reports.values() for path in report.glob("*.csv")}
    there = sorted(path for path in files if path.is_file())  # the others have not been run yet
    return {p.relative_to(stored).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in there}


def renew_digests(claims: Claims, stored: Path) -> None:
    """Write the digests of the files in their current state, after checking that they decide the claims.

    Raises:
        UserError: a file that has a digest is missing, or a table lacks a row that a claim names.
    """
    _known_digests(stored)
    decide_claims(claims, Tables(stored))
    decide_quick_claims(claims, stored)
    found = digests(claims, stored)
    dates = TextTable(["file", "begun", "source"], _renewed_dates(stored, found))
    _write(stored / BEGUN, dates.csv())
    _write(stored / DIGESTS, "".join(f"{digest}  {name}\n" for name, digest in found.items()))


def _renewed_dates(stored: Path, found: Mapping[str, str]) -> list[list[str]]:
    """When the first run of each stored table was begun, with the source of the date, for a file.

    The source is ``dates.csv`` of a sweep's report. Unchanged tables keep their stored date; runs without a date
    explore a claim.
    """
    known, before = _known_digests(stored), _stored_dates(stored)
    rows = []
    for name, digest in found.items():
        of_report = (stored / name).with_name("dates.csv")
        if known.get(name) == digest and name in before:
            rows.append([name, *before[name]])
        elif of_report.is_file():
            rows.append([name, read_table(of_report)[0]["first_run"], of_report.relative_to(stored).as_posix()])
    return rows


def _stored_dates(stored: Path) -> dict[str, tuple[str, str]]:
    """When the first run of each stored table was begun, with the source of the date."""
    rows = read_table(stored / BEGUN) if (stored / BEGUN).is_file() else []
    return {row["file"]: (row["begun"], row["source"]) for row in rows}


def _begun(claim: Claim, tables: Tables) -> str:
    """When the first of the runs that decide a claim was begun; empty if the table of any of them has no date."""
    if tables.preset is not None:  # a preset also uses existing runs
        return ""
    known = _stored_dates(tables.stored)
    counting = [part for part in claim.parts if _dated(part) and not part.beside]
    files = [tables.file(part).relative_to(tables.stored).as_posix() for part in counting]
    dates = [known.get(file, ("", ""))[0] for file in files]
    return min(dates, key=datetime.fromisoformat) if dates and all(dates) else ""


def _dated(part: ClaimPart) -> bool:
    """Whether a part rests on runs with dates of their own, not on figures recorded from pages."""
    return bool(part.sweep) or part.stored != CLAIMS


def _known_digests(stored: Path) -> dict[str, str]:
    """The stored digests by file; raises a ``UserError`` if one of the files is missing."""
    path = stored / DIGESTS
    try:
        lines = [line.partition("  ") for line in path.read_text("utf-8").splitlines()]
    except UnicodeDecodeError:
        raise UserError(f"{path} is not text in the format of sha256sum", f"Restore it: git checkout {path}") from None
    lost = sorted(name for _, _, name in lines if not (stored / name).is_file())
    if lost:
        raise UserError(f"{stored / lost[0]} is not there", f"Restore it: git checkout {stored / lost[0]}")
    return {name: digest for digest, _, name in lines}


def run_claims(
    claims: Claims,
    preset: Preset,
    stored: Path,
    overrides: Sequence[str] = (),
    reporter: RunReporter = SILENT_RUN,
    runs: RunReporter = SILENT_RUN,
) -> Tables:
    """Run the missing runs of the sweeps that claims rest on, and write the sweeps' reports.

    The number of missing runs is announced first. A sweep that has no form for this preset, or whose data are missing,
    is left out and the reason is recorded.

    Args:
        claims: claims to decide.
        preset: size of the sweeps.
        stored: folder of the stored results.
        overrides: overrides for all sweeps, such as ``launcher=joblib``.
        reporter: listens to the sweeps.
        runs: listens to the runs, in the processes that compute them.
    """
    from sextant.lifecycle.results import sweep_results
    from sextant.lifecycle.sweep import dry_run, run_sweep
    from sextant.reports.sweep_report import write_report

    wanted: dict[str, list[str]] = {}
    missing: dict[str, int] = {}
    reports: dict[str, Path] = {}
    left_out: dict[str, str] = {}
    parts = [part for claim in claims.values() for part in _measured(claim, preset)]
    for sweep in dict.fromkeys(part.sweep for part in parts if part.sweep):
        try:
            arguments = sweep_arguments(sweep, [part for part in parts if part.sweep == sweep], preset)
            wanted[sweep] = [*arguments, *overrides]
            missing[sweep] = len(dry_run(wanted[sweep])[0])
        except UserError as error:
            left_out[sweep] = one_line(str(error))
    told = ", ".join(f"{sweep} {runs}" for sweep, runs in missing.items())
    reporter.say(f"{counted(len(missing), 'sweep')}, {counted(sum(missing.values()), 'run')} missing: {told or 'none'}")
    for sweep in missing:
        try:
            directory = run_sweep(wanted[sweep], reporter, runs=runs).directory
            write_report(sweep_results(directory, directory.parents[1]))
        except UserError as error:
            left_out[sweep] = one_line(str(error))
        else:
            reports[sweep] = directory / "report"
    return Tables(stored, reports, left_out, preset)


def sweep_arguments(sweep: str, parts: Sequence[ClaimPart], preset: Preset) -> list[str]:
    """The overrides of a sweep under a preset; ``quick`` leaves out the arms and settings that no part needs.

    Raises:
        UserError: the sweep does not exist, or it has no quick form.
    """
    definition = _definition(sweep)
    if preset == "full":
        return [f"sweep={sweep}"]
    if "quick" not in definition:
        raise UserError(f"sweep={sweep} has no quick form that could decide its claim", "preset=full runs it.")
    return [f"sweep={sweep}", *definition["quick"], *_unneeded(definition, parts), *_confined(definition, parts)]


def design_arguments(claim: Claim) -> list[str]:
    """The overrides that run the design of a claim: its sweep without the arms that no part needs, and its settings.

    Raises:
        UserError: the sweep does not exist.
    """
    design = claim.design
    assert design is not None
    counting = [part for part in claim.parts if part.sweep and not part.beside]
    sweep = design.sweep or next((part.sweep for part in counting), "")
    if not sweep:
        return list(design.overrides)
    parts = [part for part in counting if part.sweep == sweep]
    return [f"sweep={sweep}", *_unneeded(_definition(sweep), parts, design.arms), *design.overrides]


def _unneeded(definition: Mapping[str, Any], parts: Sequence[ClaimPart], kept: Sequence[str] = ()) -> list[str]:
    """Overrides that leave out the arms of a sweep that neither parts nor ``kept`` need, and the contrasts of these."""
    arms, contrasts = definition.get("arms", {}), definition.get("contrasts", {})
    wanted = {name for part in parts for name in part.names} | {definition.get("noise_floor")}
    used = {contrasts[name][side] for name in contrasts if name in wanted for side in ("treatment", "control")}
    used |= wanted | {str(part.against) for part in parts} | set(kept)
    dropped = [f"~sweep.contrasts.{name}" for name in contrasts if name not in wanted]
    return dropped + [f"~sweep.arms.{name}" for name in arms if name not in used]


def _confined(definition: Mapping[str, Any], parts: Sequence[ClaimPart]) -> list[str]:
    """Overrides that confine the arms of contrasts to those values of a sweep's only factor in which a part needs them.

    A sweep of several factors is left as it is.
    """
    factors = list(definition.get("factors", {}).values())
    settings: dict[str, set[str]] = {}
    for part in parts:
        for name in part.names:
            for arm in definition.get("contrasts", {}).get(name, {}).values():
                settings.setdefault(arm, set()).update(part.settings)
    values = {str(value) for value in factors[0]} if len(factors) == 1 else set()
    return [
        f"++sweep.arms.{arm}.only=[{','.join(sorted(wanted))}]" for arm, wanted in settings.items() if wanted < values
    ]


def _decided(name: str, claim: Claim, tables: Tables) -> DecidedClaim:
    comparisons, undated = list[Comparison](), False
    for part in _measured(claim, tables.preset):
        if part.sweep:
            _check_names(name, part)
        arms = _arms_of(part) if part.table == "contrasts" else None
        found = list(evidence(tables.file(part), part, arms, tables.stored / part.stored / BASELINES))
        if not _dated(part) and not part.beside:  # what is exact needs no date
            undated = undated or not all(each.estimate.counted for each in found)
        unit = part.unit or claim.unit
        most = 100.0 if unit.startswith("points") else math.inf  # shares
        matters = claim.matters if part.matters is None else part.matters
        short = tables.preset is None and part.stored.startswith(f"{QUICK}/")
        comparisons += [
            Comparison(
                each.label,
                replace(each.estimate, cut_short=short, most=most),
                part.expects,
                matters,
                unit,
                part.beside,
                part.note,
            )
            for each in found
        ]
    sweeps = dict.fromkeys(command("train", "-m", f"sweep={part.sweep}") for part in claim.parts if part.sweep)
    commands = [claim.command] if claim.command else list(sweeps)
    return DecidedClaim(
        name=name,
        stated=claim,
        begun="" if undated else _begun(claim, tables),
        runs=claim.runs if tables.preset is None else f"sextant claims preset={tables.preset}",
        commands=commands,
        comparisons=comparisons,
    )


def _measured(claim: Claim, preset: Preset | None) -> list[ClaimPart]:
    """The parts of a claim that a preset measures; ``quick`` measures only those that count."""
    return [part for part in claim.parts if not (preset == "quick" and part.beside)]


def _arms_of(part: ClaimPart) -> dict[str, list[str]]:
    """The two arms of each contrast that a part names."""
    contrasts = _definition(part.sweep)["contrasts"]
    return {name: [contrasts[name]["treatment"], contrasts[name]["control"]] for name in part.names}


def _check_names(claim: str, part: ClaimPart) -> None:
    definition = _definition(part.sweep)
    kind = "contrasts" if part.table in ("contrasts", "differences", "pooled") else "arms"
    there = definition.get(kind, {})
    wanted = [*part.names, *([str(part.against)] if part.table == "cost" else [])]
    for name in wanted:
        if name not in there:
            raise UserError(
                f"claim {claim} needs {kind[:-1]} {name}, which sweep={part.sweep} lacks",
                f"Its {kind}: {', '.join(there) or 'none'}.",
            )


def _definition(sweep: str) -> Mapping[str, Any]:
    path = conf_dir() / "sweep" / f"{sweep}.yaml"
    if not path.is_file():
        raise UserError(f"there is no sweep {sweep}", f"Sweeps are the files of {path.parent}.")
    found: Mapping[str, Any] = read_config_file(path)["sweep"]
    return found


def _write(path: Path, text: str) -> None:
    write_atomically(path, lambda file: file.write(text.encode("utf-8")))
