"""What all config nodes have in common."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Discriminator, Field


class Node(BaseModel):
    """A config node: exact types, no unknown keys, immutable."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Part(Node):
    """A config node that builds an object from an import path."""

    target: str = Field(alias="_target_")


class CustomPart(Part):
    """A part that Sextant does not know."""

    model_config = ConfigDict(extra="allow")


def choose_part(*known: type[Part]) -> Discriminator:
    """Chooses the model of a part by its ``_target_``; what is not ``known`` is a :class:`CustomPart`."""
    targets = {part.model_fields["target"].annotation.__args__[0] for part in known}  # type: ignore[union-attr]

    def tag(value: Any) -> str:
        target = str(value.get("_target_") if isinstance(value, dict) else getattr(value, "target", None))
        return target if target in targets else "custom"

    return Discriminator(tag)


def distinct(values: list[float]) -> list[float]:
    """``values``, which must differ.

    Raises:
        ValueError: two are equal.
    """
    if len({f"{value:g}" for value in values}) < len(values):
        raise ValueError(f"values must differ, got {values}")
    return values


Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, lt=1)]
Seed = Annotated[int, Field(ge=0, lt=2**31)]
Count = Annotated[int, Field(ge=1)]
