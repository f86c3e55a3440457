"""Filters in one safetensors file: arrays of their parts, and all options as JSON in its header, with a hash of both.

Nothing is unpickled, and nothing but the classes named here is built. Weights of a network are not in the file.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch
from torch import Tensor, nn

from sextant.atomic_files import write_atomically
from sextant.errors import UserError
from sextant.layers.cosfire.banks import Bank, DoGBank, GaborBank
from sextant.layers.cosfire.blur import Blur
from sextant.layers.cosfire.filter_parts import ARRAYS
from sextant.layers.cosfire.strategies import ChannelPeaks, ConcentricCircles, Strategy, VectorKeypoints
from sextant.layers.cosfire.tolerance import Tolerance

F = TypeVar("F", bound=nn.Module)
KEY, VERSION = "sextant.cosfire", 2
DIGEST = "sextant.sha256"
BANKS = {bank.__name__: bank for bank in (GaborBank, DoGBank)}
STRATEGIES = {strategy.__name__: strategy for strategy in (ChannelPeaks, ConcentricCircles, VectorKeypoints)}


class Saveable(Protocol):
    """The parts of a :class:`~sextant.layers.cosfire.cosfire.Cosfire` that a file stores."""

    bank: Bank
    strategy: Strategy
    blur: Blur
    tolerance: Tolerance

    def options(self) -> dict[str, Any]:
        """The numbers among its arguments."""


def save_filters(filters: Saveable, path: Path) -> None:
    """See :meth:`Cosfire.save`."""
    from safetensors.torch import save

    strategy = filters.strategy
    if STRATEGIES.get(type(strategy).__name__) is not type(strategy):
        raise UserError(
            f"filters with the strategy {type(strategy).__name__} cannot be saved",
            f"Keep their state_dict() instead, or use one of {', '.join(STRATEGIES)}.",
        )
    header = {
        "version": VERSION,
        "bank": {"class": type(filters.bank).__name__, "options": filters.bank.options()},
        "grid": list(filters.bank.grid().shape),
        "strategy": {"class": type(strategy).__name__, "options": asdict(strategy)},
        "blur": asdict(filters.blur),
        "tolerance": asdict(filters.tolerance),
        "numbers": filters.options(),
    }
    arrays = {name: getattr(filters, name).detach().cpu().contiguous() for name in ARRAYS}
    told = json.dumps(header)
    packed = save(arrays, {KEY: told, DIGEST: _sha256(told, arrays)})
    write_atomically(Path(path), lambda file: file.write(packed))


def load_filters(path: Path, bank: Bank | None, make: Callable[..., F]) -> F:
    """See :meth:`Cosfire.load`; ``make`` is the class."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, "pt") as file:
            if KEY not in (file.metadata() or {}):
                raise ValueError("it is a safetensors file, but not one of filters")
            told, digest = file.metadata()[KEY], file.metadata().get(DIGEST)
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no dict
        if digest not in (None, _sha256(told, arrays)):  # older files have none
            raise ValueError("it is damaged: its contents do not match their digest")
        header = json.loads(told)
        return _built(header, arrays, bank, path, make)
    except FileNotFoundError:
        raise UserError(f"there is no file {path}", "Give one written by Cosfire.save.") from None
    except (OSError, SafetensorError, KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        problem = (str(error) or type(error).__name__).splitlines()[0]
        raise UserError(
            f"{path} cannot be read as COSFIRE filters: {problem}",
            "Give a file written by Cosfire.save; copy the file again, or configure the filters again.",
        ) from error


def _built(
    header: dict[str, Any], arrays: dict[str, Tensor], bank: Bank | None, path: Path, make: Callable[..., F]
) -> F:
    if header["version"] != VERSION:
        raise ValueError(f"version {header['version']} is not {VERSION}")
    name, options = header["bank"]["class"], header["bank"]["options"]
    if bank is None:
        if name not in BANKS:
            raise UserError(
                f"the filters of {path} use a {name}, whose network is not in the file",
                "Pass the bank: Cosfire.load(path, bank=...).",
            )
        bank = BANKS[name](**_tuples(options))
    if type(bank).__name__ != name or list(bank.grid().shape) != header["grid"]:
        raise UserError(
            f"the filters of {path} were made for a {name} of {header['grid'][0]} channels, not for a "
            f"{type(bank).__name__} of {len(bank.grid())}",
            "Give the bank that they were configured with.",
        )
    strategy = STRATEGIES[header["strategy"]["class"]](**_tuples(header["strategy"]["options"]))
    filters = make(
        bank,
        strategy,
        blur=Blur(**header["blur"]),
        tolerance=Tolerance(**_tuples(header["tolerance"])),
        **header["numbers"],
    )
    _check(arrays)
    missing, unexpected = filters.load_state_dict(arrays, strict=False)
    if unexpected or any("." not in key for key in missing):  # those of a network within the bank are not in the file
        raise ValueError(f"missing or unexpected arrays: {[*missing, *unexpected]}")
    return filters


def _sha256(told: str, arrays: Mapping[str, Tensor]) -> str:
    """Hash of the options and of every array, whatever their order in the file."""
    digest = hashlib.sha256(told.encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"\0{name} {array.dtype} {tuple(array.shape)}\0".encode() + array.numpy().tobytes())
    return digest.hexdigest()


def _tuples(options: dict[str, Any]) -> dict[str, Any]:
    """Turn lists into the tuples that JSON does not have."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in options.items()}


def _check(arrays: dict[str, Tensor]) -> None:
    """Raise a ``ValueError`` unless arrays describe filters whose parts stand in order."""
    count, forms = len(arrays["rho"]), arrays["filter_of_form"]
    if any(len(array) != count for name, array in arrays.items() if name != "filter_of_form"):
        raise ValueError("arrays of different lengths")
    for numbers, parts in ((arrays["form"], count), (forms, len(forms))):
        steps = torch.diff(numbers, prepend=numbers.new_tensor([-1]))
        if numbers.dtype != torch.int64 or len(numbers) != parts or bool(((steps != 0) & (steps != 1)).any()):
            raise ValueError("parts are not in order")
    if (int(arrays["form"].max()) + 1 if count else 0) != len(forms):
        raise ValueError("parts without a filter")
    if not all(bool(array.isfinite().all()) for array in arrays.values()):
        raise ValueError("values that are not finite")
