"""Learning-rate schedules over a run, given in fractions of it so that a shorter run keeps the shape."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

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
