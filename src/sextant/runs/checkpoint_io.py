"""Atomic writing and safe reading of checkpoints for Lightning."""

from pathlib import Path
from typing import Any

from pytorch_lightning.plugins.io import CheckpointIO

from sextant.atomic_files import write_atomically
from sextant.errors import UserError
from sextant.runs.checkpoint import load_checkpoint
from sextant.torch_file import save_sealed


class AtomicCheckpointIO(CheckpointIO):
    """Saves a checkpoint beside the previous one and renames it, so that a crash or a full disk loses nothing."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any | None = None) -> None:
        """Write ``checkpoint`` to ``path``, with its digest.

        Raises:
            UserError: the disk is full or not writable; the previous checkpoint is kept.
        """
        try:
            write_atomically(Path(path), lambda file: save_sealed(checkpoint, file))
        except (OSError, RuntimeError) as error:  # torch wraps an OSError of the file
            cause = error.__cause__ or error.__context__ or error
            raise UserError(
                f"could not save the checkpoint {path}: {cause}",
                "The previous checkpoint is intact. Free some space and run the same command: it resumes from there.",
            ) from error

    def load_checkpoint(self, path: Any, map_location: Any = None, weights_only: bool | None = True) -> dict[str, Any]:
        """Read a checkpoint; see :func:`~sextant.runs.checkpoint.load_checkpoint`."""
        return load_checkpoint(Path(path))

    def remove_checkpoint(self, path: Any) -> None:
        """Delete a checkpoint."""
        Path(path).unlink(missing_ok=True)
