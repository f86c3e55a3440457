"""The accuracy that the file of a published network states, and whether it is reproduced here."""

from collections.abc import Mapping
from typing import Any

from sextant.config import Config

#: the authors' name for the file of the best epoch; any other file may state the accuracy of another epoch
BEST = "model_best"
CIFAR10 = "sextant.data.cifar10.CIFAR10"
CLEAN = "test/accuracy/clean"
IMAGES = 10_000
#: precision of the authors' tests
EXACT = "32-true"


def says(published: Mapping[str, Any]) -> str:
    """The text that is printed before the test.

    Args:
        published: ``file``, ``epoch`` and ``best_accuracy`` as stated in the network's file, or the ``card`` of a
            classifier of others.
    """
    if "card" in published:
        return str(published["card"])
    return (
        f"published, not trained here; {published['file']} says: saved after epoch {published['epoch']}, "
        f"best_prec1 {100 * published['best_accuracy']:.2f} %"
    )


def same_images(config: Config) -> bool:
    """Whether a test uses the images of the authors' accuracies: the 10,000 test images of CIFAR-10."""
    return config.dataset.target == CIFAR10 and getattr(config.task, "test_every", 0) == 1


def comparison(published: Mapping[str, Any], metrics: Mapping[str, Any]) -> str:
    """The text that is printed after the test: whether the accuracy on clean images equals the file's.

    Args:
        published: as for :func:`says`, with ``same_images`` and the ``precision`` of the test.
        metrics: metrics of the test.
    """
    told, found = published["best_accuracy"], metrics.get(CLEAN)
    told_text = f"best_prec1 of {published['file']}, {100 * told:.2f} %"
    if not published["same_images"] or found is None:
        return f"not compared with {told_text}, which is for the 10,000 test images of CIFAR-10"
    images = round((found - told) * IMAGES)
    if images == 0:
        return f"equals {told_text}"
    off = f"{100 * abs(found - told):.2f} points {'above' if images > 0 else 'below'} {told_text}"
    if (precision := published.get("precision", EXACT)) != EXACT:
        return f"{off}, as computed in {precision}; the file's was computed with trainer.precision={EXACT}"
    if images < 0 and not published["file"].startswith(BEST):
        return f"{off}, which is for the best epoch up to {published['epoch']}; this file may hold another epoch"
    return f"{off}: it is NOT reproduced"
