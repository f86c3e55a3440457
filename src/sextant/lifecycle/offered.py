"""What the model of a checkpoint offers other programs: a network to export, predictions for single photos.

Chapters offer these in a module ``serving``, by functions ``exportable`` and ``photo_predictor``.
"""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from sextant.errors import UserError
from sextant.kit.chapter import Content
from sextant.kit.offers import Exportable, PhotoPredictor
from sextant.kit.trained import read_trained
from sextant.registry import CHAPTERS
from sextant.runs.checkpoint import KEY


def exportable(content: Content, checkpoint: Path, *, trust: bool = False) -> Exportable:
    """The network of a loaded checkpoint, with push-pull layers folded into plain convolutions.

    Args:
        content: content of the checkpoint from :func:`~sextant.kit.trained.read_trained`.
        checkpoint: its file, for messages.
        trust: allow parts from outside Sextant that it names.

    Raises:
        UserError: the model has no network of its own, or its network cannot be exported.
    """
    from sextant.layers import fold

    task = str(content[KEY]["task"])
    served = _served()
    if task not in served:
        raise UserError(
            f"a model of task={task} has no network of its own to export",
            "Its map is saved by task.save_map; the network of its descriptor is a run of task=place_recognition.",
        )
    found = import_module(served[task]).exportable(content, checkpoint, trust=trust)
    network = fold(found.network).requires_grad_(False).cpu()
    return Exportable(network, found.inputs, found.meanings)


def photo_predictor(checkpoint: Path, *, trust: bool = False) -> PhotoPredictor:
    """The photo predictor of a checkpoint.

    Args:
        checkpoint: checkpoint of a run.
        trust: allow parts from outside Sextant that it names.

    Raises:
        UserError: the file is damaged, or its model does not predict from single photos.
    """
    content = read_trained(checkpoint)
    task = str(content[KEY]["task"])
    served = _served()
    if task not in served:
        raise UserError(
            f"a model of task={task} does not predict from single photos",
            f"Register a run of {', '.join(served)}; sextant.Localizer localizes a robot.",
        )
    predictor: PhotoPredictor = import_module(served[task]).photo_predictor(content, checkpoint, trust=trust)
    return predictor


def _served() -> dict[str, str]:
    """The tasks whose chapters have a module ``serving``, in alphabetical order, with that module."""
    modules = {task: f"{CHAPTERS[task]}.serving" for task in sorted(CHAPTERS)}
    return {task: module for task, module in modules.items() if find_spec(module) is not None}
