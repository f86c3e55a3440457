"""Builds objects from the plain values of a config without Hydra, for use outside the command line."""

from collections.abc import Mapping
from functools import partial
from importlib import import_module
from typing import Any

from sextant.config.names import TARGET, present_name

PARTIAL = "_partial_"
#: modules whose functions no config may call, whatever path leads to them
REFUSED = frozenset({
    "_io", "_pickle", "code", "codeop", "ctypes", "importlib", "io", "marshal", "multiprocessing", "nt", "os", "pickle",
    "posix", "pty", "runpy", "shutil", "signal", "socket", "subprocess", "sys", "webbrowser",
})  # fmt: skip
REFUSED_BUILTINS = frozenset(f"builtins.{name}" for name in ("__import__", "breakpoint", "compile", "eval", "exec"))


def build_part(node: Mapping[str, Any], **arguments: Any) -> Any:
    """Build the object that a node names by its import path, like ``hydra.utils.instantiate`` with plain containers.

    Nodes within the node are built first. The named path is imported and called, so the config must have been checked
    before; see :func:`~sextant.config.trained.trained_config`.

    Args:
        node: config node with ``_target_``; with ``_partial_`` true, the result is a partial function.
        arguments: further arguments.

    Raises:
        ImportError: the module, or the name in it, does not exist.
        TypeError, ValueError: the object does not take these arguments.
    """
    given = {key: _built(value) for key, value in node.items() if key not in (TARGET, PARTIAL)} | arguments
    make = named(str(node[TARGET]))
    return partial(make, **given) if node.get(PARTIAL) else make(**given)


def _built(value: Any) -> Any:
    if isinstance(value, Mapping):
        return build_part(value) if TARGET in value else {key: _built(inner) for key, inner in value.items()}
    return [_built(inner) for inner in value] if isinstance(value, list | tuple) else value


def named(path: str) -> Any:
    """Import the object that a path names: a name in a module, or an attribute of one.

    Raises:
        ImportError: the module or name does not exist, or it is one of :data:`REFUSED`.
    """
    parts = present_name(path).split(".")
    for length in range(len(parts) - 1, 0, -1):
        module = ".".join(parts[:length])
        try:
            found: Any = import_module(module)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{module}.".startswith(f"{error.name}."):
                raise  # the module exists, but one that it imports does not
            continue
        for name in parts[length:]:
            if not hasattr(found, name):
                raise ImportError(f"{path}: {module} has no {'.'.join(parts[length:])}")
            found = getattr(found, name)
        if (
            path in REFUSED_BUILTINS
            or {module.split(".")[0], str(getattr(found, "__module__", "")).split(".")[0]} & REFUSED
        ):
            raise ImportError(f"{path} is refused: it runs programs or code, or changes files, and makes no part")
        return found
    raise ImportError(f"{path}: there is no such module")
