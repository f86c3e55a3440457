"""Paths and names as words of Hydra's grammar of overrides."""

import re
from collections.abc import Mapping
from pathlib import Path


def override(path: Path | str) -> str:
    """A path as a value in Hydra's grammar: quoted unless it consists of plain characters."""
    text = str(path)
    if re.fullmatch(r"[\w./+-]+", text, re.ASCII):
        return text
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def overrides_of(folders: Mapping[str, Path]) -> str:
    """Named folders as a mapping in Hydra's grammar: ``{run: run}``."""
    return "{" + ", ".join(f"{name}: {override(folder)}" for name, folder in folders.items()) + "}"


def plain_name(text: str) -> str:
    """A name that can be a key of a config."""
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_")
    return name if name and not name[0].isdigit() else f"run_{name}"
