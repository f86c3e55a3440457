"""``key=value`` arguments of the commands that are not composed from a config."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

from sextant.config import nearest
from sextant.errors import UserError

Choice = TypeVar("Choice", bound=str)


def parse_arguments(arguments: Sequence[str], known: Mapping[str, str], usage: str) -> dict[str, str]:
    """Read ``key=value`` arguments.

    Args:
        arguments: of the command line.
        known: legal keys and what they mean.
        usage: an example, printed by ``--help``.

    Raises:
        UserError: an argument is not of that form, or its key is unknown; names the nearest.
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
        found[key] = value
    return found


def one_of(given: Mapping[str, str], key: str, allowed: Sequence[Choice]) -> Choice:
    """One of some words; the first of them unless given.

    Raises:
        UserError: it is another.
    """
    word = given.get(key, allowed[0])
    for each in allowed:
        if word == each:
            return each
    raise UserError(f"{key}={word} must be one of {', '.join(allowed)}", f"For example {key}={allowed[1]}")


def whole(given: Mapping[str, str], key: str, least: int) -> int | None:
    """A whole number from ``least`` up; None unless given.

    Raises:
        UserError: it is none.
    """
    text = given.get(key)
    if text is None:
        return None
    if not (text.isascii() and text.isdigit() and int(text) >= least):
        raise UserError(f"{key}={text} must be a whole number from {least} up", f"For example {key}=10")
    return int(text)
