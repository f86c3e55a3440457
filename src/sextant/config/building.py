"""From a config to objects; the only module that builds what ``_target_`` names."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import Any

from sextant.errors import ArgumentError, UserError
from sextant.moved import TARGET, present_name

PARTIAL = "_partial_"
#: modules whose functions no config may call, under any import path
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
            raise ImportError(f"{path} is refused: it runs programs or code, or changes files, and builds no part")
        return found
    raise ImportError(f"{path}: no such module")


def build(raw: Mapping[str, Any], group: str, **arguments: Any) -> Any:
    """Build the object that the config of ``group`` describes, passing further ``arguments``.

    Raises:
        UserError: the import path does not exist, or the object does not take these arguments.
    """
    node = raw[group]
    try:
        return build_part(node, **arguments)
    except ArgumentError as error:
        raise error.within(group, node) from None
    except UserError:
        raise
    except (TypeError, ValueError, ImportError, AttributeError, KeyError, OSError, RuntimeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise UserError(
            f"{group}: {node.get('_target_')} cannot be built: {reason}",
            f"It is called with the keys of {group}" + (f" and {', '.join(arguments)}" if arguments else ""),
        ) from None


def require_callable(key: str, path: str) -> None:
    """Check that the import path in a key of a config names a callable, without calling it.

    Raises:
        UserError: the module or name does not exist, is not callable, or is one that no config may call.
    """
    fix = "Name a class or function by its import path, such as my_package.my_module.MyClass."
    try:
        found = named(path)
    except Exception as error:  # the user's own module can raise anything
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise UserError(f"{key}={path}: {reason}", fix) from None
    if not callable(found):
        raise UserError(f"{key}={path} is not a class or function", fix)


@contextmanager
def naming_groups(raw: Mapping[str, Any]) -> Iterator[None]:
    """Add the config group to errors about an argument that are raised long after its part was built.

    The group is that of the part that the error names, else ``task``, from which modules and their settings are made.
    An error that names no part belongs to the dataset, whose files are read last.
    """
    try:
        yield
    except ArgumentError as error:
        parts = {
            str(node["_target_"]).rpartition(".")[-1]: group
            for group, node in raw.items()
            if isinstance(node, Mapping) and "_target_" in node
        }
        group = "dataset" if error.of is None else parts.get(error.of, "task")
        raise error.within(group, raw[group]) from None


def part_name(node: Mapping[str, Any]) -> str:
    """The class name of a config node, with its settings."""
    name = str(node["_target_"]).rsplit(".", 1)[-1]
    settings = ", ".join(f"{key}={value}" for key, value in node.items() if not key.startswith("_"))
    return f"{name}({settings})"
