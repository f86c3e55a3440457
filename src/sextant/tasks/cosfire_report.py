"""What a test of recognition by filters shows: a table of methods, prototypes, confusions and errors."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from sextant.tasks.recognition_methods import METHODS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sextant.data.examples import ExampleData
    from sextant.tasks.cosfire import CosfireRecognition, RecognitionResult

#: images on a sheet
SHEET = 40


def method_table(result: "RecognitionResult") -> list[dict[str, str]]:
    """One row a method, the best first."""
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


def recognition_figures(module: "CosfireRecognition", data: "ExampleData") -> "Iterator[tuple[str, Figure]]":
    """Prototypes, the confusions of the first method and the images it gets wrong."""
    from sextant.figures.confusion_matrix import confusion_matrix
    from sextant.figures.gallery import gallery

    assert module.result is not None
    kept, result = module.configured_from(), module.result
    pictures = module.prototypes["pictures"].numpy()
    rows = np.unique(np.linspace(0, len(pictures) - 1, min(SHEET, len(pictures))).astype(int))
    titles = [
        f"{module.classes[kept.labels[row]]} at {kept.points[row, 0]:.0f},{kept.points[row, 1]:.0f}" for row in rows
    ]
    yield "prototypes", gallery([_picture(pictures[row]) for row in rows], titles)
    method, answers = next(iter(result.answers.items()))
    if len(module.classes) <= 100:
        yield "confusion_matrix", confusion_matrix(result.labels, answers, module.classes)
    wrong = np.flatnonzero(answers != result.labels)[:SHEET]
    if len(wrong):
        images = data.split("test").images.numpy()[:: data.test_every]
        told = [f"{module.classes[result.labels[row]]} as {module.classes[answers[row]]}" for row in wrong]
        yield f"errors_{method}", gallery([_picture(images[row]) for row in wrong], told)


def _picture(image: np.ndarray) -> np.ndarray:
    return image[0] if len(image) == 1 else image.transpose(1, 2, 0)
