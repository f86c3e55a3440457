"""Results of a classifier under corruptions besides accuracies: relative errors, flip probabilities, figures."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import UInt8
from torch import Tensor, nn

from sextant.corruptions import Condition, CorruptionSuite, PerturbationSuite, Protocol
from sextant.evaluation import (
    ALEXNET_CIFAR10_C,
    ALEXNET_IMAGENET_C,
    CORRUPTION_FAMILIES,
    CorruptionBaseline,
    CorruptionErrors,
    corruption_score,
)
from sextant.evaluation.flips import (
    BENCHMARK_PERTURBATIONS,
    flip_probability,
    is_noise,
    mean_flip_probability,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sextant.chapters.classification.result import ClassificationResult

#: baselines by which the corruption errors of a set are divided
BASELINES: Mapping[str, CorruptionBaseline] = {"cifar10_c": ALEXNET_CIFAR10_C, "imagenet_c": ALEXNET_IMAGENET_C}
#: images on a sheet, and conditions above which it shows one severity of each corruption
SHEET_IMAGES, SHEET_CONDITIONS = 10, 20
SEVERITIES = 5


def errors_of(accuracy: Mapping[str, float], protocol: Protocol) -> CorruptionErrors:
    """Errors under the corruptions of a published set, from accuracies by condition key."""
    of_set = {
        key: value for key, value in accuracy.items() if key == "clean" or key.rpartition("/")[0] in protocol.severities
    }
    return CorruptionErrors.of_conditions({key: 1 - value for key, value in of_set.items()})


def condition_metrics(result: "ClassificationResult", suite: CorruptionSuite) -> dict[str, float]:
    """``test/accuracy/<condition>`` with the errors of a published set, or the flip probabilities of perturbations."""
    accuracy = result.accuracy()
    if isinstance(suite, PerturbationSuite):
        return {"test/accuracy/clean": accuracy["clean"]} | flip_metrics(result, suite)
    named = {f"test/accuracy/{key}": value for key, value in accuracy.items()}
    return named | corruption_metrics(accuracy, suite)


def flip_metrics(result: "ClassificationResult", suite: PerturbationSuite) -> dict[str, float]:
    """``test/flip_probability/<perturbation>``, and ``mean`` if all ten of the benchmark are present."""
    found = {}
    for name in suite.corruptions:
        frames = np.stack([result.predictions[condition.key] for condition in suite.sequence(name)], axis=1)
        found[name] = flip_probability(frames, against_first=is_noise(name))
    if set(BENCHMARK_PERTURBATIONS) <= set(found):
        found["mean"] = mean_flip_probability(found)
    return {f"test/flip_probability/{name}": value for name, value in found.items()}


def corruption_metrics(accuracy: Mapping[str, float], suite: CorruptionSuite) -> dict[str, float]:
    """``test/error/corrupted``, the mean over a published set; with all five severities also mCE and relative mCE.

    The latter are shares: 1 is the error of the set's baseline.
    """
    if suite.protocol is None:
        return {}
    errors = errors_of(accuracy, suite.protocol)
    metrics = {"test/error/clean": errors.clean, "test/error/corrupted": errors.mean()}
    baseline = BASELINES.get(suite.protocol.set)
    whole = all(len(levels) == SEVERITIES for levels in errors.severities.values())
    if baseline is not None and whole and set(errors.severities) <= set(baseline.errors):
        score = corruption_score(errors, baseline)
        metrics |= {"test/mce": score.mean_ce, "test/relative_mce": score.mean_relative_ce}
    return metrics


def sheet_conditions(suite: CorruptionSuite) -> list[Condition]:
    """All conditions, or if there are many, the clean images and the middle severity of each corruption."""
    conditions = suite.conditions()
    if len(conditions) <= SHEET_CONDITIONS:
        return conditions
    middle = [Condition(name, list(c.levels)[len(c.levels) // 2]) for name, c in suite.corruptions.items()]
    return [Condition(), *middle]


def result_figures(
    result: "ClassificationResult",
    suite: CorruptionSuite,
    network: nn.Module,
    classes: tuple[str, ...],
    test_images: UInt8[Tensor, "n c h w"],
) -> "Iterator[tuple[str, Figure]]":
    """Yield accuracy by severity or a heat map of errors, confusions, corrupted inputs, and first-layer kernels."""
    from sextant.chapters.classification.figures import corruption_heatmap, first_kernels, severity_curves
    from sextant.figures.confusion_matrix import confusion_matrix
    from sextant.figures.gallery import contact_sheet

    accuracy = result.accuracy()
    if suite.protocol is not None:
        errors = errors_of(accuracy, suite.protocol)
        yield (
            "corruption_heatmap",
            corruption_heatmap(errors.severities, clean=errors.clean, families=CORRUPTION_FAMILIES, title="this run"),
        )
    elif suite.corruptions:
        levels = {name: [float(v) for v in c.levels] for name, c in suite.corruptions.items()}
        yield "severity_curves", severity_curves(levels, {"this run": accuracy})
    yield "confusion_matrix", confusion_matrix(result.labels, result.predictions["clean"], classes)
    shown = torch.from_numpy(result.indices[:SHEET_IMAGES])
    images = test_images[shown].float() / 255
    rows = {c.key: suite.corrupt(images, shown, c).numpy() for c in sheet_conditions(suite)}
    chosen = {key: result.predictions[key][: len(shown)] for key in rows}
    yield "contact_sheet", contact_sheet(rows, chosen, result.labels[: len(shown)], classes)
    kernels = first_kernels(network)
    if kernels is not None:
        yield "first_kernels", kernels
