"""Checkpoints of plain containers: verified by a digest, and read without unpickling anything else.

They are written by :mod:`~sextant.runs.checkpoint_io`, which imports Lightning; reading does not.
"""

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sextant.errors import UserError
from sextant.models.weights_file import why_unread
from sextant.torch_file import load_verified

SCHEMA_VERSION = 1
KEY = "sextant"


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint on the CPU. Nothing in it is executed: only tensors and plain containers are accepted.

    Raises:
        UserError: the file is missing, truncated, damaged or not a checkpoint, or holds anything but tensors and plain
            containers.
    """
    return require_checkpoint(load_plain(path), path)


def load_plain(path: Path) -> Any:
    """Read what ``torch.save`` wrote, on the CPU. Nothing in it is executed.

    Raises:
        UserError: the file is missing, truncated or damaged, or holds anything but tensors and plain containers.
    """
    try:
        return load_verified(path)
    except UserError:
        raise
    except FileNotFoundError:
        raise UserError(f"no checkpoint at {path}") from None
    except pickle.UnpicklingError as error:
        raise UserError(
            f"{path} is not a plain checkpoint and was not loaded: {why_unread(error)}",
            "Only tensors and plain containers are read; nothing in the file was executed.",
        ) from None
    except Exception as error:  # a damaged pickle can fail in any way
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(f"{path} cannot be read as a checkpoint, it may be truncated: {reason}") from None


def require_checkpoint(found: Any, path: Path) -> dict[str, Any]:
    """The content of a checkpoint, if it is one.

    Raises:
        UserError: it is none, or of another version.
    """
    if (
        not isinstance(found, dict)
        or not isinstance(found.get(KEY), dict)
        or not isinstance(found.get("state_dict"), Mapping)
    ):
        raise UserError(f"{path} is not a checkpoint of Sextant: it has no config to rebuild the model from")
    version = found[KEY].get("schema_version")
    if version != SCHEMA_VERSION:
        raise UserError(f"{path} has checkpoint format {version}, this version of Sextant reads {SCHEMA_VERSION}")
    return found
