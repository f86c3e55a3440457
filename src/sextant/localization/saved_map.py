"""Maps on disk: a fitted observation model with its likelihood, as arrays that are mapped into memory and a header.

A folder holds ``map.json`` and one ``.npy`` file for each array: ``poses``, ``descriptors``, ``mean`` and, under
``state``, what the model worked out. The header has the size and hash of every file and is written last, so that a
folder in which writing was broken off is not taken for a map. Nothing is pickled.
"""

import hashlib
import re
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy import ndarray
from torch import Tensor

from sextant.atomic_files import read_json, write_atomically, write_json
from sextant.errors import UserError
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import MODELS, ObservationModel, observation_model
from sextant.localization.observation.model import stored
from sextant.localization.pose_kernel import PoseKernel

FORMAT, VERSION = "sextant.localization_map", 1
HEADER = "map.json"
#: Files of fewer bytes are read, not mapped.
SMALL = 2**16
_NAME = re.compile(r"(state/)?[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True)
class SavedMap:
    """What was saved.

    Attributes:
        model: fitted; its arrays are mapped, so that they take memory only as far as they are used.
        likelihood: with its calibration.
        facts: what else was known of the map, such as which descriptor it was described with.
    """

    model: ObservationModel
    likelihood: Likelihood
    facts: dict[str, Any]


def save_map(folder: Path, model: ObservationModel, likelihood: Likelihood, facts: dict[str, Any]) -> None:
    """Write a fitted model into a folder, which is made if need be; a map that was there is replaced.

    Args:
        folder: where to.
        model: may be one that was loaded from this folder.
        likelihood: to be used with it.
        facts: anything that JSON can hold.

    Raises:
        OSError: the folder cannot be written.
    """
    (folder / HEADER).unlink(missing_ok=True)
    known = {"poses": model.map.poses, "descriptors": model.map.descriptors, "mean": model.map.mean}
    tensors = known | {f"state/{name}": tensor for name, tensor in model.state().items()}
    for name, tensor in tensors.items():
        array = tensor.detach().cpu().contiguous().numpy()
        write_atomically(_path(folder, name), partial(np.save, arr=array, allow_pickle=False))
    header = {
        "format": FORMAT,
        "version": VERSION,
        "model": {"class": type(model).__name__, "arguments": model.arguments()},
        "kernel": asdict(model.kernel),
        "likelihood": asdict(likelihood),
        "facts": facts,
        "files": {name: _mark(_path(folder, name)) for name in tensors},
    }
    write_json(folder / HEADER, header)


def load_map(folder: Path, *, verify: bool = True) -> SavedMap:
    """Open a saved map.

    Args:
        folder: that it was saved to.
        verify: compare the hash of every file, which reads them once; their sizes are compared anyway.

    Raises:
        UserError: the folder is not there, holds no map, one of another version, or a damaged one.
    """
    header = _header(folder)
    tensors = {name: _tensor(folder, name, mark, verify) for name, mark in header["files"].items()}
    try:
        kernel = PoseKernel(**header["kernel"] | {"length": tuple(header["kernel"]["length"])})
        likelihood = Likelihood(**header["likelihood"])
        model = observation_model(header["model"]["class"])(**header["model"]["arguments"])
        state = {name.removeprefix("state/"): tensor for name, tensor in tensors.items() if name.startswith("state/")}
        model.load_state(_map(tensors), kernel, state)
    except (TypeError, ValueError, KeyError) as error:
        raise _damaged(folder, f"{HEADER} and the arrays do not make a map: {error}") from error
    return SavedMap(model, likelihood, header["facts"])


def _map(tensors: dict[str, Tensor]) -> DescriptorMap:
    n, d = tensors["descriptors"].shape
    return DescriptorMap(
        stored(tensors, "poses", (n, 3)),
        stored(tensors, "descriptors", (n, d), torch.float32),
        stored(tensors, "mean", (d,), torch.float32),
    )


def _header(folder: Path) -> dict[str, Any]:
    path = folder / HEADER
    if not path.is_file():
        there = "there is no such folder" if not folder.is_dir() else f"the folder has no {HEADER}"
        raise UserError(f"{folder} is not a saved map: {there}", "Name the folder that a map was saved to.")
    header = read_json(path)
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise UserError(f"{path} is not the header of a map: its format is not {FORMAT!r}", "Name another folder.")
    if header.get("version") != VERSION:
        raise UserError(
            f"{path} has version {header.get('version')!r}; this program reads version {VERSION}",
            "Build the map anew from its images.",
        )
    if not all(isinstance(header.get(key), dict) for key in ("model", "kernel", "likelihood", "facts", "files")):
        raise _damaged(folder, f"{HEADER} lacks keys, or they have values of the wrong kind")
    if header["model"].get("class") not in MODELS:
        raise _damaged(folder, f"{HEADER} names the model {header['model'].get('class')!r}, which is none")
    for name, mark in header["files"].items():
        if not _NAME.fullmatch(name) or not isinstance(mark, dict):
            raise _damaged(folder, f"{HEADER} names a file {name!r}, which no map has")
    return header


def _tensor(folder: Path, name: str, mark: dict[str, Any], verify: bool) -> Tensor:
    path = _path(folder, name)
    try:
        if path.stat().st_size != mark.get("bytes"):
            raise _damaged(folder, f"{path} has {path.stat().st_size} bytes; {mark.get('bytes')} were written")
        if verify and _mark(path) != mark:  # before anything of it is interpreted
            raise _damaged(folder, f"{path} is not the file that {HEADER} was written for")
        array: ndarray = np.load(path, mmap_mode=None if path.stat().st_size < SMALL else "c", allow_pickle=False)
        return torch.from_numpy(array)  # mapped copy-on-write: nothing that is written into it reaches the file
    except (OSError, ValueError, TypeError, EOFError) as error:
        raise _damaged(folder, f"{path} cannot be read: {error}") from error


def _path(folder: Path, name: str) -> Path:
    return folder / f"{name}.npy"


def _mark(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        return {"bytes": path.stat().st_size, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}


def _damaged(folder: Path, how: str) -> UserError:
    return UserError(f"the map in {folder} is damaged: {how}", "Build it anew from its images, or copy it again.")
