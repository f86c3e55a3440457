"""``key=value`` arguments of the commands that are not composed from a config."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Self, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    ValidationError,
    ValidationInfo,
    field_validator,
)
from pydantic.fields import FieldInfo

from sextant.config import nearest
from sextant.errors import UserError


def _split(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    return [word.strip() for word in value.strip("()[] ").split(",") if word.strip()]


#: values separated by commas, in brackets or not
SPLIT = BeforeValidator(_split)
UserPath = Annotated[Path, AfterValidator(Path.expanduser)]
#: how a value of a type is written, and what messages call it
WRITTEN = {int: ("[0-9]+", "a whole number"), float: (r"[^_\s]+", "a number"), bool: ("true|false", "true or false")}


class Options(BaseModel):
    """What a user may choose of a command.

    A field is a key: its docstring is what ``--help`` says, its first example what a mistake is answered with. What is
    allowed follows from its type and bounds, or is its title.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)

    @classmethod
    def fields(cls) -> dict[str, FieldInfo]:
        """The fields by their keys."""
        return {field.alias or name: field for name, field in cls.model_fields.items()}

    @classmethod
    def meanings(cls) -> dict[str, str]:
        """The keys and what they mean."""
        return {key: " ".join(str(field.description).split()) for key, field in cls.fields().items()}

    @classmethod
    def of(cls, given: Mapping[str, str], usage: str | None = None) -> Self:
        """Read the values of these keys; other keys are someone else's.

        Raises:
            UserError: a key is missing, or a value is not one of those allowed.
        """
        fields = cls.fields()
        own = {key: text for key, text in given.items() if key in fields and (text or not fields[key].is_required())}
        try:
            return cls.model_validate(own)
        except ValidationError as error:
            key = str(error.errors()[0]["loc"][0])
        field = fields[key]
        if key not in own:
            raise UserError(f"{key}= is missing: {cls.meanings()[key]}", usage)
        example = f"For example {key}={field.examples[0]}" if field.examples else None
        raise UserError(f"{key}={given[key]} must be {field.title or _allowed(field)}", example)

    @classmethod
    def parse(cls, arguments: Sequence[str], usage: str) -> Self:
        """Read a command line that has no other keys.

        Raises:
            UserError, SystemExit: as :func:`parse_arguments` and :meth:`of`.
        """
        return cls.of(parse_arguments(arguments, cls.meanings(), usage), usage)

    @field_validator("*", mode="before")
    @classmethod
    def _exactly(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse what Pydantic would take for a number or truth value too, such as 1_000 and yes."""
        written = WRITTEN.get(_types(cls.model_fields[str(info.field_name)])[0])
        if isinstance(value, str) and written and not re.fullmatch(written[0], value, re.ASCII):
            raise ValueError(written[1])
        return value


def _types(field: FieldInfo) -> list[Any]:
    """What a value may be of, or, of a ``Literal``, what it may be; None left out."""
    union = get_origin(field.annotation) in (Union, UnionType)
    members = [each for each in (get_args(field.annotation) if union else [field.annotation]) if each is not NoneType]
    return [
        inner for each in members for inner in (get_args(each) if get_origin(each) in (Literal, Annotated) else [each])
    ]


def _allowed(field: FieldInfo) -> str:
    """What values a field takes, by its type and bounds."""
    kind, *others = _types(field)
    if isinstance(kind, str):
        return f"one of {', '.join([kind, *others])}"
    said, bounds = WRITTEN[kind][1], dict[str, float]()
    for each in field.metadata:
        bounds |= {name: getattr(each, name) for name in ("gt", "ge", "le") if hasattr(each, name)}
    if "gt" in bounds:
        return f"{said} above {bounds['gt']}"
    if "ge" in bounds:
        return f"{said} from {bounds['ge']} {f'to {limit}' if (limit := bounds.get('le')) else 'up'}"
    return said


def parse_arguments(arguments: Sequence[str], known: Mapping[str, str], usage: str) -> dict[str, str]:
    """Read ``key=value`` arguments.

    Args:
        arguments: of the command line.
        known: legal keys and what they mean.
        usage: an example, printed by ``--help``.

    Raises:
        UserError: an argument is not of that form, it is empty or given twice, or its key is unknown; names the
            nearest.
        SystemExit: after ``--help``.
    """
    if any(argument in ("-h", "--help") for argument in arguments):
        print(f"{usage}\n")
        width = max(map(len, known), default=0)
        print("\n".join(f"  {key:<{width}}  {meaning}" for key, meaning in known.items()))
        raise SystemExit(0)
    found: dict[str, str] = {}
    for argument in arguments:
        key, equals, value = argument.partition("=")
        if not equals:
            raise UserError(f"{argument!r} is not a key=value argument", usage)
        if key not in known:
            near = nearest(key, known)
            raise UserError(
                f"{argument}: unknown key", f"Did you mean {near}={value}?" if near else f"Keys: {', '.join(known)}"
            )
        if not value:
            raise UserError(f"{key}= is empty: {known[key]}", usage)
        if key in found:
            raise UserError(f"{key}= is given twice: {found[key]} and {value}", "Leave one of them out.")
        found[key] = value
    return found
