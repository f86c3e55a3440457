"""JSON written by other programs."""

import json
from pathlib import Path
from typing import Any

from sextant.errors import UserError
from sextant.user_files import read_text


def read_foreign_json(path: Path, fix: str) -> Any:
    """Read the content of a file that may hold anything.

    Raises:
        UserError: it cannot be read, or is not JSON.
    """
    try:
        return json.loads(read_text(path, fix))
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is not JSON: {str(error)[:80]}", fix) from None
