"""Learning-rate schedules over a run, given in fractions of it so that a shorter run keeps the shape."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pytorch_lightning as pl
import torch
from torch import nn
from torch.optim import SGD, Optimizer
from torch.optim.lr_scheduler import LambdaLR

from sextant.models.fine_tuning import parameter_groups

OptimizerFactory = Callable[[Iterable[nn.Parameter] | list[dict[str, Any]]], Optimizer]
#: factor on the learning rate as a function of the share of epochs done
Schedule = Callable[[float], float]


def nothing_to_optimize() -> Optimizer:
    """An optimiser for modules without gradients: Lightning writes no checkpoint unless an optimiser has stepped."""
    return SGD([torch.zeros(1, requires_grad=True)], lr=0.0)


def optimizers(module: pl.LightningModule, factory: OptimizerFactory | None, schedule: Schedule | None) -> Any:
    """The return value of ``configure_optimizers``; None for a module that is only evaluated."""
    if factory is None:
        return None
    optimizer = factory(module.parameters())
    groups = parameter_groups(module.parameters(), optimizer.defaults["lr"])
    if len(groups) > 1:  # a pretrained network whose layers have their own learning rates
        optimizer = factory(groups)
    if schedule is None:
        return optimizer
    epochs = module.trainer.max_epochs or 1
    rates = LambdaLR(optimizer, lambda epoch: schedule(epoch / epochs))
    return {"optimizer": optimizer, "lr_scheduler": {"scheduler": rates, "interval": "epoch"}}


def log_training_loss(module: pl.LightningModule, loss: float | None, **others: float) -> None:
    """Log the mean loss of the last steps, if due, with the learning rate and ``others``."""
    if loss is not None and module.logger is not None:
        rate = module.trainer.optimizers[0].param_groups[0]["lr"]
        metrics = {"loss": loss, "learning_rate": rate, **others}
        for logger in module.loggers:
            logger.log_metrics({f"train/{name}": of for name, of in metrics.items()}, step=module.global_step)


TOLERANCE = 1e-6  # a fraction written with six digits, such as 0.666667, refers to the nearest epoch


@dataclass(frozen=True)
class ConstantRate:
    """The factor is 1 throughout."""

    def __call__(self, progress: float) -> float:
        """Factor on the learning rate at ``progress`` in [0, 1]."""
        return 1.0


@dataclass(frozen=True)
class StepDecay:
    """Multiply the rate by ``factor`` at each of the fractions ``at``: ``factor ** #{a in at: a <= progress}``."""

    at: Sequence[float] = (1 / 3, 2 / 3)
    factor: float = 0.1

    def __call__(self, progress: float) -> float:
        """Factor on the learning rate at ``progress`` in [0, 1]."""
        return self.factor ** sum(progress >= fraction - TOLERANCE for fraction in self.at)


@dataclass(frozen=True)
class CosineDecay:
    """``(1 + cos(π progress)) / 2``."""

    def __call__(self, progress: float) -> float:
        """Factor on the learning rate at ``progress`` in [0, 1]."""
        return (1 + math.cos(math.pi * progress)) / 2
