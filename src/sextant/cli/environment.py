"""Whether a run can be made here: its data, its output folder, its tracking server."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sextant.cli.terminal import TERMINAL
from sextant.config import Config
from sextant.errors import UserError
from sextant.recipes import recipe_of


def check_environment(raw: Mapping[str, Any], config: Config) -> None:
    """Whether the data is there, the output folder can be written to, and the tracking server answers."""
    from sextant.tracking.store import require_server

    outputs = Path(config.paths.outputs)
    try:
        outputs.mkdir(parents=True, exist_ok=True)
        probe = outputs / f".writable-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise UserError(
            f"paths.outputs={outputs} cannot be written to: {error.strerror}",
            "Choose another folder: paths.outputs=/path, or set SEXTANT_OUTPUTS",
        ) from None
    recipe = recipe_of(config.task.name, TERMINAL)
    recipe.check(recipe.source(raw, config))
    if config.tracking.kind == "server" and config.tracking.uri is not None:
        require_server(config.tracking.uri)
