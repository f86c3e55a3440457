"""JSON written by other programs."""

import json
from pathlib import Path
from typing import Any

from sextant.errors import UserError


def read_foreign_json(path: Path, fix: str) -> Any:
    """Read the content of a file that may hold anything.

    Raises:
        UserError: it cannot be read, or is not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}", fix) from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is no JSON: {str(error)[:80]}", fix) from None
