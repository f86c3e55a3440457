"""``key=value`` arguments of commands that do not compose a config."""

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
#: syntax of the values of a type, and its name in messages
WRITTEN = {int: ("[0-9]+", "a whole number"), float: (r"[^_\s]+", "a number"), bool: ("true|false", "true or false")}


class Options(BaseModel):
    """The options of a command.

    A field is a key. Its docstring is shown by ``--help``, and its first example in the message about a mistake. The
    allowed values follow from its type and bounds, or are described by its title.
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
        """Read the values of these keys; other keys are ignored.

        Raises:
            UserError: a key is missing, or a value is not allowed.
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
        """Read a command line that may have only these keys.

        Raises:
            UserError, SystemExit: as :func:`parse_arguments` and :meth:`of`.
        """
        return cls.of(parse_arguments(arguments, cls.meanings(), usage), usage)

    @field_validator("*", mode="before")
    @classmethod
    def _exactly(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse text that Pydantic would accept as a number or Boolean, such as 1_000 and yes."""
        written = WRITTEN.get(_types(cls.model_fields[str(info.field_name)])[0])
        if isinstance(value, str) and written and not re.fullmatch(written[0], value, re.ASCII):
            raise ValueError(written[1])
        return value


def _types(field: FieldInfo) -> list[Any]:
    """The types that a value may have, or the values of a ``Literal``, without None."""
    union = get_origin(field.annotation) in (Union, UnionType)
    members = [each for each in (get_args(field.annotation) if union else [field.annotation]) if each is not NoneType]
    return [
        inner for each in members for inner in (get_args(each) if get_origin(each) in (Literal, Annotated) else [each])
    ]


def word_values(field: FieldInfo) -> list[str]:
    """The values of a field that only takes certain words: those of its ``Literal``, or true and false."""
    kinds = _types(field)
    return ["true", "false"] if kinds == [bool] else [str(kind) for kind in kinds if isinstance(kind, str)]


def _allowed(field: FieldInfo) -> str:
    """The allowed values of a field in words, from its type and bounds."""
    kind, *others = _types(field)
    if isinstance(kind, str):
        return f"one of {', '.join([kind, *others])}"
    said, bounds = WRITTEN[kind][1], dict[str, float]()
    for each in field.metadata:
        bounds |= {name: getattr(each, name) for name in ("gt", "ge", "le") if hasattr(each, name)}
    if "gt" in bounds:
        return f"{said} above {bounds['gt']}{f' and at most {limit}' if (limit := bounds.get('le')) else ''}"
    if "ge" in bounds:
        return f"{said} from {bounds['ge']} {f'to {limit}' if (limit := bounds.get('le')) else 'up'}"
    return said


def parse_arguments(arguments: Sequence[str], known: Mapping[str, str], usage: str) -> dict[str, str]:
    """Read ``key=value`` arguments.

    Args:
        arguments: arguments of the command line.
        known: legal keys and their meanings.
        usage: an example, printed by ``--help``.

    Raises:
        UserError: an argument does not have this form, is empty or is given twice, or its key is unknown; the message
            names the nearest key.
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
