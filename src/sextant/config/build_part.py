"""Objects from the plain values of a config, without Hydra: for what is built of files outside of the command line."""

from collections.abc import Mapping
from functools import partial
from importlib import import_module
from typing import Any

TARGET, PARTIAL = "_target_", "_partial_"
#: modules whose functions no config may call, by whatever path they are reached
REFUSED = frozenset({
    "_io", "_pickle", "code", "codeop", "ctypes", "importlib", "io", "marshal", "multiprocessing", "nt", "os", "pickle",
    "posix", "pty", "runpy", "shutil", "signal", "socket", "subprocess", "sys", "webbrowser",
})  # fmt: skip
REFUSED_BUILTINS = frozenset(f"builtins.{name}" for name in ("__import__", "breakpoint", "compile", "eval", "exec"))
#: where parts are today whose import paths configs of stored runs hold; configs, and so digests, keep the old path
MOVED = {
    "sextant.cli.descriptors.TrainedDescriptor": "sextant.recipes.descriptors.TrainedDescriptor",
    "sextant.cli.descriptors.DescriptorFiles": "sextant.recipes.descriptors.DescriptorFiles",
}


def build_part(node: Mapping[str, Any], **arguments: Any) -> Any:
    """The object that a node names by its import path, as ``hydra.utils.instantiate`` with plain containers makes it.

    Nodes within the node are built first. Whatever path is named is imported and called: the config must have been
    checked before, :func:`~sextant.config.trained.trained_config`.

    Args:
        node: with ``_target_``; with ``_partial_`` true, what is given back is still to be called.
        arguments: further ones.

    Raises:
        ImportError: there is no such module or name in it.
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
    """What an import path names: a name in a module, or a name in that.

    Raises:
        ImportError: there is no such module or name, or it is one of :data:`REFUSED`.
    """
    parts = MOVED.get(path, path).split(".")
    for length in range(len(parts) - 1, 0, -1):
        module = ".".join(parts[:length])
        try:
            found: Any = import_module(module)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{module}.".startswith(f"{error.name}."):
                raise  # the module is there, and one that it needs is not
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
