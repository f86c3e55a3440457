"""Hash of the source code that computes results, stored with them so that a change of code is noticed."""

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import sextant
from sextant.registry import CHAPTERS

#: modules of a chapter that show results
SHOWS = ("figures", "measure")
#: Parts of the package that show or store results but compute none.
NOT_COMPUTING = (
    "reports/",
    "figures/",
    "tracking/",
    "cli/report",
    "cli/dashboard",
    "cli/data",
    "cli/gallery",
    "cli/runs",
    "cli/show",
    "cli/progress",
    "lifecycle/results",
    "lifecycle/run_reporter",
    "kit/measure",
    "tables",
    *(f"{package.partition('.')[2].replace('.', '/')}/{name}" for package in CHAPTERS.values() for name in SHOWS),
)


def source_sha256(targets: Iterable[str] = ()) -> str:
    """SHA-256 over the package's computing source and the modules of import paths outside the package.

    Args:
        targets: the ``_target_`` paths of a config; paths within torch and Sextant add nothing.
    """
    own = [target for target in sorted(set(targets)) if target.split(".")[0] not in ("sextant", "torch")]
    tree = hashlib.sha256(_package().encode())
    for target in own:
        tree.update(target.encode() + b"\0" + _module_source(target.rpartition(".")[0]))
    return tree.hexdigest() if own else _package()


@cache
def _package() -> str:
    root = Path(sextant.__file__).parent
    tree = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        name = path.relative_to(root).as_posix()
        if not name.startswith(NOT_COMPUTING):
            tree.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return tree.hexdigest()


def _module_source(name: str) -> bytes:
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):
        return b""
    if spec is None or not spec.has_location or spec.origin is None:  # missing, or built into the interpreter
        return b""
    return Path(spec.origin).read_bytes()
