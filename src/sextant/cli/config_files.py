"""The YAML files that configs are composed of: which there are, and which of them cannot be read."""

from functools import cache
from pathlib import Path
from typing import Any

import yaml

from sextant.errors import UserError
from sextant.runs.outputs_folder import conf_dir


@cache
def groups() -> dict[str, tuple[str, ...]]:
    """Options of every config group, such as ``{"dataset": ("cifar10", "digits", ...)}``."""
    found: dict[str, list[str]] = {}
    for path in sorted(conf_dir().glob("*/*.yaml")):
        found.setdefault(path.parent.name, []).append(path.stem)
    return {name: tuple(options) for name, options in found.items()}


def read_config_file(path: Path) -> dict[str, Any]:
    """The keys of one file, nothing composed.

    Raises:
        UserError: it is not UTF-8, not YAML, or holds no keys; names the file, and the line where YAML ends.
    """
    try:
        content = yaml.safe_load(path.read_text("utf-8"))
    except UnicodeDecodeError as error:
        where = f"byte {error.start + 1} is {error.object[error.start]:#04x}"
        raise UserError(f"{path} is not UTF-8: {where}", "Save the file as UTF-8.") from None
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}") from None
    except yaml.YAMLError as error:
        mark, said = getattr(error, "problem_mark", None), getattr(error, "problem", None) or str(error)
        line = "" if mark is None else f", line {mark.line + 1}"
        raise UserError(f"{path}{line} is not YAML: {said}", "Keys are written key: value, nested by spaces.") from None
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise UserError(f"{path} holds a {type(content).__name__}, not keys", "Write key: value, one a line.")
    return content


def unreadable_config_file() -> UserError | None:
    """What is wrong with the first file that cannot be read, for an error of Hydra's that names none."""
    for path in sorted(conf_dir().rglob("*.yaml")):
        try:
            read_config_file(path)
        except UserError as error:
            return error
    return None
