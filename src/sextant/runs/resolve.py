"""Finding a run by its MLflow id, its directory, its checkpoint or its name in the zoo."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from sextant.errors import UserError
from sextant.runs.directory import RunDirectory, all_runs
from sextant.user_files import absent
from sextant.zoo import PREFIX, model_file

#: before the path of an ONNX file, and its end
ONNX, ONNX_SUFFIX = "onnx:", ".onnx"


@dataclass(frozen=True)
class FoundRun:
    """A trained model.

    Attributes:
        checkpoint: its checkpoint.
        directory: its run directory; None for a checkpoint that lies elsewhere.
    """

    checkpoint: Path
    directory: RunDirectory | None

    @property
    def identity(self) -> str:
        """The hash of the checkpoint, which identifies the model whatever its name."""
        return hashlib.sha256(self.checkpoint.read_bytes()).hexdigest()

    def is_own(self, outputs: Path) -> bool:
        """Whether it is a run of this output folder, so its config is the user's own, not a received file's."""
        return self.directory is not None and self.directory.path.resolve().is_relative_to((outputs / "runs").resolve())


def resolve_run(reference: str, outputs: Path, key: str = "run") -> FoundRun:
    """Find the run that ``reference`` names.

    A reference is an MLflow run id, a run directory or its name, a checkpoint file, ``zoo:`` followed by the name of
    a model that comes with the package, or ``onnx:`` followed by the path of a file.

    Args:
        reference: what the user wrote.
        outputs: folder of runs.
        key: key that the user gave it for, for messages.

    Raises:
        UserError: the run does not exist, or it has no checkpoint yet; an unknown run lists the trained runs.
    """
    if reference.startswith(PREFIX):
        return FoundRun(model_file(reference), None)
    path = Path(reference.removeprefix(ONNX)).expanduser()
    if reference.startswith(ONNX) and not (path.suffix == ONNX_SUFFIX and path.is_file()):
        raise UserError(f"{key}={reference}: {absent(path)}", f"{key}={ONNX}<file>{ONNX_SUFFIX}")
    if path.is_file():
        parent = RunDirectory(path.absolute().parent.parent)
        return FoundRun(path.absolute(), parent if parent.state() else None)
    for candidate in (path, outputs / path, outputs / "runs" / path, *outputs.glob(f"runs/*/{reference}")):
        if candidate.is_dir() and RunDirectory(candidate).state():
            return _with_checkpoint(RunDirectory(candidate.absolute()), f"{key}={reference}")
    for directory in all_runs(outputs):
        if reference in directory.tracking_ids():
            return _with_checkpoint(directory, f"{key}={reference}")
    trained = [d.path for d in all_runs(outputs) if _checkpoint(d).is_file()][-8:]
    names = ", ".join(f"{path.parent.name}/{path.name}" for path in trained)
    known = f"Trained runs here: {names}" if names else "There are no trained runs here yet: sextant train makes one"
    raise UserError(f"{key}={reference}: no run, run directory or checkpoint of that name. {known}")


def _with_checkpoint(directory: RunDirectory, said: str) -> FoundRun:
    chosen = _checkpoint(directory)
    if not chosen.is_file():
        raise UserError(f"{said}: {directory.path} has no checkpoint yet", "Run the same training command: it resumes.")
    return FoundRun(chosen, directory)


def _checkpoint(directory: RunDirectory) -> Path:
    """The checkpoint that was tested, or will be."""
    best = (directory.results() or {}).get("test_checkpoint") == "best"
    return directory.best_checkpoint if best else directory.last_checkpoint
