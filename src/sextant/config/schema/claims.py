"""Claims of the thesis, each of which is decided from what sweeps found."""

from typing import Literal, Self

from pydantic import Field, model_validator

from sextant.config.schema.parts import Node


class ClaimPart(Node):
    """Comparisons that a claim rests on: every row of a stored table with one of these names.

    Attributes:
        sweep: that measures them; empty for figures of another command, which only ``recorded`` tables hold.
        stored: folder of its stored report, below ``docs``.
        table: of the report, without ``.csv``.
        names: of contrasts; of arms in ``cells`` and ``cost``; of rows in ``recorded``.
        against: in ``cells`` the number that an arm is compared with; in ``cost`` the arm.
        quantity: column of ``cost``.
        direction: whether the claim says that the difference goes up or down.
        expects: what the claim says of it: better, as good (not worse) or the same (within what matters).
        matters: smallest effect that matters, if it is not that of the claim.
        unit: of the effect, if it is not that of the claim.
        beside: shown, and not counted.
        note: to be read with it.
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
    """One claim: what it says, what would decide it, and why that much.

    Attributes:
        sentence: in plain words.
        published: what the thesis or its papers reported.
        page: of ``docs`` that discusses it.
        unit: of the effect.
        matters: smallest effect that matters.
        reason: why that much.
        runs: what measured the stored results: seeds, hardware, time.
        command: that measures it, if it is not that of the sweeps of its parts alone.
        parts: all of which have to hold.
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
