"""Finding the stores of a folder, and the one that a name refers to."""

from pathlib import Path

from sextant.data.rendered.verify import is_store
from sextant.errors import UserError


def stores_in(cache: Path) -> list[Path]:
    """The stores of a folder, including damaged ones, in the order of their names."""
    return sorted(path for path in cache.glob("*") if is_store(path))


def find_store(name: str, cache: Path) -> Path:
    """The store that ``name`` refers to: its path, the name of its folder, or of its dataset if that has one store.

    Raises:
        UserError: there is none, or several; the message names those in ``cache``.
    """
    for path in (Path(name).expanduser(), cache / name):
        if is_store(path):
            return path.absolute()
    stores = stores_in(cache)
    found = [path for path in stores if path.name.rpartition("-")[0] == name]
    if len(found) == 1:
        return found[0]
    several = ", ".join(path.name for path in found or stores) or "none"
    raise UserError(
        f"{name}: {'several stores' if found else 'no store'} of that name in {cache}", f"Stores there: {several}"
    )
