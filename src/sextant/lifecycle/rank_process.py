"""The other processes of a run, which train their share and write nothing."""

import os
import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sextant.config import validate
from sextant.lifecycle.ranks import Rank
from sextant.lifecycle.training import fit
from sextant.registry import chapter_of
from sextant.runs.directory import RunDirectory, RunKey
from sextant.tracking.environment import quiet_libraries


def main(given: Mapping[str, Any]) -> None:
    """Train together with the process that sent ``given``."""
    threading.Thread(target=_end_with_the_first, daemon=True).start()
    quiet_libraries()
    config, rank = validate(given["config"]), Rank(given["rank"], given["meeting"])
    chapter = chapter_of(config.task.name)
    directory = RunDirectory(Path(given["directory"]))
    fit(config, chapter, chapter.source(config), directory, RunKey(**given["key"]), resume=given["resume"], rank=rank)


def _end_with_the_first() -> None:
    sys.stdin.read()
    os._exit(1)
