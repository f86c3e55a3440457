"""Recipes, one file per task, which serve the life cycle of runs. Only this package knows tasks by name."""

from importlib import import_module

from sextant.errors import UserError
from sextant.kit.chapter import Recipe, Source
from sextant.reporter import SILENT, Reporter

#: task.name -> import path of its recipe
RECIPES = {
    "calibration": "sextant.chapters.calibration.chapter.CalibrationRecipe",
    "classification": "sextant.chapters.classification.chapter.ClassificationRecipe",
    "cosfire": "sextant.chapters.cosfire.chapter.CosfireRecipe",
    "localization": "sextant.chapters.localization.chapter.LocalizationRecipe",
    "place_recognition": "sextant.chapters.places.chapter.PlaceRecognitionRecipe",
}


def recipe_of(task: str, reporter: Reporter = SILENT) -> Recipe:
    """The recipe of ``task.name``; ``reporter`` listens to its long work.

    Raises:
        UserError: the task does not exist.
    """
    if task not in RECIPES:
        raise UserError(f"task={task}: no such task", f"Choose one of {', '.join(RECIPES)}.")
    module, _, name = RECIPES[task].rpartition(".")
    recipe: Recipe = getattr(import_module(module), name)(reporter)
    return recipe


__all__ = ["RECIPES", "Recipe", "Source", "recipe_of"]
