r"""Error of a classifier under corruption, by itself and beside a baseline.

With :math:`E_{c,s}` the error (share of wrong predictions) under corruption c at severity s, :math:`A_{c,s}` that of a
baseline, and :math:`E_0, A_0` both on clean images,

.. math:: CE_c = \frac{\sum_s E_{c,s}}{\sum_s A_{c,s}}, \qquad
          rCE_c = \frac{\sum_s (E_{c,s} - E_0)}{\sum_s (A_{c,s} - A_0)},

and mCE, mean rCE and E are means over the corruptions of a set. The relative error says how much is *lost* to the
corruption: what is subtracted is the clean *error*, not the accuracy. All values are shares (1 is the baseline's
error); papers print them times 100. Three conventions are in use, whose figures cannot be compared with each other: E
alone over 15 corruptions (RobustBench, AugMix), CE over 15 (ImageNet-C), and CE over 19 (the push-pull paper).

Source: D. Hendrycks, T. Dietterich, "Benchmarking neural network robustness to common corruptions and perturbations",
ICLR 2019, section 4.1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Integer
from numpy import ndarray

if TYPE_CHECKING:
    from sextant.evaluation.corruption_baseline import CorruptionBaseline

#: families of the corruptions of CIFAR-10-C and ImageNet-C; ``extra`` is what its authors kept for validation
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
        severities: error by corruption, one a severity.
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
            ValueError: there is no ``clean``, a key is of another form, or an error is not a share.
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
        """Error by corruption, the mean over its severities."""
        return {name: float(np.mean(errors)) for name, errors in self.severities.items()}

    def mean(self, corruptions: Sequence[str] | None = None) -> float:
        """Mean over severities and then over ``corruptions``, by default all; ``ValueError`` if one is missing."""
        return float(np.mean([self.by_corruption()[name] for name in present(corruptions, self.severities)]))


@dataclass(frozen=True)
class CorruptionScore:
    """What one model scores on a set of corruptions; all are shares, 1 being the baseline's error.

    Attributes:
        baseline: name of the baseline that ``ce`` and ``relative_ce`` are ratios to.
        clean: error on clean images.
        error: mean error over the corruptions.
        mean_ce, mean_relative_ce: mean of ``ce`` and of ``relative_ce``.
        ce, relative_ce: by corruption, in the order of the set.
    """

    baseline: str
    clean: float
    error: float
    mean_ce: float
    mean_relative_ce: float
    ce: Mapping[str, float]
    relative_ce: Mapping[str, float]


def error_rate(predictions: Integer[ndarray, "n"], labels: Integer[ndarray, "n"]) -> float:
    """Share of predictions that are wrong; ``ValueError`` without any or if the lengths differ."""
    if len(labels) == 0 or predictions.shape != labels.shape:
        raise ValueError(f"need one prediction a label and at least one, got {len(predictions)} and {len(labels)}")
    return float(np.mean(predictions != labels))


def corruption_ratio(errors: Sequence[float], baseline: Sequence[float]) -> float:
    """:math:`CE = \\sum_s E_s / \\sum_s A_s` of one corruption; a baseline's mean over severities counts for each.

    Raises:
        ValueError: the severities differ in number, there is none, or the baseline makes no error.
    """
    return relative_corruption_ratio(errors, 0.0, baseline, 0.0)


def relative_corruption_ratio(
    errors: Sequence[float], clean: float, baseline: Sequence[float], baseline_clean: float
) -> float:
    """:math:`rCE = \\sum_s (E_s - E_0) / \\sum_s (A_s - A_0)` of one corruption.

    It is undefined, and may change its sign, where the corruption does not hurt the baseline.

    Raises:
        ValueError: the severities differ in number, there is none, or the baseline loses nothing.
    """
    if len(baseline) not in (1, len(errors)) or not errors:
        raise ValueError(f"{len(errors)} severities need as many of the baseline, or their mean; got {len(baseline)}")
    lost = float(np.mean(baseline)) - baseline_clean
    if lost == 0:
        raise ValueError("the baseline loses nothing under this corruption, there is no ratio to it")
    return (float(np.mean(errors)) - clean) / lost


def corruption_score(
    errors: CorruptionErrors, baseline: "CorruptionBaseline", corruptions: Sequence[str] | None = None
) -> CorruptionScore:
    """E, mCE and mean relative CE of a model over a set of corruptions, beside a baseline.

    Args:
        corruptions: names of the set, such as :data:`BENCHMARK_15`; by default all that the model was tested on.

    Raises:
        ValueError: the model or the baseline lacks a corruption of the set.
    """
    names = present(corruptions, errors.severities)
    present(names, baseline.errors)
    ce, relative = {}, {}
    for name in names:
        own, other = errors.severities[name], baseline.errors[name]
        ce[name] = corruption_ratio(own, other)
        relative[name] = relative_corruption_ratio(own, errors.clean, other, baseline.clean)
    return CorruptionScore(
        baseline=baseline.name,
        clean=errors.clean,
        error=errors.mean(names),
        mean_ce=float(np.mean(list(ce.values()))),
        mean_relative_ce=float(np.mean(list(relative.values()))),
        ce=ce,
        relative_ce=relative,
    )


def present(corruptions: Sequence[str] | None, found: Mapping[str, object]) -> tuple[str, ...]:
    """``corruptions``, or all that were found; ``ValueError`` with the missing ones, or if there is none at all."""
    names = tuple(found if corruptions is None else corruptions)
    if missing := [name for name in names if name not in found]:
        raise ValueError(f"no error is known for {', '.join(missing)}; there is one for {', '.join(found)}")
    if not names:
        raise ValueError("a mean needs at least one corruption")
    return names
