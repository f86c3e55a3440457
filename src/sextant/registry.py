"""The chapters, each found by the name of its task. Imports nothing heavy.

Nothing else names a task outside its own chapter. A chapter is a package that holds ``chapter.py`` with a
:class:`~sextant.kit.chapter.Chapter` named ``CHAPTER``, ``config.py`` with the config of its runs as ``CONFIG``, and
``commands.py`` with its part of ``predict.py`` as ``HANDLERS``. If its models serve other programs, it also holds
``serving.py``; see :mod:`sextant.lifecycle.offered`.
"""

from importlib import import_module
from typing import Any

from sextant.errors import UserError
from sextant.reporter import SILENT, Reporter

#: task.name -> package of its chapter
CHAPTERS = {
    "classification": "sextant.chapters.classification",
    "calibration": "sextant.chapters.calibration",
    "localization": "sextant.chapters.localization",
    "place_recognition": "sextant.chapters.places",
    "cosfire": "sextant.chapters.cosfire",
}


def chapter_of(task: str, reporter: Reporter = SILENT) -> Any:
    """The chapter of ``task.name``; ``reporter`` listens to its long work.

    Raises:
        UserError: the task does not exist.

    Example:
        >>> chapter_of("place_recognition").monitor
        ('val/recall_at_1', 'max')
    """
    if task not in CHAPTERS:
        raise UserError(f"task={task}: no such task", f"Choose one of {', '.join(sorted(CHAPTERS))}.")
    return import_module(f"{CHAPTERS[task]}.chapter").CHAPTER(reporter)


def offering(method: str) -> list[str]:
    """The tasks whose chapters have a method of their own by this name, in alphabetical order.

    Example:
        >>> offering("new_network")
        ['classification', 'place_recognition']
    """
    return [task for task in sorted(CHAPTERS) if method in vars(type(chapter_of(task)))]
