"""The YAML files that configs are composed of: which there are, and which of them cannot be read."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import yaml

from sextant.errors import UserError
from sextant.runs.outputs_folder import conf_dir

#: folders of YAML files that are no options of a config
NO_GROUPS = ("claim",)

#: the flag that names a folder of config files of one's own
CONFIG_DIR = ("--config-dir", "-cd")

_OWN: ContextVar[tuple[Path, ...]] = ContextVar("folders of a user's own config files", default=())


@contextmanager
def own_configs(folder: str | Path | None) -> Iterator[None]:
    """Find the options of a folder laid out as ``conf/`` too, as long as the context is open; those shipped come first.

    Raises:
        UserError: there is no such folder.
    """
    if folder is None:
        yield
        return
    path = Path(folder).expanduser().absolute()
    if not path.is_dir():
        raise UserError(f"config_dir={folder}: there is no such folder", "Its files are <group>/<option>.yaml.")
    before = _OWN.set((*_OWN.get(), path))
    try:
        yield
    finally:
        _OWN.reset(before)


def folders() -> tuple[Path, ...]:
    """Where config files are looked for."""
    return (conf_dir(), *_OWN.get())


def search_path() -> list[str]:
    """The override that makes Hydra find a user's own options, if there are any."""
    own = ",".join("'file://{}'".format(str(path).replace("'", r"\'")) for path in _OWN.get())
    return [f"hydra.searchpath=[{own}]"] if own else []


def with_folders(overrides: Sequence[str]) -> list[str]:
    """The arguments that mean these overrides in another process; :func:`without_folder` takes them apart."""
    return [*overrides, *(f"{CONFIG_DIR[0]}={path}" for path in _OWN.get())]


def without_folder(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """The other arguments, and the folder that ``--config-dir`` names."""
    words, folder, rest = [], None, iter(arguments)
    for word in rest:
        flag, equals, value = word.partition("=")
        if flag in CONFIG_DIR:
            folder = value if equals else next(rest, "")
        else:
            words.append(word)
    return words, folder


def groups() -> dict[str, tuple[str, ...]]:
    """Options of every config group, such as ``{"dataset": ("cifar10", "digits", ...)}``."""
    found: dict[str, dict[str, None]] = {}
    for path in (path for folder in folders() for path in sorted(folder.glob("*/*.yaml"))):
        if path.parent.name not in NO_GROUPS:
            found.setdefault(path.parent.name, {})[path.stem] = None
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
    for path in (path for folder in folders() for path in sorted(folder.rglob("*.yaml"))):
        try:
            read_config_file(path)
        except UserError as error:
            return error
    return None
