"""Maps on disk: a fitted observation model with its likelihood, as memory-mapped arrays and a header.

A folder holds ``map.json`` and one ``.npy`` file for each array: ``poses``, ``descriptors``, ``mean`` and, under
``state``, what the model computed. The header contains the size and hash of every file and is written last, so that a
folder in which writing was interrupted is not mistaken for a map. Nothing is pickled.
"""

import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from sextant.array_folder import FolderFormat, plain_values
from sextant.atomic_files import hash_file, write_atomically
from sextant.errors import UserError
from sextant.localization import observation
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import ObservationModel, observation_model
from sextant.localization.observation.model import stored
from sextant.localization.pose_kernel import PoseKernel

HEADER = "map.json"
KIND = FolderFormat("a map", "sextant.localization_map", 1, HEADER)
#: Files with fewer bytes are read, not mapped.
SMALL = 2**16
_NAME = re.compile(r"(state/)?[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True)
class SavedMap:
    """The contents of a saved map.

    Attributes:
        model: the fitted model, whose arrays are memory-mapped and take memory only where they are used.
        likelihood: the likelihood with its calibration.
        facts: other facts about the map, such as the descriptor of its images.
    """

    model: ObservationModel
    likelihood: Likelihood
    facts: dict[str, Any]


def save_map(folder: Path, model: ObservationModel, likelihood: Likelihood, facts: dict[str, Any]) -> None:
    """Write a fitted model into a folder, which is created if need be; an existing map is replaced.

    Args:
        folder: folder to write to.
        model: the model, which may have been loaded from this folder.
        likelihood: likelihood to be used with it.
        facts: anything that JSON can hold, and numbers and arrays of NumPy.

    Raises:
        ArgumentError: JSON cannot hold a fact; then an existing map is kept.
        OSError: the folder cannot be written.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> poses = torch.tensor([[0.0, 0, 0], [4, 0, 0]], dtype=torch.float64)
        >>> places, kernel = DescriptorMap.of(poses, torch.eye(2)), PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.01)
        >>> model = observation_model("ExactGP")().fit(places, kernel)
        >>> with TemporaryDirectory() as temporary:
        ...     folder = Path(temporary)
        ...     save_map(folder, model, Likelihood(), {"descriptor": "one of two"})
        ...     saved = load_map(folder)
        ...     sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*.*"))
        ['descriptors.npy', 'map.json', 'mean.npy', 'poses.npy', 'state/factor.npy', 'state/weights.npy']
        >>> saved.facts, saved.model.predict(poses).mean.equal(model.predict(poses).mean)  # to the last bit
        ({'descriptor': 'one of two'}, True)
    """
    facts = plain_values(facts)
    (folder / HEADER).unlink(missing_ok=True)
    known = {"poses": model.map.poses, "descriptors": model.map.descriptors, "mean": model.map.mean}
    tensors = known | {f"state/{name}": tensor for name, tensor in model.state().items()}
    for name, tensor in tensors.items():
        array = tensor.detach().cpu().contiguous().numpy()
        write_atomically(array_path(folder, name), partial(np.save, arr=array, allow_pickle=False))
    write_header(folder, model, model.kernel, likelihood, facts, tensors)


def write_header(
    folder: Path,
    model: ObservationModel,
    kernel: PoseKernel,
    likelihood: Likelihood,
    facts: dict[str, Any],
    arrays: Iterable[str],
) -> None:
    """Turn a folder that contains all arrays into a map, by hashing them and writing the header.

    Args:
        folder: folder with the :func:`array_path` of every array.
        model: model whose class and arguments are written; it need not be fitted.
        kernel: kernel of the model once it is fitted.
        likelihood, facts: as for :func:`save_map`.
        arrays: names of all arrays.

    Raises:
        OSError: an array is missing, or the folder cannot be written.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> poses = torch.tensor([[0.0, 0, 0], [4, 0, 0]], dtype=torch.float64)
        >>> places, kernel = DescriptorMap.of(poses, torch.eye(2)), PoseKernel("rbf", (1.0, 1.0), 1.0, 1.0, 0.01)
        >>> model = observation_model("ExactGP")().fit(places, kernel)
        >>> with TemporaryDirectory() as temporary:
        ...     folder = Path(temporary)
        ...     save_map(folder, model, Likelihood(), {})
        ...     arrays = ["poses", "descriptors", "mean", *(f"state/{name}" for name in model.state())]
        ...     write_header(folder, model, kernel, Likelihood(tempering=0.5), {}, arrays)  # calibrated since
        ...     load_map(folder).likelihood.tempering
        0.5
    """
    header = {
        "model": {"class": _class_name(model), "arguments": plain_values(model.arguments())},
        "kernel": plain_values(asdict(kernel)),
        "likelihood": plain_values(asdict(likelihood)),
        "facts": plain_values(facts),
        "files": {name: _mark(array_path(folder, name)) for name in arrays},
    }
    KIND.write_header(folder, header)


def _class_name(model: ObservationModel) -> str:
    kind = type(model)
    shipped = kind.__module__.startswith(f"{observation.__name__}.")
    return kind.__name__ if shipped else f"{kind.__module__}.{kind.__qualname__}"


def load_map(folder: Path, *, verify: bool = True, trust: bool = False) -> SavedMap:
    """Open a saved map.

    Args:
        folder: folder that it was saved to.
        verify: compare the hash of every file, which reads them once; their sizes are compared in any case.
        trust: import the user's own model class that the map names.

    Raises:
        UserError: the folder does not exist, or holds no map, a map of another version or a damaged one; or the map
            needs code of the user's own and ``trust`` is false.

    Example:
        >>> try:  # how one is written and read again: see save_map
        ...     load_map(Path("nowhere"))
        ... except UserError as error:
        ...     print(error.problem)
        nowhere is not a saved map: there is no such folder
    """
    header = _header(folder)
    tensors = {name: _tensor(folder, name, mark, verify) for name, mark in header["files"].items()}
    try:
        kernel = PoseKernel(**header["kernel"] | {"length": tuple(header["kernel"]["length"])})
        likelihood = Likelihood(**header["likelihood"])
        model = _model_class(str(header["model"]["class"]), folder, trust)(**header["model"]["arguments"])
        state = {name.removeprefix("state/"): tensor for name, tensor in tensors.items() if name.startswith("state/")}
        model.load_state(_map(tensors), kernel, state)
    except (TypeError, ValueError, KeyError, ImportError) as error:
        raise KIND.damaged(folder, f"{HEADER} and the arrays do not make a map: {error}") from error
    return SavedMap(model, likelihood, header["facts"])


def _model_class(name: str, folder: Path, trust: bool) -> type[ObservationModel]:
    module, _, own = name.rpartition(".")
    if not module:
        return observation_model(name)
    if not trust:
        raise UserError(
            f"the map in {folder} needs {name}, which is not part of Sextant",
            "If you trust the source of the map, add trust=true",
        )
    found = getattr(import_module(module), own, None)
    if not (isinstance(found, type) and issubclass(found, ObservationModel)):
        raise ValueError(f"{name} is not an observation model")
    return found


def _map(tensors: dict[str, Tensor]) -> DescriptorMap:
    n, d = tensors["descriptors"].shape
    return DescriptorMap(
        stored(tensors, "poses", (n, 3)),
        stored(tensors, "descriptors", (n, d), torch.float32),
        stored(tensors, "mean", (d,), torch.float32),
    )


def _header(folder: Path) -> dict[str, Any]:
    header = KIND.read_header(folder)
    if not all(isinstance(header.get(key), dict) for key in ("model", "kernel", "likelihood", "facts", "files")):
        raise KIND.damaged(folder, f"{HEADER} lacks keys, or they have values of the wrong kind")
    for name, mark in header["files"].items():
        if not _NAME.fullmatch(name) or not isinstance(mark, dict):
            raise KIND.damaged(folder, f"{HEADER} lists a file {name!r} that is not part of a map")
        if type(mark.get("bytes")) is not int or not isinstance(mark.get("sha256"), str):
            raise KIND.damaged(folder, f"{HEADER} does not give the size and hash of {name}")
    return header


def _tensor(folder: Path, name: str, mark: dict[str, Any], verify: bool) -> Tensor:
    # copy-on-write: changes to the array do not reach the file
    mapped: Literal["c"] | None = None if mark["bytes"] < SMALL else "c"
    sha256 = mark["sha256"] if verify else None
    array = KIND.open_array(folder, array_path(folder, name), mapped, sha256=sha256, size=mark["bytes"])
    try:
        return torch.from_numpy(array)
    except TypeError as error:
        raise KIND.damaged(folder, f"{name} is not an array of numbers: {error}") from error


def array_path(folder: Path, name: str) -> Path:
    """The path of an array's file.

    Example:
        >>> array_path(Path("town"), "state/factor").as_posix()
        'town/state/factor.npy'
    """
    return folder / f"{name}.npy"


def _mark(path: Path) -> dict[str, Any]:
    return {"bytes": path.stat().st_size, "sha256": hash_file(path)}
