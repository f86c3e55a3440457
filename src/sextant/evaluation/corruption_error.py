"""Error of a classifier under corruption: the share of wrong predictions, by corruption and severity.

Source: D. Hendrycks, T. Dietterich, "Benchmarking neural network robustness to common corruptions and perturbations",
ICLR 2019, section 4.1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Integer
from numpy import ndarray

#: families of the corruptions of CIFAR-10-C and ImageNet-C; ``extra`` holds those that the authors set aside for
#: validation
CORRUPTION_FAMILIES: dict[str, tuple[str, ...]] = {
    "noise": ("gaussian_noise", "shot_noise", "impulse_noise"),
    "blur": ("defocus_blur", "glass_blur", "motion_blur", "zoom_blur"),
    "weather": ("snow", "frost", "fog", "brightness"),
    "digital": ("contrast", "elastic_transform", "pixelate", "jpeg_compression"),
    "extra": ("speckle_noise", "gaussian_blur", "spatter", "saturate"),
}
#: the benchmark's 15 corruptions, as RobustBench and AugMix average
BENCHMARK_15 = tuple(c for family, names in CORRUPTION_FAMILIES.items() if family != "extra" for c in names)
#: with the four extra ones, as the push-pull paper averages
ALL_19 = (*BENCHMARK_15, *CORRUPTION_FAMILIES["extra"])


@dataclass(frozen=True)
class CorruptionErrors:
    """Errors of one model, as shares in [0, 1].

    Attributes:
        clean: error on clean images.
        severities: errors by corruption, one per severity.

    Raises:
        ValueError: an error is not a share, or a corruption has no severity.

    Example:
        >>> errors = CorruptionErrors.of_conditions({"clean": 0.1, "fog/1": 0.2, "fog/2": 0.4, "snow/1": 0.5})
        >>> round(errors.by_corruption()["fog"], 2), round(errors.mean(), 2)  # every corruption counts the same
        (0.3, 0.4)
    """

    clean: float
    severities: Mapping[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        values = [self.clean, *(error for errors in self.severities.values() for error in errors)]
        if not all(0 <= value <= 1 for value in values):
            raise ValueError(f"errors are shares in [0, 1], got values from {min(values)} to {max(values)}")
        if empty := [name for name, errors in self.severities.items() if not errors]:
            raise ValueError(f"corruptions without any severity: {', '.join(empty)}")

    @classmethod
    def of_conditions(cls, errors: Mapping[str, float]) -> "CorruptionErrors":
        """From errors by condition key: ``clean``, and ``corruption/severity`` in ascending order of severity.

        Raises:
            ValueError: there is no ``clean``, a key has a different form, or an error is not a share.
        """
        severities: dict[str, list[tuple[float, float]]] = {}
        for key, error in errors.items():
            name, _, severity = key.rpartition("/")
            if name:
                severities.setdefault(name, []).append((float(severity), error))
            elif key != "clean":
                raise ValueError(f"condition keys are 'clean' and 'corruption/severity', got {key!r}")
        if "clean" not in errors:
            raise ValueError("the error on clean images is missing")
        return cls(errors["clean"], {name: tuple(e for _, e in sorted(pairs)) for name, pairs in severities.items()})

    def by_corruption(self) -> dict[str, float]:
        """Error by corruption, averaged over its severities."""
        return {name: float(np.mean(errors)) for name, errors in self.severities.items()}

    def mean(self, corruptions: Sequence[str] | None = None) -> float:
        """Mean over severities and then over ``corruptions``, by default all; ``ValueError`` if one is missing."""
        return float(np.mean([self.by_corruption()[name] for name in present(corruptions, self.severities)]))


def error_rate(predictions: Integer[ndarray, "n"], labels: Integer[ndarray, "n"]) -> float:
    """Share of wrong predictions; ``ValueError`` if there are none or the lengths differ.

    >>> error_rate(np.array([0, 1, 1, 2]), np.array([0, 1, 2, 2]))
    0.25
    """
    if len(labels) == 0 or predictions.shape != labels.shape:
        raise ValueError(f"need one prediction per label and at least one, got {len(predictions)} and {len(labels)}")
    return float(np.mean(predictions != labels))


def present(corruptions: Sequence[str] | None, found: Mapping[str, object]) -> tuple[str, ...]:
    """``corruptions``, or all that were found; ``ValueError`` with the missing ones, or if there is none at all.

    >>> present(None, {"fog": 0.2, "snow": 0.3})
    ('fog', 'snow')
    """
    names = tuple(found if corruptions is None else corruptions)
    if missing := [name for name in names if name not in found]:
        raise ValueError(f"no error is known for {', '.join(missing)}; there is one for {', '.join(found)}")
    if not names:
        raise ValueError("a mean needs at least one corruption")
    return names
