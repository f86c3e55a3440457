"""Disk space of each extra: ``python -m benchmarks.install_sizes``.

An extra's packages are all that it requires, transitively, in the environment that runs this. Sizes are those of the
installed files by their records, without bytecode; *beyond the core* leaves out what ``pip install sextant-vision``
installs anyway. PyTorch's packages for CUDA, which a CPU wheel does not need, are counted apart.
"""

import re
import tomllib
from collections.abc import Sequence
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

from sextant.tables import TextTable

MB = 1e6
ROOT = Path(__file__).parents[1]
#: extras that consist of others, or are for working on Sextant itself
OF_OTHERS = ("all", "dev")
CUDA = re.compile(r"^(nvidia-.*|triton|cuda-.*)$")


def name_of(text: str) -> str:
    """The normalised name of a distribution."""
    return re.sub(r"[-_.]+", "-", text).lower()


@cache
def found(name: str) -> Distribution | None:
    """The installed distribution, if it is there."""
    try:
        return distribution(name)
    except PackageNotFoundError:
        return None


def required(name: str, extras: frozenset[str], seen: set[tuple[str, frozenset[str]]]) -> set[str]:
    """All distributions that one requires, itself included."""
    if (name, extras) in seen or (own := found(name)) is None:
        return set()
    seen.add((name, extras))
    names = {name}
    for line in own.requires or ():
        each = Requirement(line)
        if each.marker is None or any(each.marker.evaluate({"extra": extra}) for extra in (extras or {""})):
            names |= required(name_of(each.name), frozenset(each.extras), seen)
    return names


@cache
def size(name: str) -> float:
    """The size of the installed files in MB."""
    own = found(name)
    files = own.files or [] if own is not None else []
    paths = [Path(str(file.locate())) for file in files if not str(file).endswith(".pyc")]
    return sum(path.stat().st_size for path in paths if path.is_file()) / MB


def main() -> None:
    """Print the table."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    core = _closure(project["dependencies"])
    rows = [_row("core", core, set())]
    for extra, lines in project["optional-dependencies"].items():
        if extra not in OF_OTHERS:
            missing = [line for line in lines if found(name_of(Requirement(line).name)) is None]
            rows.append([extra, "not installed", "", ""] if missing else _row(extra, _closure(lines), core))
    print(TextTable(["extra", "packages beyond the core", "MB beyond the core", "of it for CUDA"], rows).markdown())


def _closure(lines: Sequence[str]) -> set[str]:
    seen: set[tuple[str, frozenset[str]]] = set()
    each = [Requirement(line) for line in lines]
    return set().union(*(required(name_of(one.name), frozenset(one.extras), seen) for one in each))


def _row(extra: str, names: set[str], core: set[str]) -> list[str]:
    new = names - core
    cuda = sum(size(each) for each in new if CUDA.match(each))
    return [extra, str(len(new)), f"{sum(map(size, new)):,.0f}", f"{cuda:,.0f}"]


if __name__ == "__main__":
    main()
