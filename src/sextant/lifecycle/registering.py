"""Registering a trained run as a model in MLflow's registry."""

import io
import re
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from sextant.errors import ArgumentError, UserError, command
from sextant.kit.offers import ERROR
from sextant.kit.trained import read_trained
from sextant.lifecycle.offered import photo_predictor
from sextant.reports.model_card import model_card
from sextant.runs.checkpoint import KEY
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run
from sextant.tracking.mirror import known_run
from sextant.tracking.registry import IMAGE, Registration, answered, register_model
from sextant.tracking.store import Kind, open_store, telling_store_errors
from sextant.zoo.files import card_of

#: legal names of models, which become part of addresses and paths; a folder's name has at most 255 bytes
LONGEST = 200
NAME = rf"[A-Za-z0-9_][A-Za-z0-9_.-]{{,{LONGEST - 1}}}"


@dataclass(frozen=True)
class RegisteredModel:
    """A version of a model, and the address of its registry."""

    name: str
    version: int
    registry: str


def register_run(
    run: str, name: str, outputs: Path | None = None, *, kind: Kind = "sqlite", uri: str | None = None
) -> RegisteredModel:
    """Register a run as the newest version of a model in MLflow's registry.

    The model consists of the run's checkpoint and a code file of Sextant; nothing is pickled. It takes a table with a
    column ``image``, the bytes of image files, and returns one row per image.

    Args:
        run: an MLflow run id, a run directory or its name, or a checkpoint.
        name: name of the model.
        outputs: folder of runs; by default where runs are written.
        kind: kind of the store: the embedded one, or a server.
        uri: address of the server.

    Raises:
        UserError: the run does not exist, its model does not predict from single photos or needs the user's own code,
            or the store cannot be used.

    Example:
        >>> register_run("1a2b3c4d-s0", "digits").version  # doctest: +SKIP
    """
    if not re.fullmatch(NAME, name):
        shown = name if len(name) <= LONGEST else f"{name[:20]}.. of {len(name)} characters"
        raise ArgumentError(
            f"name={shown} must be 1 to {LONGEST} letters (a to z), digits, underscores, dots and hyphens; the first "
            "is neither a dot nor a hyphen",
            "For example name=digits",
        )
    outputs = outputs or default_outputs()
    found = resolve_run(run, outputs)
    predictor, about = photo_predictor(found.checkpoint), read_trained(found.checkpoint)[KEY]
    example = _example()
    (answer,) = answered(predictor, [example])
    if answer[ERROR]:
        raise UserError(f"run={run}: the model gives no prediction for an image of noise: {answer[ERROR]}")
    columns = [(name, str(kind)) for name, kind in predictor.columns.items()]
    uses = [(IMAGE, "bytes of an image file of any kind and size"), *columns, (ERROR, "why an image has no prediction")]
    registered_by = command("register", f"run={run}", f"name={name}")
    note = f"`{name}` is the model of `{about['task']}/{run}`, written by `{registered_by}`."
    with TemporaryDirectory() as folder, telling_store_errors(uri, outputs):
        card = Path(folder) / "model_card.md"
        known = card_of(found.checkpoint)
        card.write_text(model_card(name, uses, about, found.directory, outputs, [note], known), encoding="utf-8")
        store = open_store(kind, uri, outputs)
        run_id = None if found.directory is None else known_run(store, found.directory.tracking_ids())
        code = Path(__file__).with_name("served_code.py")
        registration = Registration(name, code, found.checkpoint, card, str(about["task"]), run_id)
        return RegisteredModel(name, register_model(store, registration, example, answer), store.uri)


def _example() -> bytes:
    """The bytes of a PNG file of noise."""
    pixels = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    content = io.BytesIO()
    Image.fromarray(pixels).save(content, "png")
    return content.getvalue()
