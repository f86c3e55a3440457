"""Claims of the thesis, each decided from the results of sweeps."""

from datetime import datetime
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from sextant.config.schema.parts import Node


def _moment(text: str) -> str:
    """A date with its time and zone, as Git writes it."""
    try:
        zoned = datetime.fromisoformat(text).tzinfo is not None
    except ValueError:
        zoned = False
    if not zoned:
        raise ValueError(f"date={text} must be a time with its zone, such as 2026-11-28T17:00:00+00:00")
    return text


class ClaimPart(Node):
    """Comparisons that a claim rests on: every row of a stored table with one of these names.

    Attributes:
        sweep: the sweep that measures them; empty for figures of another command, in ``recorded`` tables only.
        stored: folder of its stored report, below ``results``; without one the part has not been run yet.
        table: table of the report, without ``.csv``.
        names: names of contrasts; of arms in ``cells`` and ``cost``; of rows in ``recorded``.
        against: what an arm is compared with: a number in ``cells``, another arm in ``cost``.
        quantity: column of ``cost``; metric of ``differences``.
        learnt: conditions in which both arms of a contrast must be better than the constant of ``baselines.csv``, a
            table beside ``table``; those of ``conditions`` always must be, if that table has them.
        direction: whether the claim states that the difference goes up or down.
        expects: what the claim states: better, as good (not worse), or the same (within what matters).
        matters: smallest effect that matters, if it differs from the claim's.
        unit: unit of the effect, if it differs from the claim's.
        beside: whether it is shown without counting towards the verdict.
        note: note shown with it.
    """

    sweep: str = ""
    stored: str
    table: Literal["contrasts", "differences", "pooled", "cells", "cost", "recorded"] = "contrasts"
    names: list[str] = Field(min_length=1)
    settings: list[str] = Field(default=["-"], min_length=1)
    conditions: list[str] = Field(default=["test"], min_length=1)
    against: float | str = ""
    quantity: str = ""
    learnt: list[str] = Field(default=[])
    direction: Literal["up", "down"] = "up"
    expects: Literal["better", "as_good", "same"] = "better"
    matters: float | None = Field(default=None, ge=0)
    unit: str = ""
    beside: bool = False
    note: str = ""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        kinds = {"cells": float, "cost": str}
        if self.table in kinds and not (isinstance(self.against, kinds[self.table]) and self.against != ""):
            raise ValueError(f"table={self.table} needs against: a number for cells, an arm for cost")
        if self.table in ("cost", "differences") and not self.quantity:
            raise ValueError(f"table={self.table} needs quantity, a column of cost.csv or a metric of differences.csv")
        if self.table != "recorded" and not self.sweep:
            raise ValueError(f"table={self.table} needs the sweep that measured it")
        return self


class Design(Node):
    """The runs that would decide a claim anew, planned before any of them.

    Attributes:
        replicate: unit of replication: worlds (layouts, or sources of real data), or seeds where there is one data set.
        sweep: the sweep to run; empty for that of the first part that counts, or for no stored sweep at all.
        arms: arms of the sweep that run; empty for those that the parts need.
        overrides: overrides of the sweep: worlds, seeds, lengths.
        command: the command that runs it, for figures of no sweep, in place of ``overrides``.
        replicates: number of replicates of ``command``.
        core_hours: of one run, or of one replicate of ``command``.
        effect: the true effect, in the claim's unit, at which the power is computed.
        spread: standard deviation of one replicate's difference; None for that of the stored pairs, see
            :func:`~sextant.lifecycle.claim_plan.plan_claim`.
    """

    replicate: Literal["worlds", "seeds"] = "worlds"
    sweep: str = ""
    arms: list[str] = Field(default=[])
    overrides: list[str] = Field(default=[])
    command: str = ""
    replicates: int = Field(0, ge=0)
    core_hours: float = Field(gt=0)
    effect: float
    spread: float | None = Field(None, ge=0)

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if bool(self.overrides) == bool(self.command) or bool(self.command) != (self.replicates > 1):
            raise ValueError("a design needs overrides of a sweep, or a command with its number of replicates")
        return self


class Claim(Node):
    """One claim: its statement, what decides it, and the smallest effect that matters.

    Attributes:
        date: when the claim was fixed: its sentence, its parts and the smallest effect that matters. Runs begun earlier
            explore it, later ones confirm or refute it.
        sentence: the claim in plain words.
        published: what the thesis or its papers reported.
        page: page of ``results`` that discusses it.
        unit: unit of the effect.
        matters: smallest effect that matters.
        requires: what is required, in words; by default a gain, loss or difference of ``matters`` in ``unit``.
        reason: why this is the smallest effect that matters.
        not_covered: what the verdict does not cover.
        design: the runs that would decide it anew; None for counts, which need no replicates.
        runs: how the stored results were measured: seeds, hardware, time.
        command: command that measures it, if the sweeps of its parts are not enough.
        parts: parts, all of which must hold.
    """

    date: Annotated[str, AfterValidator(_moment)]
    chapter: int = Field(ge=2, le=7)
    sentence: str = Field(min_length=10)
    published: str
    page: str
    unit: str
    matters: float = Field(ge=0)
    requires: str = ""
    reason: str = Field(min_length=10)
    not_covered: str = Field(min_length=10)
    design: Design | None = None
    runs: str
    command: str = ""
    parts: list[ClaimPart] = Field(min_length=1)

    @model_validator(mode="after")
    def _something_counts(self) -> Self:
        if all(part.beside for part in self.parts):
            raise ValueError("every part has beside=true, so nothing decides the claim")
        return self
