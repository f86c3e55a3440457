"""The report of a recognition test: a table of methods, prototypes, filters, confusions and errors."""

import copy
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Int64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.chapters.cosfire.methods import METHODS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sextant.chapters.cosfire.estimator import CosfireEstimator
    from sextant.chapters.cosfire.task import RecognitionResult
    from sextant.data.examples import ExampleData
    from sextant.layers.cosfire import Cosfire

#: images on a sheet
SHEET = 40
#: number of filters drawn
DRAWN = 3


def method_table(result: "RecognitionResult") -> list[dict[str, str]]:
    """One row per method, the best first."""
    found = sorted(result.accuracy().items(), key=lambda item: -item[1])
    count = len(result.labels)
    return [
        {
            "method": method,
            "what": METHODS[method],
            "accuracy, %": f"{100 * share:.2f}",
            "errors": f"{round((1 - share) * count):,} of {count:,}",
            **{name: f"{100 * result.accuracy_under(name)[method]:.1f}" for name in result.conditions},
        }
        for method, share in found
    ]


def recognition_figures(
    estimator: "CosfireEstimator", result: "RecognitionResult", data: "ExampleData"
) -> "Iterator[tuple[str, Figure]]":
    """Yield prototypes, filters and their responses, and the confusions and errors of the first method."""
    from sextant.chapters.cosfire.figures import recognition_errors
    from sextant.figures.confusion_matrix import confusion_matrix

    images = data.split("test").images[:: data.test_every]
    yield "prototypes", _prototypes(estimator)
    for number, name in file_names(estimator.classes, estimator.configured_from().labels).items():
        yield f"filter_{name}", _filter(estimator, number)
        yield f"response_{name}", _response(estimator, number, images, result.labels)
    method, answers = next(iter(result.answers.items()))
    if len(estimator.classes) <= 100:
        yield "confusion_matrix", confusion_matrix(result.labels, answers, estimator.classes)
    errors = recognition_errors(images.numpy(), result.labels, answers, estimator.classes, title=method)
    if errors is not None:
        yield f"errors_{method}", errors


def first_filters(labels: Int64[Tensor, "f"]) -> list[int]:
    """The first filter of each of a few classes, evenly spaced among all classes."""
    classes, of_filter = torch.unique(labels, return_inverse=True)
    rows = np.unique(np.linspace(0, len(classes) - 1, min(DRAWN, len(classes))).round().astype(int))
    return [int((of_filter == row).nonzero()[0, 0]) for row in rows.tolist()]


def file_names(classes: Sequence[str], labels: Int64[Tensor, "f"]) -> dict[int, str]:
    """The name of the class of each filter drawn, as part of a file name, by the filter's number.

    >>> file_names(["a b", "a_b", "猫"], torch.tensor([0, 1, 2]))
    {0: 'a_b_0', 1: 'a_b_1', 2: '猫'}
    """
    names = {number: re.sub(r"[^\w-]+", "_", classes[int(labels[number])]) for number in first_filters(labels)}
    twice = {name for name, count in Counter(names.values()).items() if count > 1}
    return {number: f"{name}_{number}" if name in twice else name for number, name in names.items()}


def _prototypes(estimator: "CosfireEstimator") -> "Figure":
    from sextant.figures.gallery import gallery

    kept, pictures = estimator.configured_from(), estimator.prototypes["pictures"].cpu().numpy()
    rows = np.unique(np.linspace(0, len(pictures) - 1, min(SHEET, len(pictures))).astype(int))
    titles = [
        f"{estimator.classes[kept.labels[row]]} at {kept.points[row, 0]:.0f},{kept.points[row, 1]:.0f}" for row in rows
    ]
    return gallery([_picture(pictures[row]) for row in rows], titles)


def _filter(estimator: "CosfireEstimator", number: int) -> "Figure":
    from sextant.chapters.cosfire.figures import cosfire_filter

    kept, filters = estimator.configured_from(), on_processor(estimator.filters)
    example = estimator.prototypes["pictures"][number].cpu().float() / 255
    x, y = kept.points[number].tolist()
    title = f"{estimator.classes[int(kept.labels[number])]}: {len(filters.tuples(number))} parts"
    return cosfire_filter(filters, example, (x, y), number=number, title=title)


def _response(
    estimator: "CosfireEstimator", number: int, images: UInt8[Tensor, "n c h w"], labels: Int64[ndarray, "n"]
) -> "Figure":
    """The response over a test image of the filter's class, or over the first image if there is none."""
    from sextant.chapters.cosfire.figures import cosfire_responses

    kept, filters = estimator.configured_from(), estimator.filters
    alike = np.flatnonzero(labels == int(kept.labels[number]))
    row = int(alike[0]) if len(alike) else 0
    with torch.no_grad():
        response = filters(estimator.seen(images[row : row + 1]).to(filters.rho.device).float() / 255)[0, number].cpu()
    score, place = float(response.max()), int(response.argmax())
    height, width = images.shape[-2:]
    point = (
        (place % response.shape[1] + 0.5) * width / response.shape[1] - 0.5,
        (place // response.shape[1] + 0.5) * height / response.shape[0] - 0.5,
        score,
    )
    own = float(estimator.prototypes["own"][number])
    title = f"filter of {estimator.classes[int(kept.labels[number])]} over a {estimator.classes[int(labels[row])]}"
    picture = images[row].permute(1, 2, 0).numpy()
    return cosfire_responses(
        picture,
        response.double().numpy(),
        [point],
        strongest=max(own, score),
        title=f"{title}; own prototype {own:.2f}",
    )


def on_processor(filters: "Cosfire") -> "Cosfire":
    """The filters, or a copy of them on the CPU, where figures are drawn."""
    return filters if filters.rho.device.type == "cpu" else copy.deepcopy(filters).cpu()


def _picture(image: np.ndarray) -> np.ndarray:
    return image[0] if len(image) == 1 else image.transpose(1, 2, 0)
