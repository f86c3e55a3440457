"""The folder for everything that can be recreated, shared by all projects on this machine."""

import os
from pathlib import Path


def cache_folder() -> Path:
    """``SEXTANT_CACHE``, otherwise ``sextant`` in the user's cache folder; it may not exist yet."""
    own, shared = os.environ.get("SEXTANT_CACHE"), os.environ.get("XDG_CACHE_HOME")
    return Path(own).expanduser() if own else Path(shared or Path.home() / ".cache") / "sextant"
