"""Finding the first value of a training step that is not finite, and keeping what reproduces it."""

import dataclasses
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import Callback
from torch import Tensor, nn

from sextant.atomic_files import read_json, write_atomically, write_json
from sextant.errors import LossNotFiniteError, UserError
from sextant.torch_file import load_verified, save_sealed

#: folder in a run's directory, and its files
FOLDER, FINDING, STEP = "nan", "nan.json", "step.pt"
OURS = "sextant."
#: kinds of values that are kept as they are; a subclass, such as NumPy's float64, could not be read again
PLAIN = (type(None), bool, int, float, str)


@dataclasses.dataclass(frozen=True)
class Finding:
    """The first value that was not finite.

    Attributes:
        where: what it was in, such as ``output of network.conv1 (Conv2d)``.
        step, epoch, batch: when, counted from 0.
    """

    where: str
    step: int
    epoch: int
    batch: int

    def __str__(self) -> str:
        return f"the {self.where} is not finite at step {self.step} (epoch {self.epoch}, batch {self.batch})"


@dataclasses.dataclass(frozen=True)
class ModuleCall:
    """One call of a module: its path, its class, and the range of its output; nan if a value is not finite."""

    path: str
    kind: str
    shape: tuple[int, ...]
    low: float
    high: float


class NotFiniteError(LossNotFiniteError):
    """A value in a training step is not finite."""


