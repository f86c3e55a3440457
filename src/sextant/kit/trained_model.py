"""The trained module of a checkpoint."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sextant.config import Config
from sextant.config.trained import without_weights
from sextant.kit import recipe_of
from sextant.kit.content import load_weights
from sextant.runs.checkpoint import KEY


def model_from_checkpoint(config: Config, content: Mapping[str, Any], checkpoint: Path) -> Any:
    """The trained module of a checkpoint, built from ``config``.

    Args:
        config: the checkpoint's typed config, possibly with other test conditions.
        content: content of the checkpoint from :func:`read_trained`.
        checkpoint: its file, for messages.

    Raises:
        UserError: the weights do not fit, or are not finite.
    """
    module = recipe_of(config.task.name).module(without_weights(config), content[KEY]["spec"], training=False)
    load_weights(module, content, checkpoint)
    return module.eval()
