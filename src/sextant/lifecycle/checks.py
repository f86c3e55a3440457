"""What is refused before data is read or a run directory is made."""

from collections.abc import Mapping
from typing import Any

from sextant.config import Config, validate
from sextant.config.building import require_callable
from sextant.errors import UserError
from sextant.recipes import Source, recipe_of


def checked(raw: Mapping[str, Any]) -> Config:
    """A config, typed; its choices go together, and each import path in it is there. Nothing of the machine is asked.

    Raises:
        UserError: as :func:`~sextant.config.validate.validate`, choices do not go together, or there is no such module,
            name or callable.
    """
    config = validate(raw)
    recipe_of(config.task.name).check_parts(config)
    for key, path in config.custom_parts().items():
        require_callable(key, path)
    return config


def require_possible(config: Config, source: Source) -> None:
    """Raise a ``UserError`` unless this machine has the device and the data has a training batch."""
    require_device(config)
    count = recipe_of(config.task.name).training_size(config, source)
    if count is not None and config.trainer.batch_size > count:
        raise UserError(
            f"trainer.batch_size={config.trainer.batch_size}: dataset={source.name} has {count:,} images to train on",
            f"For example trainer.batch_size={min(32, count)}",
        )


def require_device(config: Config) -> None:
    """Raise a ``UserError`` if the config asks for a GPU that is not there."""
    if config.trainer.accelerator == "gpu":
        import torch

        if not torch.cuda.is_available():
            raise UserError("trainer.accelerator=gpu: no CUDA device was found on this machine", "Use trainer=cpu")
