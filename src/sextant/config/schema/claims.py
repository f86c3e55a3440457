"""Claims of the thesis, each decided from the results of sweeps."""

from typing import Literal, Self

from pydantic import Field, model_validator

from sextant.config.schema.parts import Node


class ClaimPart(Node):
    """Comparisons that a claim rests on: every row of a stored table with one of these names.

    Attributes:
        sweep: the sweep that measures them; empty for figures of another command, in ``recorded`` tables only.
        stored: folder of its stored report, below ``docs``.
        table: table of the report, without ``.csv``.
        names: names of contrasts; of arms in ``cells`` and ``cost``; of rows in ``recorded``.
        against: what an arm is compared with: a number in ``cells``, another arm in ``cost``.
        quantity: column of ``cost``.
        direction: whether the claim states that the difference goes up or down.
        expects: what the claim states: better, as good (not worse), or the same (within what matters).
        matters: smallest effect that matters, if it differs from the claim's.
        unit: unit of the effect, if it differs from the claim's.
        beside: whether it is shown but does not count.
        note: note to be read with it.
    """

    sweep: str = ""
    stored: str
    table: Literal["contrasts", "pooled", "cells", "cost", "recorded"] = "contrasts"
    names: list[str] = Field(min_length=1)
    settings: list[str] = Field(default=["-"], min_length=1)
    conditions: list[str] = Field(default=["test"], min_length=1)
    against: float | str = ""
    quantity: str = ""
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
        if self.table == "cost" and not self.quantity:
            raise ValueError("table=cost needs quantity, a column of cost.csv")
        if self.table != "recorded" and not self.sweep:
            raise ValueError(f"table={self.table} needs the sweep that it is of")
        return self


class Claim(Node):
    """One claim: its statement, what decides it, and the smallest effect that matters.

    Attributes:
        sentence: the claim in plain words.
        published: what the thesis or its papers reported.
        page: page of ``docs`` that discusses it.
        unit: unit of the effect.
        matters: smallest effect that matters.
        reason: why this is the smallest effect that matters.
        runs: how the stored results were measured: seeds, hardware, time.
        command: command that measures it, if the sweeps of its parts are not enough.
        parts: parts, all of which must hold.
    """

    chapter: int = Field(ge=2, le=7)
    sentence: str = Field(min_length=10)
    published: str
    page: str
    unit: str
    matters: float = Field(ge=0)
    reason: str = Field(min_length=10)
    runs: str
    command: str = ""
    parts: list[ClaimPart] = Field(min_length=1)

    @model_validator(mode="after")
    def _something_counts(self) -> Self:
        if all(part.beside for part in self.parts):
            raise ValueError("every part stands beside the claim, so nothing decides it")
        return self
