"""Images that a method classifies wrongly."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Integer, UInt8
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.gallery import gallery

#: images on the sheet
MOST = 40


def recognition_errors(
    images: UInt8[ndarray, "n c h w"],
    labels: Integer[ndarray, "n"],
    answers: Integer[ndarray, "n"],
    classes: Sequence[str],
    *,
    most: int = MOST,
    title: str = "",
) -> Figure | None:
    """Misclassified test images, with ``truth → answer`` above each; None if there are none.

    If there are more errors than ``most``, evenly spaced ones are shown, so that no class is left out because of its
    position.

    Args:
        images: test images, bytes.
        labels: true classes.
        answers: classes predicted by the method.
        classes: names in label order.
        most: images on the sheet.
        title: such as the name of the method; the number of errors is added.

    Example:
        >>> images, labels, answers = np.zeros((4, 1, 8, 8), np.uint8), np.array([0, 0, 1, 1]), np.array([0, 1, 1, 1])
        >>> figure = recognition_errors(images, labels, answers, ["cat", "dog"], title="svm")
        >>> figure.get_suptitle(), figure.axes[0].get_title()
        ('svm: 1 of 4 wrong (25.00 %)', 'cat → dog')
    """
    wrong = np.flatnonzero(labels != answers)
    if not len(wrong):
        return None
    shown = wrong[np.linspace(0, len(wrong) - 1, min(most, len(wrong))).round().astype(int)]
    pictures = [images[i, 0] if images.shape[1] == 1 else images[i].transpose(1, 2, 0) for i in shown]
    figure = gallery(pictures, [f"{classes[int(labels[i])]} → {classes[int(answers[i])]}" for i in shown])
    told = f"{len(wrong):,} of {len(labels):,} wrong ({100 * len(wrong) / len(labels):.2f} %)"
    told += f", {len(shown)} shown" if len(shown) < len(wrong) else ""
    figure.suptitle(f"{title}: {told}" if title else told, fontsize=9)
    return figure
