"""Where is kept what can be made again, for every project on this machine."""

import os
from pathlib import Path


def cache_folder() -> Path:
    """``SEXTANT_CACHE``, else ``sextant`` in the user's folder of caches; it may not be there yet."""
    own, shared = os.environ.get("SEXTANT_CACHE"), os.environ.get("XDG_CACHE_HOME")
    return Path(own).expanduser() if own else Path(shared or Path.home() / ".cache") / "sextant"
