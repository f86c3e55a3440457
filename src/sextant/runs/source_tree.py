"""Hash of the package's source: results carry it, so that a change of code is seen."""

import hashlib
from functools import cache
from pathlib import Path

import sextant


@cache
def source_tree_sha256() -> str:
    """SHA-256 over the names and contents of all Python files of the package, as they were when first asked for."""
    root = Path(sextant.__file__).parent
    tree = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        tree.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return tree.hexdigest()
