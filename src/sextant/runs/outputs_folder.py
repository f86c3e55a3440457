"""Default locations of the config files and of the outputs."""

import os
from functools import cache
from pathlib import Path

import sextant


@cache
def conf_dir() -> Path:
    """The folder of YAML files: ``conf/`` of the checkout, or its copy inside an installed package."""
    package = Path(sextant.__file__).parent
    checkout = package.parents[1] / "conf"
    return checkout if (checkout / "train.yaml").is_file() else package / "conf"


def default_outputs() -> Path:
    """Where runs are written: ``SEXTANT_OUTPUTS``, else ``outputs`` in the checkout, else in the working directory."""
    if chosen := os.environ.get("SEXTANT_OUTPUTS"):
        return Path(chosen).expanduser().absolute()
    return (conf_dir().parent if conf_dir().parent.name != "sextant" else Path.cwd()) / "outputs"


def other_than_default(outputs: Path) -> str | None:
    """The folder for ``outputs=`` of a command; None for the default, which needs no key."""
    return None if outputs.absolute() == default_outputs() else str(outputs.absolute())
