"""Results of a classifier under corruptions besides accuracies: relative errors, flip probabilities, figures."""

from collections.abc import Iterator, Mapping, Sequence
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
from sextant.evaluation.headline import over_severities

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


def baseline_of(name: str | None, severities: Mapping[str, Sequence[float]]) -> CorruptionBaseline | None:
    """The baseline of a set of corruptions, for all five severities of corruptions that it has errors of; or None.

    Args:
        name: key of the set.
        severities: severities, or one value for each, by corruption.
    """
    baseline = BASELINES.get(name or "")
    whole = all(len(levels) == SEVERITIES for levels in severities.values())
    return baseline if baseline is not None and whole and set(severities) <= set(baseline.errors) else None


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
    baseline = baseline_of(suite.protocol.set, errors.severities)
    if baseline is not None:
        score = corruption_score(errors, baseline)
        metrics |= {"test/mce": score.mean_ce, "test/relative_mce": score.mean_relative_ce}
    return metrics


def corruption_table(result: "ClassificationResult", suite: CorruptionSuite) -> list[dict[str, str]]:
    """Error, CE and relative CE (in %), ECE and NLL: clean, by corruption of a published set, and their means.

    Empty without a published set. The mean of the CEs is the mCE; a set or choice of severities without a baseline has
    neither CE. ECE and NLL are means over severities.
    """
    if suite.protocol is None:
        return []
    errors, trust = errors_of(result.accuracy(), suite.protocol), result.trust()
    baseline = baseline_of(suite.protocol.set, errors.severities)
    score = None if baseline is None else corruption_score(errors, baseline)
    told = errors.by_corruption()
    columns = [("ECE", over_severities(trust, "test/ece/"), 4), ("NLL", over_severities(trust, "test/nll/"), 3)]

    def row(name: str, error: float, ratios: tuple[float, ...], over: Sequence[str]) -> dict[str, str]:
        found = {"corruption": name, "error %": f"{100 * error:.1f}"}
        if score is not None:
            found |= {key: f"{100 * ratio:.1f}" for key, ratio in zip(("CE %", "relative CE %"), ratios, strict=False)}
        for title, means, digits in columns:
            found[title] = f"{np.mean([means.get(each, np.nan) for each in over]):.{digits}f}"
        return found

    rows = [row("clean", errors.clean, (), ["clean"])]
    for name, error in told.items():
        rows.append(row(name, error, () if score is None else (score.ce[name], score.relative_ce[name]), [name]))
    ratios = () if score is None else (score.mean_ce, score.mean_relative_ce)
    return [*rows, row("mean", errors.mean(), ratios, list(told))]


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
