"""What is refused before data is read or a run directory is made."""

from collections.abc import Mapping
from typing import Any

from hydra.errors import HydraException
from hydra.utils import instantiate

from sextant.cli.families import Source, family_of
from sextant.config import Config, validate
from sextant.errors import UserError


def checked(raw: Mapping[str, Any]) -> Config:
    """A config, typed; its choices go together, and each import path in it is there. Nothing of the machine is asked.

    Raises:
        UserError: as :func:`~sextant.config.validate.validate`, choices do not go together, or there is no such module,
            name or callable.
    """
    config = validate(raw)
    family_of(config.task.name).check_parts(config)
    for key, path in config.custom_parts().items():
        _require_callable(key, path)
    return config


def require_possible(config: Config, source: Source) -> None:
    """Raise a ``UserError`` unless this machine has the device and the data has a training batch."""
    require_device(config)
    count = family_of(config.task.name).training_size(config, source)
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


def _require_callable(key: str, path: str) -> None:
    """Raise a ``UserError`` unless Hydra finds and allows what ``path`` names; it is imported and not called."""
    try:
        instantiate({"_target_": path, "_partial_": True})
    except HydraException as error:
        cause = error.__cause__ or error
        said = " ".join(line.strip() for line in str(cause).splitlines() if "full_key" not in line)
        raise UserError(
            f"{key}={path}: {said}",
            "Name a class or function by its import path, such as my_package.my_module.MyClass.",
        ) from None
