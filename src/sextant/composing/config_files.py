"""The YAML files from which configs are composed: finding them, and reporting unreadable ones."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import yaml
from hydra.utils import get_object

from sextant.composing.overrides import quoted
from sextant.errors import UserError, command
from sextant.runs.outputs_folder import conf_dir
from sextant.user_files import absent

#: folders of YAML files that are not options of a config
NO_GROUPS = ("claim",)

#: the flag that names a folder of the user's own config files
CONFIG_DIR = ("--config-dir", "-cd")

_OWN: ContextVar[tuple[Path, ...]] = ContextVar("folders of a user's own config files", default=())


@contextmanager
def own_configs(folder: str | Path | None) -> Iterator[None]:
    """Also find the options of a folder laid out like ``conf/`` while the context is open; shipped ones come first.

    Raises:
        UserError: the folder does not exist.
    """
    if folder is None:
        yield
        return
    path = Path(folder).expanduser().absolute()
    if not path.is_dir():
        raise UserError(f"config_dir={absent(folder)}", "Its files are <group>/<option>.yaml.")
    before = _OWN.set((*_OWN.get(), path))
    try:
        yield
    finally:
        _OWN.reset(before)


def folders() -> tuple[Path, ...]:
    """The folders that are searched for config files."""
    return (conf_dir(), *_OWN.get())


def search_path() -> list[str]:
    """The override that makes Hydra find a user's own options, if there are any."""
    own = ",".join(quoted(f"file://{path}") for path in _OWN.get())  # Hydra strips the scheme and decodes nothing
    return [f"hydra.searchpath=[{own}]"] if own else []


def with_folders(overrides: Sequence[str]) -> list[str]:
    """The arguments that pass these overrides to another process; :func:`without_folder` is the inverse."""
    return [*overrides, *(f"{CONFIG_DIR[0]}={path}" for path in _OWN.get())]


def sweep_command(overrides: Sequence[str]) -> str:
    """The command that runs these overrides as a sweep."""
    return command("train", "-m", *with_folders(overrides))


def without_folder(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """The arguments without ``--config-dir``, and the folder that it names."""
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
    """Read the keys of one file without composing anything.

    Raises:
        UserError: the file is not UTF-8, is not YAML, or holds no keys. The message names the file, and the line where
            YAML parsing fails.
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
        raise UserError(f"{path} holds a {type(content).__name__}, not keys", "Write key: value, one per line.")
    return content


def unreadable_config_file(chosen: Mapping[str, str], error: Exception | None = None) -> UserError | None:
    """The error of an unreadable file among those that were read, for errors of Hydra without a file name.

    Args:
        chosen: option chosen from each group; options that were not chosen are not checked.
        error: the error of the YAML library, which names the file.

    Returns:
        None if all are readable.
    """
    mark = getattr(error, "problem_mark", None)
    paths = [Path(mark.name)] if mark is not None else []
    paths += [folder / group / f"{option}.yaml" for group, option in chosen.items() for folder in folders()]
    shipped = sorted(conf_dir().rglob("*.yaml")) if error is not None else []
    for path in (path for path in (*paths, *shipped) if path.is_file()):
        try:
            read_config_file(path)
        except UserError as found:
            return found
    return None


RANGE = re.compile(r"(?P<key>[^=\s]+)=(?P<range>(?:log_uniform|uniform|int)\s*\(.*\))")
METHOD = "sweep.search="


def is_range(text: str) -> bool:
    """Whether an override gives a range of numbers; Hydra reads ``int(2.5)`` as a number, not a range."""
    found = RANGE.fullmatch(text)
    return found is not None and (found["range"].startswith(("log", "uni")) or "," in text)


def search_words(words: Sequence[str]) -> list[str]:
    """Rewrite the overrides of a search so that Hydra can compose them.

    ``sweep.search=tpe`` names the method. It needs no stored sweep, so keys of ``sweep`` are added. A range becomes
    text. An override that lists several values is a choice, as in other sweeps.
    """
    searching = any(word.startswith(("sweep.search", "++sweep.search")) for word in words)
    return [_composable(word, searching) for word in words]


def _composable(word: str, searching: bool) -> str:
    if is_range(word):
        key, _, text = word.partition("=")
        return f'{key}="{text}"'
    if word.startswith(METHOD):
        return f"++{METHOD[:-1]}.method={word.removeprefix(METHOD)}"
    return f"++{word}" if searching and word.startswith("sweep.") else word


def is_rendered(target: str) -> bool:
    """Whether an import path names a rendered dataset; true for a user's own path that cannot be imported."""
    try:
        return callable(getattr(get_object(target), "plan", None))
    except Exception:  # importing the user's module may raise anything; building it reports more
        return not target.startswith("sextant.")


def rendered_datasets() -> str:
    """A sentence that lists the options that can be rendered."""
    names = []
    for name in groups()["dataset"]:
        target = read_config_file(conf_dir() / "dataset" / f"{name}.yaml").get("_target_")
        if target and is_rendered(str(target)):
            names.append(name)
    return f"Rendered datasets: {', '.join(names) or 'none yet'}"
