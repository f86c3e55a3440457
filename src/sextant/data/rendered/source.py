"""Hash of the rendering source: a store carries it, so that changes of the renderer are detected."""

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path


def modules_sha256(*names: str) -> str:
    """SHA-256 over the source of modules and whole packages, by import path, without executing the modules.

    Example: ``modules_sha256("sextant.worlds", "sextant.geometry", __name__)``. The parent packages of a module are
    imported to find it.

    Raises:
        ModuleNotFoundError: there is no such module.
    """
    return _modules_sha256(tuple(sorted(set(names))))


@cache
def _modules_sha256(names: tuple[str, ...]) -> str:
    tree = hashlib.sha256()
    for name in names:
        for label, path in _files(name):
            tree.update(label.encode() + b"\0" + path.read_bytes() + b"\0")
    return tree.hexdigest()


def _files(name: str) -> Iterable[tuple[str, Path]]:
    spec = find_spec(name)
    if spec is None or (spec.origin is None and not spec.submodule_search_locations):
        raise ModuleNotFoundError(f"no module named {name!r}", name=name)
    if not spec.submodule_search_locations:
        return [(name, Path(str(spec.origin)))]
    roots = [Path(root) for root in spec.submodule_search_locations]
    return [
        (f"{name}/{path.relative_to(root).as_posix()}", path) for root in roots for path in sorted(root.rglob("*.py"))
    ]
