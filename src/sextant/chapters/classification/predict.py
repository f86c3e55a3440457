"""Classifies images and writes the results to files."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_csv, write_json
from sextant.chapters.classification.classifier import BATCH, Answering, class_numbers, decoded
from sextant.console.work_progress import Counted
from sextant.console.written import skipped_of, tell_skipped, tell_written
from sextant.data.pixel_values import WhiteLevels
from sextant.data.source import ImageSpec
from sextant.errors import UserError
from sextant.kit.handler import Trained
from sextant.kit.trained import image_spec
from sextant.tables import counted

#: number of images on the contact sheet
SHEET = 40


def predict_classes(
    trained: Trained, opened: Callable[[], tuple[str, Answering]], paths: Sequence[Path], output: Path, given: str
) -> list[dict[str, Any]]:
    """Classify images, write the results to ``output`` and show them; unreadable images are listed.

    Args:
        trained: the model.
        opened: builds the model: the name of its number per class, and the function that computes it.
        paths: paths of the images.
        output: folder for the results.
        given: what the user gave as ``input``.

    Raises:
        UserError: not one image could be read, the model is damaged, or the disk is full.
    """
    spec = image_spec(trained.about["spec"])
    number, answer = opened()
    rows: list[dict[str, Any]] = [{"file": str(path)} for path in paths]
    sheet: list[tuple[ndarray, str]] = []
    levels = WhiteLevels(paths, f"input={given}")
    for start in Counted("classifying", f"batches of {BATCH} images", range(0, len(paths), BATCH)):
        images = _readable(rows[start : start + BATCH], spec, levels)
        every = class_numbers([image for _, image in images], answer, str(trained.found.checkpoint))
        for (row, image), values in zip(images, every, strict=True):
            best = int(np.argmax(values))
            row |= {"class": spec.classes[best], number: round(values[best], 6)}
            # a score of -inf means that there was no example of the class
            told = {n: round(v, 6) for n, v in zip(spec.classes, values, strict=True) if v > -math.inf}
            row["probabilities" if number == "probability" else "scores"] = told
            if len(sheet) < SHEET:
                sheet.append((image, f"{spec.classes[best]} {values[best]:.2f}"))
    with telling_write_errors(output):
        write_json(output / "predictions.json", rows)
        write_csv(output / "predictions.csv", ["file", "class", number, "error"], rows)
        if sheet:
            draw(sheet, output)
    skipped = skipped_of(rows, f"input={given}: none of {counted(len(rows), 'image')} could be read")
    tell_skipped(skipped)
    written = [output / f"predictions.{kind}" for kind in ("csv", "json", "png")]
    tell_written(f"{counted(len(rows) - len(skipped), 'image')} classified", len(skipped), written, "could not be read")
    return rows


def _readable(
    rows: Sequence[dict[str, Any]], spec: ImageSpec, levels: WhiteLevels
) -> list[tuple[dict[str, Any], ndarray]]:
    """The rows whose image can be read, with the image; the other rows get an error."""
    images = []
    for row in rows:
        try:
            images.append((row, decoded(Path(row["file"]), spec, levels)))
        except UserError as error:
            row["error"] = error.problem
    return images


def draw(sheet: Sequence[tuple[ndarray, str]], output: Path) -> None:
    """Write ``predictions.png``: images with their predicted classes."""
    from sextant.figures.gallery import gallery
    from sextant.figures.style import save_figure

    images, texts = zip(*sheet, strict=True)
    save_figure(gallery(list(images), list(texts)), output, "predictions")
