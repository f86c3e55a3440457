"""From a config to objects; the only module that builds what ``_target_`` names."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from sextant.config.build_part import build_part, named
from sextant.errors import ArgumentError, UserError


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
        raise UserError(f"{key}={path} is no class or function", fix)


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
