"""Checkpoints of plain containers: written atomically, read without unpickling anything else."""

import pickle
from pathlib import Path
from typing import Any

import torch
from pytorch_lightning.plugins.io import CheckpointIO

from sextant.atomic_files import write_atomically
from sextant.errors import UserError
from sextant.models.weights_file import why_unread

SCHEMA_VERSION = 1
KEY = "sextant"


class AtomicCheckpointIO(CheckpointIO):
    """Saves a checkpoint beside the previous one and renames it, so that a crash or a full disk loses nothing."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any | None = None) -> None:
        """Write ``checkpoint`` to ``path``.

        Raises:
            UserError: the disk is full or not writable; the previous checkpoint is still there.
        """
        try:
            write_atomically(Path(path), lambda file: torch.save(checkpoint, file))
        except (OSError, RuntimeError) as error:  # torch wraps an OSError of the file it writes to
            cause = error.__cause__ or error.__context__ or error
            raise UserError(
                f"could not save the checkpoint {path}: {cause}",
                "The previous checkpoint is intact. Free some space and run the same command: it resumes from there.",
            ) from error

    def load_checkpoint(self, path: Any, map_location: Any = None, weights_only: bool | None = True) -> dict[str, Any]:
        """Read a checkpoint; see :func:`load_checkpoint`."""
        return load_checkpoint(Path(path))

    def remove_checkpoint(self, path: Any) -> None:
        """Delete a checkpoint."""
        Path(path).unlink(missing_ok=True)


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint on the CPU. Nothing in it is executed: only tensors and plain containers are accepted.

    Raises:
        UserError: the file is missing, truncated, not a checkpoint, or holds anything but tensors and containers.
    """
    try:
        found = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise UserError(f"no checkpoint at {path}") from None
    except pickle.UnpicklingError as error:
        raise UserError(
            f"{path} is not a plain checkpoint and was not loaded: {why_unread(error)}",
            "Only tensors and plain containers are read; nothing in the file was executed.",
        ) from None
    except (RuntimeError, EOFError, OSError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(f"{path} cannot be read as a checkpoint, it may be truncated: {reason}") from None
    if not isinstance(found, dict) or not isinstance(found.get(KEY), dict) or "state_dict" not in found:
        raise UserError(f"{path} is not a checkpoint of Sextant: it has no config to rebuild the model from")
    version = found[KEY].get("schema_version")
    if version != SCHEMA_VERSION:
        raise UserError(f"{path} has checkpoint format {version}, this version of Sextant reads {SCHEMA_VERSION}")
    return found
