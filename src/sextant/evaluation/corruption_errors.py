r"""Errors of a classifier under corruption, alone and relative to those of a baseline.

An error is the share of wrong predictions, by corruption and severity. With :math:`E_{c,s}` the error under corruption
c at severity s, :math:`A_{c,s}` that of a baseline, and :math:`E_0, A_0` both on clean images,

.. math:: CE_c = \frac{\sum_s E_{c,s}}{\sum_s A_{c,s}}, \qquad
          rCE_c = \frac{\sum_s (E_{c,s} - E_0)}{\sum_s (A_{c,s} - A_0)},

and mCE, mean rCE and E are means over the corruptions of a set. The relative error measures how much is *lost* to the
corruption: the clean *error* is subtracted, not the accuracy. All values are shares (1 is the baseline's error); papers
print them times 100. Three conventions are in use, whose figures are not comparable: E alone over 15 corruptions
(RobustBench, AugMix), CE over 15 (ImageNet-C), and CE over 19 (the push-pull paper).

Source: D. Hendrycks, T. Dietterich, "Benchmarking neural network robustness to common corruptions and perturbations",
ICLR 2019, section 4.1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

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


def present(corruptions: Sequence[str] | None, found: Mapping[str, object]) -> tuple[str, ...]:
    """``corruptions``, or all that were found; ``ValueError`` with the missing ones, or if there is none at all.

    >>> present(None, {"fog": 0.2, "snow": 0.3})
    ('fog', 'snow')
    """
    names = tuple(found if corruptions is None else corruptions)
    if missing := [name for name in names if name not in found]:
        raise ValueError(f"no error for {', '.join(missing)}; available: {', '.join(found)}")
    if not names:
        raise ValueError("a mean needs at least one corruption")
    return names


@dataclass(frozen=True)
class CorruptionBaseline:
    """Reference errors that others are compared with, as shares in [0, 1].

    Attributes:
        name: its name in reports.
        source: where its errors come from.
        clean: error on clean images.
        errors: by corruption: one per severity, or only their mean, as printed in papers.
    """

    name: str
    source: str
    clean: float
    errors: Mapping[str, tuple[float, ...]]


#: AlexNet of the push-pull paper on CIFAR-10-C, 19 corruptions
ALEXNET_CIFAR10_C = CorruptionBaseline(
    "AlexNet on CIFAR-10-C",
    "Strisciuglio et al., Neural Computing and Applications 32, 2020, tables 2 and 3",
    clean=0.1387,
    errors={
        "gaussian_noise": (0.3844,),
        "shot_noise": (0.3182,),
        "impulse_noise": (0.4613,),
        "defocus_blur": (0.2353,),
        "glass_blur": (0.4097,),
        "motion_blur": (0.2932,),
        "zoom_blur": (0.2689,),
        "snow": (0.2694,),
        "frost": (0.2826,),
        "fog": (0.3031,),
        "brightness": (0.1784,),
        "contrast": (0.4677,),
        "elastic_transform": (0.2225,),
        "pixelate": (0.1836,),
        "jpeg_compression": (0.1848,),
        "speckle_noise": (0.3126,),
        "gaussian_blur": (0.2778,),
        "spatter": (0.2519,),
        "saturate": (0.2215,),
    },
)
#: AlexNet of the benchmark's authors on ImageNet-C, its 15 corruptions
ALEXNET_IMAGENET_C = CorruptionBaseline(
    "AlexNet on ImageNet-C",
    "Hendrycks & Dietterich, ICLR 2019; digits as in https://github.com/hendrycks/robustness",
    clean=0.435,
    errors={
        "gaussian_noise": (0.886428,),
        "shot_noise": (0.894468,),
        "impulse_noise": (0.922640,),
        "defocus_blur": (0.819880,),
        "glass_blur": (0.826268,),
        "motion_blur": (0.785948,),
        "zoom_blur": (0.798360,),
        "snow": (0.866816,),
        "frost": (0.826572,),
        "fog": (0.819324,),
        "brightness": (0.564592,),
        "contrast": (0.853204,),
        "elastic_transform": (0.646056,),
        "pixelate": (0.717840,),
        "jpeg_compression": (0.606500,),
    },
)


@dataclass(frozen=True)
class CorruptionScore:
    """The scores of one model on a set of corruptions; ratios are shares, 1 being the baseline's error.

    Attributes:
        error: mean error over the corruptions.
        mean_ce, mean_relative_ce: mean of ``ce`` and of ``relative_ce``.
        ce, relative_ce: by corruption, in the order of the set.
    """

    error: float
    mean_ce: float
    mean_relative_ce: float
    ce: Mapping[str, float]
    relative_ce: Mapping[str, float]


def corruption_ratio(errors: Sequence[float], baseline: Sequence[float]) -> float:
    """:math:`CE = \\sum_s E_s / \\sum_s A_s` of one corruption; the baseline may be given as its mean over severities.

    Raises:
        ValueError: the numbers of severities differ, there are none, or the baseline makes no error.

    >>> round(corruption_ratio([0.2, 0.4], [0.3, 0.5]), 2), round(corruption_ratio([0.2, 0.4], [0.4]), 2)
    (0.75, 0.75)
    """
    return relative_corruption_ratio(errors, 0.0, baseline, 0.0)


def relative_corruption_ratio(
    errors: Sequence[float], clean: float, baseline: Sequence[float], baseline_clean: float
) -> float:
    """:math:`rCE = \\sum_s (E_s - E_0) / \\sum_s (A_s - A_0)` of one corruption.

    It is undefined, and may change sign, if the corruption does not increase the baseline's error.

    Raises:
        ValueError: the numbers of severities differ, there are none, or the baseline's loss is zero.

    >>> round(relative_corruption_ratio([0.2, 0.4], 0.1, [0.3, 0.5], 0.1), 2)  # (0.1 + 0.3) / (0.2 + 0.4)
    0.67
    """
    if len(baseline) not in (1, len(errors)) or not errors:
        raise ValueError(f"{len(errors)} severities need as many baseline errors, or their mean; got {len(baseline)}")
    lost = float(np.mean(baseline)) - baseline_clean
    if lost == 0:
        raise ValueError("the baseline's loss under this corruption is zero, so the ratio is undefined")
    return (float(np.mean(errors)) - clean) / lost


def corruption_score(
    errors: CorruptionErrors, baseline: CorruptionBaseline, corruptions: Sequence[str] | None = None
) -> CorruptionScore:
    """E, mCE and mean relative CE of a model over a set of corruptions, relative to a baseline.

    Args:
        errors: of the model, as shares.
        baseline: its errors are the denominators of the ratios; see the module.
        corruptions: names of the set, such as :data:`BENCHMARK_15`; by default all that the model was tested on.

    Raises:
        ValueError: the model or the baseline lacks a corruption of the set.

    >>> own = CorruptionErrors(0.1, {"fog": (0.2, 0.4)})  # clean, and at two severities
    >>> score = corruption_score(own, CorruptionBaseline("mine", "run 12", 0.1, {"fog": (0.3, 0.5)}))
    >>> round(score.mean_ce, 2), round(score.mean_relative_ce, 2)  # 0.6 / 0.8, and 0.4 / 0.6 without the clean error
    (0.75, 0.67)
    """
    names = present(corruptions, errors.severities)
    present(names, baseline.errors)
    ce, relative = {}, {}
    for name in names:
        own, other = errors.severities[name], baseline.errors[name]
        ce[name] = corruption_ratio(own, other)
        relative[name] = relative_corruption_ratio(own, errors.clean, other, baseline.clean)
    return CorruptionScore(
        error=errors.mean(names),
        mean_ce=float(np.mean(list(ce.values()))),
        mean_relative_ce=float(np.mean(list(relative.values()))),
        ce=ce,
        relative_ce=relative,
    )
