"""Overrides of a config, such as ``optimizer.lr=0.1`` or ``seed=0,1,2``, parsed one by one."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.override_parser import types
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, OverrideParseException

from sextant.config.path_keys import MAPPINGS, PATHS, PLACES
from sextant.config.schema.searches import GRAMMAR, WRITTEN, is_dimension
from sextant.errors import UserError

#: keys of the schema that no config file has, since their absence is the default
ADDED = ("tracking.also", "dataset.crop")


@dataclass(frozen=True)
class Override:
    """One override.

    Attributes:
        text: as it was written.
        parsed: the override as parsed by Hydra.
    """

    text: str
    parsed: types.Override

    @property
    def key(self) -> str:
        """The dotted key, or the group whose option it chooses."""
        return str(self.parsed.key_or_group)

    @property
    def place(self) -> str:
        """The place in the config that it sets: ``test_sampling`` for ``sampling@test_sampling=..``."""
        return str(self.parsed.package or self.key.split(".")[0])

    @property
    def sweeps(self) -> bool:
        """Whether it lists several values."""
        return bool(self.parsed.is_sweep_override())

    @property
    def deletes(self) -> bool:
        """Whether it removes a key: ``~key``."""
        return bool(self.parsed.is_delete())

    @property
    def value(self) -> Any:
        """Its single value."""
        return self.parsed.value()

    @property
    def option(self) -> str:
        """Its single value as text; empty for null."""
        return str(self.parsed.get_value_element_as_str()) if self.value is not None else ""

    def choices(self) -> list[str]:
        """Its values as text; one unless it sweeps.

        Raises:
            UserError: it sweeps over something other than a list.
        """
        if not self.sweeps:
            return [self.option if self.value is not None else "null"]
        try:
            return [str(value) for value in self.parsed.sweep_string_iterator()]
        except (HydraException, ValueError):
            raise UserError(f"{self.text}: a sweep lists its values", f"For example {self.key}=a,b,c") from None


def parse(overrides: Sequence[str]) -> list[Override]:
    """Parse overrides.

    Raises:
        UserError: an override cannot be parsed; the message names the first.
    """
    parser, found = OverridesParser.create(), []
    for text in map(literal, overrides):
        try:
            (parsed,) = parser.parse_overrides([text])
        except OverrideParseException:
            value = text.partition("=")[2]
            if is_dimension(value):
                raise UserError(f"{text}: a range of values needs a search", "Add -m sweep.search=tpe") from None
            ranges = f"; a search's ranges are {GRAMMAR}" if WRITTEN.fullmatch(value) else ""
            raise UserError(
                f"{text!r} is not a key=value override",
                f"Write key=value without spaces; quote values with special characters: 'key=\"a, b\"'{ranges}",
            ) from None
        found.append(Override(text, parsed))
    return found


def literal(text: str) -> str:
    """An override whose value is a path, with the path in quotes if Hydra would parse it as anything else.

    In Hydra's grammar of values ``~``, ``=``, ``#`` and letters beyond ASCII are errors, and brackets and commas mark
    lists. A comma separates paths, except in ``paths`` and in the name of an existing path.

    So is the option ``nan`` of ``debug``, which would be a number. Keys that no config file has are added.

    >>> literal("paths.outputs=~/runs, old"), literal("dataset.folder=photos")
    ("paths.outputs='~/runs, old'", 'dataset.folder=photos')
    >>> literal("debug=nan"), literal("tracking.also=[csv]")
    ("debug='nan'", '++tracking.also=[csv]')
    """
    key, _, value = text.partition("=")
    if text == "debug=nan":
        return "debug='nan'"
    if key in ADDED:
        return f"++{text}"
    if key.lstrip("+") not in PATHS or not value or "${" in value:
        return text
    single = key.lstrip("+") in PLACES or _exists(value)
    try:
        parsed = OverridesParser.create().parse_override(text)
        other = str | None | (dict | list | int | float if key.lstrip("+") in MAPPINGS else str)
        fine = not single if parsed.is_sweep_override() else isinstance(parsed.value(), other)
    except (HydraException, ValueError):
        fine = False
    if fine and value == value.strip():
        return text
    return f"{key}={','.join(map(quoted, [value] if single else value.split(',')))}"


def quoted(value: str) -> str:
    """A value in Hydra's quotes; backslashes count only before a quote."""
    return "'" + re.sub(r"(\\*)('|\Z)", lambda found: 2 * found[1] + found[2].replace("'", r"\'"), value) + "'"


def _exists(path: str) -> bool:
    try:
        return Path(path).expanduser().exists()
    except (OSError, ValueError, RuntimeError):  # too long, or a null byte, or no such user
        return False
