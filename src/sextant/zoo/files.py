"""Models of the zoo as files: found by name, checked and read. Nothing in them is executed."""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.atomic_files import write_atomically
from sextant.errors import UserError

if TYPE_CHECKING:
    from torch import Tensor

PREFIX = "zoo:"
FOLDER = Path(__file__).parent
WEIGHTS, CARD = ".safetensors", ".json"
#: of a card: what builds the network and what belongs to it, as in a checkpoint
MODEL = "model"
NEEDED = {"task", "config", "spec"}
REINSTALL = "Install Sextant again: pip install --force-reinstall --no-deps sextant-vision"


def names(folder: Path = FOLDER) -> list[str]:
    """The models there are.

    >>> "calibration" in names()
    True
    """
    return sorted(path.stem for path in folder.glob(f"*{CARD}"))


def model_file(reference: str, folder: Path = FOLDER) -> Path:
    """The weights that ``zoo:<name>`` names.

    Raises:
        UserError: there is no model of that name, or a file of it is missing.

    >>> model_file("zoo:digits").name
    'digits.safetensors'
    """
    name = reference.removeprefix(PREFIX)
    if name not in names(folder):
        raise UserError(
            f"{reference}: no such model", f"Models there are: {', '.join(PREFIX + n for n in names(folder))}"
        )
    path = folder / f"{name}{WEIGHTS}"
    if not path.is_file():
        raise UserError(f"{reference}: its weights are missing: {path}", REINSTALL)
    return path


def read_card(path: Path) -> dict[str, Any]:
    """The card of a model.

    Args:
        path: of its weights.

    Raises:
        UserError: there is none beside them, or it is damaged.

    >>> card = read_card(model_file("zoo:digits"))
    >>> card["bytes"] == model_file("zoo:digits").stat().st_size
    True
    """
    card = path.with_suffix(CARD)
    try:
        found = json.loads(card.read_text(encoding="utf-8"))
        if isinstance(found, dict) and isinstance(found.get("sha256"), str) and set(found.get(MODEL) or ()) >= NEEDED:
            return found
    except FileNotFoundError:
        raise UserError(f"{path} has no card beside it, {card.name}, which says how it is built", REINSTALL) from None
    except (OSError, ValueError):
        pass
    raise UserError(f"{card} is damaged: it is no card of a model", REINSTALL)


def card_of(checkpoint: Path) -> dict[str, Any]:
    """The card of a model of the zoo; empty for any other checkpoint."""
    return read_card(checkpoint) if checkpoint.suffix == WEIGHTS else {}


def read_model(path: Path) -> tuple[dict[str, Any], "dict[str, Tensor]"]:
    """What a model is built by, and its weights in single precision.

    Args:
        path: of its weights, with its card beside it.

    Raises:
        UserError: a file is missing or damaged, or the weights are not those that the card belongs to.

    >>> built_by, weights = read_model(model_file("zoo:digits"))
    >>> built_by["task"]
    'classification'
    """
    import torch
    from safetensors import SafetensorError
    from safetensors.torch import load

    card = read_card(path)
    data = path.read_bytes()  # what is verified is what is read
    if hashlib.sha256(data).hexdigest() != card["sha256"]:
        raise UserError(f"{path} was altered or is damaged: its SHA-256 is not the one of its card", REINSTALL)
    try:
        stored = load(data)
    except (SafetensorError, ValueError) as error:
        raise UserError(f"{path} cannot be read: {error}", REINSTALL) from None
    return card[MODEL], {name: each.float() if each.dtype == torch.float16 else each for name, each in stored.items()}


def write_model(
    name: str,
    model: Mapping[str, Any],
    weights: "Mapping[str, Tensor]",
    facts: Mapping[str, Any],
    folder: Path = FOLDER,
) -> Path:
    """Write a model and its card; its parameters are stored in half precision where they fit it.

    Args:
        name: of the model.
        model: what builds it: plain values, as a checkpoint has them.
        weights: its state dict.
        facts: of the card: data, licences, command, metrics, seeds, hardware, date.
        folder: of models.

    Returns:
        The file of the weights.

    >>> import torch
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     built_by = {"task": "classification", "config": {}, "spec": {}}
    ...     file = write_model("mine", built_by, {"w": torch.eye(2) / 3}, {"licence": "MIT"}, Path(folder))
    ...     read_model(file)[1]["w"]  # in half precision 1/3 has four digits
    tensor([[0.3333, 0.0000],
            [0.0000, 0.3333]])
    """
    from safetensors.torch import save

    data = save({key: _halved(value) for key, value in weights.items()})
    path = folder / f"{name}{WEIGHTS}"
    write_atomically(path, lambda file: file.write(data))
    card = {**facts, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data), MODEL: dict(model)}
    write_atomically(path.with_suffix(CARD), lambda file: file.write(_readable(card).encode()))
    return path


def _readable(card: Mapping[str, Any]) -> str:
    """Indented JSON, with lists and mappings of plain values on one line."""
    text = json.dumps(card, indent=1, ensure_ascii=False) + "\n"
    return re.sub(r"[\[{]\n[^\[\]{}]*\n *[\]}]", lambda m: re.sub(r"\n *", "", m[0].replace(",\n", ", \n")), text)


def _halved(tensor: "Tensor") -> "Tensor":
    """What has two dimensions or more in half precision; vectors, such as biases and statistics, and what was fitted in
    double precision as they are. A copy: a file has no tensors that share their memory.
    """
    single = tensor.is_floating_point() and tensor.element_size() <= 4
    fits = single and tensor.ndim > 1 and bool((tensor.abs() < 6e4).all())
    return (tensor.half() if fits else tensor).contiguous().clone()
