"""``predict.py``: classify images, calibrate photos, look photos up or localize them in a map, detect an example.

Heavy modules are imported where they are used, so that mistakes in a command are reported at once.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import Field

from sextant.applications.arguments import check_apart
from sextant.console.arguments import Options, parse_arguments
from sextant.console.written import make_output
from sextant.data.photo_files import find_photos
from sextant.errors import UserError
from sextant.kit.handler import Handler, handlers, open_run, require
from sextant.tracking.environment import quiet_libraries

#: defaults where neither model nor task is named: photos are calibrated
UNNAMED = {"run": "zoo:calibration", "output": "calibrated"}


#: handlers by task, with and without a model; the last is the first to be checked against the arguments
HANDLERS = {handler.task: handler for handler in handlers()}


class SharedOptions(Options):
    """Options common to all tasks."""

    run: str | None = None
    """the trained model (default: the package's zoo:calibration, which calibrates photos)"""
    task: str | None = None
    """cosfire: detect the pattern of one example, with or without features of run=; else run= sets the task"""
    input: str | None = None
    """an image, a folder to search for images, a pattern such as 'photos/*.jpg', or for calibration and
    localization a video"""
    output: str | None = None
    """folder for the results: tables (CSV, JSON) and pictures (default: calibrated without run=, matches with map=,
    localization for localization)"""
    outputs: str | None = None
    """output folder of runs, if not the default"""
    trust: bool = Field(False, examples=["true"])
    """true: build user-defined parts that the checkpoint names"""


KEYS = SharedOptions.meanings()
for _each in HANDLERS.values():  # some keys belong to two tasks
    for _key, _text in _each.keys.items():
        KEYS[_key] = "; ".join([*filter(None, [KEYS.get(_key)]), f"{_each.topic}: {_text}"])
USAGE = "\n".join(dict.fromkeys(each.usage for each in HANDLERS.values()))


def main(arguments: Sequence[str]) -> None:
    """Predict every image; unreadable images are named in the result and skipped."""
    quiet_libraries()
    given = parse_arguments(arguments, KEYS, USAGE)
    SharedOptions.of(given)
    for handler in reversed(HANDLERS.values()):
        if handler.claims(given):
            _refuse_others(given, handler)
            require(given, handler.needs, handler.usage)
            handler.predict(given)
            return
    _predict_photos(given)


def _predict_photos(given: Mapping[str, str]) -> None:
    """Predict photos with the model's task; calibrate them if no model is named."""
    given = given if "run" in given else {**UNNAMED, **given}
    require(given, Handler.needs, Handler.usage)
    for each in HANDLERS.values():
        each.check(given)
    output = Path(given["output"]).expanduser()
    paths = find_photos(given["input"], output)
    check_apart(output, paths, input=given["input"])
    make_output(output)
    trained = open_run(given)
    handler = HANDLERS.get(trained.task, Handler())
    _refuse_others(given, handler, trained.task)
    handler.predict_photos(given, trained, paths, output)


def _refuse_others(given: Mapping[str, str], handler: Handler, trained: str = "") -> None:
    """Raise a ``UserError`` if a key is given that belongs to a task other than the model's, ``trained``."""
    taken = {*handler.keys, *(Handler.shared if trained else handler.shared)}
    for key in given:
        if key in taken:
            continue
        if handler.named_by and not trained:
            raise UserError(f"{key}= does not go with {handler.named_by}", handler.usage)
        owner = " and ".join(dict.fromkeys(each.task for each in HANDLERS.values() if key in each.keys))
        raise UserError(f"{key}= belongs to {owner}; this is a model of {trained or handler.task}", handler.usage)
