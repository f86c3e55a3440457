"""The files of the zoo's models: found by name, verified and read. Nothing in them is executed."""

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
#: keys of a card that build the network, as in a checkpoint
MODEL = "model"
NEEDED = {"task", "config", "spec"}
REINSTALL = "Install Sextant again: pip install --force-reinstall --no-deps sextant-vision"


def names(folder: Path = FOLDER) -> list[str]:
    """The names of all models.

    >>> "calibration" in names()
    True
    """
    return sorted(path.stem for path in folder.glob(f"*{CARD}"))


def model_file(reference: str, folder: Path = FOLDER) -> Path:
    """The weights file of ``zoo:<name>``.

    Raises:
        UserError: there is no model of that name, or one of its files is missing.

    >>> model_file("zoo:digits").name
    'digits.safetensors'
    """
    name = reference.removeprefix(PREFIX)
    if name not in names(folder):
        raise UserError(
            f"{reference}: no such model", f"Available models: {', '.join(PREFIX + n for n in names(folder))}"
        )
    path = folder / f"{name}{WEIGHTS}"
    if not path.is_file():
        raise UserError(f"{reference}: its weights are missing: {path}", REINSTALL)
    return path


def read_card(path: Path) -> dict[str, Any]:
    """The card of a model.

    Args:
        path: its weights file.

    Raises:
        UserError: there is no card beside it, or it is damaged.

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
        raise UserError(f"{path} has no card beside it: {card.name} is missing", REINSTALL) from None
    except (OSError, ValueError):
        pass
    raise UserError(f"{card} is damaged: it is not the card of a model", REINSTALL)


def has_card(checkpoint: Path) -> bool:
    """Whether it is a model of the zoo, with its card beside it."""
    return checkpoint.suffix == WEIGHTS and checkpoint.with_suffix(CARD).is_file()


def card_of(checkpoint: Path) -> dict[str, Any]:
    """The card of a model of the zoo; empty for any other checkpoint."""
    return read_card(checkpoint) if has_card(checkpoint) else {}


def read_model(path: Path) -> tuple[dict[str, Any], "dict[str, Tensor]"]:
    """The plain values that build a model, and its weights in single precision.

    Args:
        path: its weights file, with its card beside it.

    Raises:
        UserError: a file is missing or damaged, or the weights do not match the card.

    >>> built_by, weights = read_model(model_file("zoo:digits"))
    >>> built_by["task"]
    'classification'
    """
    import torch
    from safetensors import SafetensorError
    from safetensors.torch import load

    card = read_card(path)
    data = path.read_bytes()  # read once, so that the verified bytes are the ones used
    if hashlib.sha256(data).hexdigest() != card["sha256"]:
        raise UserError(f"{path} was altered or is damaged: its SHA-256 differs from that of its card", REINSTALL)
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
    """Write a model and its card; large parameters are stored in half precision.

    Args:
        name: name of the model.
        model: the plain values that build it, as in a checkpoint.
        weights: state dict.
        facts: facts for the card: data, licences, command, metrics, seeds, hardware, date.
        folder: folder of models.

    Returns:
        The weights file.

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
    """A copy, in half precision for two dimensions or more; vectors, such as biases and statistics, and tensors in
    double precision keep theirs. Tensors in a file must not share memory, hence the copy.
    """
    single = tensor.is_floating_point() and tensor.element_size() <= 4
    fits = single and tensor.ndim > 1 and bool((tensor.abs() < 6e4).all())
    return (tensor.half() if fits else tensor).contiguous().clone()
