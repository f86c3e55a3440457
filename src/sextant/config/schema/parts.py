"""Base classes and types of all config nodes."""

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, TypeVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    SerializerFunctionWrapHandler,
    model_serializer,
)
from pydantic_core import CoreSchema
from pydantic_core.core_schema import tagged_union_schema

#: tag of parts for which Sextant has no model
CUSTOM = "custom"


class Node(BaseModel):
    """A config node: exact types, no unknown keys, immutable."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
    #: keys that were added later; a null is omitted, so that earlier configs keep their digest
    later: ClassVar[tuple[str, ...]] = ()

    @model_serializer(mode="wrap")
    def _as_before(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        values: dict[str, Any] = handler(self)
        return {key: value for key, value in values.items() if value is not None or key not in self.later}


class Part(Node):
    """A config node that builds an object from an import path."""

    target: str = Field(alias="_target_")


class CustomPart(Part):
    """A part from outside Sextant."""

    model_config = ConfigDict(extra="allow")


class ChosenByTarget:
    """Marks a union of parts from which the ``_target_`` of a node chooses one.

    A base class in the union stands for all of its subclasses. See :data:`Choice`.
    """

    def __get_pydantic_core_schema__(self, union: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        parts = {_target_of(part): handler.generate_schema(part) for kind in get_args(union) for part in parts_of(kind)}

        def tag(value: Any) -> str:
            target = str(value.get("_target_") if isinstance(value, dict) else getattr(value, "target", None))
            return target if target in parts else CUSTOM

        return tagged_union_schema(parts, discriminator=tag)


CHOSEN_BY_TARGET = ChosenByTarget()
Kind = TypeVar("Kind", bound=Part)
#: a part of this kind, or the user's own part: ``Choice[Backbone]``
Choice = Annotated[Kind | CustomPart, CHOSEN_BY_TARGET]


def parts_of(kind: type[Part]) -> list[type[Part]]:
    """The parts of a kind: its subclasses that name an import path, or the class itself if it names one."""
    if kind is CustomPart or get_args(kind.model_fields["target"].annotation):
        return [kind]
    return [part for each in kind.__subclasses__() for part in parts_of(each)]


def _target_of(part: type[Part]) -> str:
    """The import path that a part's model names."""
    return CUSTOM if part is CustomPart else str(get_args(part.model_fields["target"].annotation)[0])


def targets_of(union: Any) -> list[str]:
    """The import paths that a union of parts chooses from, but the user's own."""
    found = [_target_of(part) for kind in get_args(union) or (union,) for part in parts_of(kind)]
    return [path for path in found if path != CUSTOM]


def known_targets() -> frozenset[str]:
    """The import paths for which Sextant has a schema."""
    parts, found = [Part], set[str]()
    while parts:
        part = parts.pop()
        parts += part.__subclasses__()
        annotation = part.model_fields["target"].annotation
        found |= {path for each in (annotation, *get_args(annotation)) for path in get_args(each) if type(path) is str}
    return frozenset(found)


def named_targets(node: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Every import path within plain values at any depth, with its dotted key."""
    inner = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list | tuple) else ()
    for name, value in inner:
        if name == "_target_":
            yield f"{prefix}{name}", str(value)
        yield from named_targets(value, f"{prefix}{name}.")


def distinct(values: list[float]) -> list[float]:
    """Return ``values`` if they are all different.

    Raises:
        ValueError: two values are equal.
    """
    if len({f"{value:g}" for value in values}) < len(values):
        raise ValueError(f"values must differ, got {values}")
    return values