class WatchFinite(Callback):
    """Checks every module's output, the loss and the gradients of every training step.

    Args:
        found: called with the finding, the module, the batch and torch's random state before the step; it raises.
        random: random state to set before a step, for a replay.
        calls: gets every call of a module, for a replay.
    """

    def __init__(
        self,
        found: Callable[[Finding, pl.LightningModule, Any, Tensor], None],
        random: Tensor | None = None,
        calls: list[ModuleCall] | None = None,
    ):
        self.found, self.random, self.calls = found, random, calls
        self._hooks: list[Any] = []
        self._now: tuple[pl.LightningModule, Any, Tensor, tuple[int, int, int]] | None = None

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Hook every module but the outermost."""
        for path, module in pl_module.named_modules():
            if path:
                self._hooks.append(module.register_forward_hook(self._hook(path)))

    def teardown(self, trainer: pl.Trainer, pl_module: pl.LightningModule, stage: str) -> None:
        """Remove the hooks."""
        for hook in self._hooks:
            hook.remove()
        self._hooks, self._now = [], None

    def on_train_batch_start(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Remember the batch and the random state."""
        if self.random is not None:
            torch.set_rng_state(self.random)
        self._now = (pl_module, batch, torch.get_rng_state(), (trainer.global_step, trainer.current_epoch, batch_idx))

    def on_train_batch_end(self, *args: Any, **kwargs: Any) -> None:
        """Ignore what is computed between steps, as in validation."""
        self._now = None

    def on_before_backward(self, trainer: pl.Trainer, pl_module: pl.LightningModule, loss: Tensor) -> None:
        """Check the loss, which a function after the last module may have spoilt."""
        if not _finite(loss):
            self._tell("training loss")

    def on_after_backward(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Check the gradients; the last parameter is the first that the backward pass reaches."""
        if trainer.precision == "16-mixed":  # its scaled gradients overflow now and then on purpose
            return
        bad = [n for n, p in pl_module.named_parameters() if p.grad is not None and not _finite(p.grad)]
        if bad:
            more = f" and of {len(bad) - 1} more" if len(bad) > 1 else ""
            self._tell(f"gradient of {bad[-1]}{more}")

    def _hook(self, path: str) -> Callable[[nn.Module, tuple[Any, ...], Any], None]:
        def hook(module: nn.Module, inputs: tuple[Any, ...], output: Any) -> None:
            if self._now is None:
                return
            named = f"{path} ({type(module).__name__})"
            if self.calls is not None and isinstance(output, Tensor) and output.is_floating_point() and output.numel():
                ends = output.detach().aminmax()
                shape = tuple(output.shape)
                self.calls.append(ModuleCall(path, type(module).__name__, shape, float(ends.min), float(ends.max)))
            if not _finite(inputs):
                self._tell(f"input of {named}")
            if not all(map(_finite, module.parameters(recurse=False))):
                self._tell(f"weight of {named}")
            if not _finite(output):
                self._tell(f"output of {named}")

        return hook

    def _tell(self, where: str) -> None:
        assert self._now is not None
        module, batch, random, when = self._now
        self._now = None
        self.found(Finding(where, *when), module, batch, random)


def _finite(value: Any) -> bool:
    if isinstance(value, Tensor):
        return not (value.is_floating_point() or value.is_complex()) or bool(value.detach().isfinite().all())
    if isinstance(value, list | tuple):
        return all(map(_finite, value))
    if isinstance(value, Mapping):
        return all(map(_finite, value.values()))
    return True


def keep_step(directory: Path, command: str) -> Callable[[Finding, pl.LightningModule, Any, Tensor], None]:
    """A function for :class:`WatchFinite` that writes the step into the folder of a run and stops training.

    Args:
        directory: the run's.
        command: what replays the step.

    Raises:
        NotFiniteError: always; it names the step, the module, and the command that replays it or why none can.
    """

    def keep(finding: Finding, module: pl.LightningModule, batch: Any, random: Tensor) -> None:
        folder = directory / FOLDER
        (folder / STEP).unlink(missing_ok=True)  # of another finding
        write_json(folder / FINDING, dataclasses.asdict(finding))
        fix = f"Its batch and weights are kept: {command}"
        try:
            step = {"batch": packed(batch), "weights": dict(module.state_dict()), "random": random}
            write_atomically(folder / STEP, lambda file: save_sealed(step, file))
            read_step(directory)
        except Exception as error:  # whatever a batch holds, the finding counts
            (folder / STEP).unlink(missing_ok=True)
            why = getattr(error, "problem", None) or next(iter(str(error).splitlines()), type(error).__name__)
            fix = f"Its batch could not be kept, so the step cannot be replayed: {why}"
        raise NotFiniteError(f"{finding}, and the run was stopped", fix)

    return keep


def read_step(directory: Path) -> tuple[Finding, dict[str, Any]]:
    """What :func:`keep_step` wrote: the finding, and the batch, the weights and the random state.

    Raises:
        UserError: the run has none, or a file is damaged.
    """
    folder = directory / FOLDER
    told: Any = read_json(folder / FINDING)
    try:
        finding = Finding(**told)
        if not (folder / STEP).is_file():
            raise UserError(f"{folder}: {finding}, but its batch was not kept", "Training told why.")
        step = load_verified(folder / STEP)
        return finding, {**step, "batch": unpacked(step["batch"])}
    except UserError:
        raise
    except Exception as error:  # a damaged file can fail in any way
        if not folder.is_dir():
            raise UserError(
                f"run={directory}: it has no step to replay",
                "sextant train debug=nan keeps the first that is not finite.",
            ) from None
        raise UserError(f"{folder} cannot be read: {error}", "Train again with debug=nan.") from None


def packed(value: Any) -> Any:
    """A batch as tensors and plain containers; our data classes become mappings that name them, NumPy arrays tensors.

    >>> from sextant.data.batches import Batch
    >>> packed(Batch(torch.zeros(1), torch.ones(1), torch.ones(1)))["class"]
    'sextant.data.batches.Batch'

    Raises:
        UserError: the batch holds something else, such as a named tuple or a data class of others.
    """
    kind = type(value)
    if dataclasses.is_dataclass(kind) and kind.__module__.startswith(OURS):
        inner = {field.name: packed(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {"class": f"{kind.__module__}.{kind.__qualname__}", "fields": inner}
    if kind is list:
        return [packed(each) for each in value]
    if kind is tuple:
        return {"tuple": [packed(each) for each in value]}
    if isinstance(value, Mapping) and all(type(key) in PLAIN for key in value):
        return {"mapping": {key: packed(each) for key, each in value.items()}}
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biufc":
        return {"numpy": torch.from_numpy(np.array(value)), "scalar": isinstance(value, np.generic)}
    if kind in PLAIN or isinstance(value, Tensor):
        return value
    raise UserError(f"debug=nan cannot keep a batch that holds a {kind.__name__}", "Leave debug= out.")


def unpacked(value: Any) -> Any:
    """The inverse of :func:`packed`. Only data classes of this package are built."""
    if isinstance(value, list):
        return [unpacked(each) for each in value]
    if not isinstance(value, Mapping):
        return value
    if "mapping" in value:
        return {key: unpacked(each) for key, each in value["mapping"].items()}
    if "tuple" in value:
        return tuple(map(unpacked, value["tuple"]))
    if "numpy" in value:
        return value["numpy"].numpy()[() if value["scalar"] else ...]
    module, _, name = str(value["class"]).rpartition(".")
    kind = getattr(import_module(module), name) if module.startswith(OURS) else None
    if not (isinstance(kind, type) and dataclasses.is_dataclass(kind) and kind.__module__.startswith(OURS)):
        raise UserError(f"a kept batch is of class {value['class']}, which is not one of Sextant's", "Train again.")
    return kind(**{key: unpacked(each) for key, each in value["fields"].items()})
