"""Files of corrupted images in the layout of CIFAR-10-C, made from a dataset or a file of images."""

import errno
import shutil
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout
from jaxtyping import UInt8
from numpy import ndarray

from sextant import __version__
from sextant.applications.arguments import check_apart
from sextant.atomic_files import read_json
from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import groups
from sextant.config import validate
from sextant.corruptions import benchmark_set, making
from sextant.corruptions.benchmark_corruption import Mode
from sextant.data.source import ImageSource
from sextant.errors import UserError
from sextant.kit.assemble import build_dataset
from sextant.reporter import SILENT, Reporter

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass(frozen=True)
class MadeCorruptions:
    """What :func:`make_corruptions` did.

    Attributes:
        shape: shape of the array of clean images.
        made, kept: numbers of corruptions that were written, and that existed already.
        seconds: time taken.
    """

    shape: tuple[int, ...]
    made: int
    kept: int
    seconds: float


def make_corruptions(
    benchmark: str,
    images: str,
    output: Path,
    *,
    names: Sequence[str] = (),
    severities: Sequence[int] = (),
    seed: int = 0,
    mode: Mode = "faithful",
    labels: str | None = None,
    device: str = "cpu",
    shards: int = 1,
    shard: int | None = None,
    reporter: Reporter = SILENT,
) -> MadeCorruptions:
    """Write one file for each corruption of a benchmark set; files that exist and are complete are kept.

    Args:
        benchmark: benchmark set that gives the parameters: cifar10_c, cifar100_c, mnist_c or imagenet_c.
        images: a dataset of labelled images, whose test split is used, or a ``.npy`` file of uint8 (n, h, w[, c]).
        output: folder for the files.
        names: corruptions or groups of corruptions; by default all.
        severities: severities from 1 to 5; by default the published ones.
        seed: seed of all random draws.
        mode: faithful to the authors' code, or corrected.
        labels: a ``.npy`` file of n labels to write beside the images; by default the dataset's labels.
        device: device to compute on.
        shards: number of processes that share the work, each with its own ``shard``.
        shard: number of this process, from 0; None does all the work, or checks that all ``shards`` have done theirs.
        reporter: listens to the work.

    Raises:
        UserError: an argument is wrong, the input cannot be read, the output cannot be written, or a shard's files are
            missing.
        KeyboardInterrupt: the call was interrupted; finished corruptions are kept, and the same call resumes.
    """
    _check_device(device)
    chosen = benchmark_set(benchmark).build(list(names) or None, list(severities) or None, mode)
    if shard is not None and shard >= shards:
        raise UserError(f"shard={shard} of {shards}: they are numbered from 0 to {shards - 1}")
    check_apart(output, [path for each in (images, labels) if each and (path := Path(each).expanduser()).is_file()])
    found, found_labels = read_input(images, labels)
    if found_labels is not None:
        making.require_same_labels(output, found_labels)
    if shards > 1 and shard is None:
        _require_all(output, chosen, found, shards)
    own = {name: each for i, (name, each) in enumerate(chosen.items()) if shard is None or i % shards == shard}
    try:
        output.mkdir(parents=True, exist_ok=True)
        recipe = making.Recipe(benchmark, mode, seed, making.images_digest(found), __version__)
        with ExitStack() as locks:
            for name in own:
                locks.enter_context(FileLock(output / f".{name}.lock", timeout=0))
            with FileLock(output / ".lock", timeout=10):  # the record is written by all shards
                making.begin(output, recipe, own)
            return _make(output, recipe, own, found, found_labels, device, reporter)
    except Timeout:
        raise UserError(
            f"another process is writing these corruptions to {output}", "Wait for it, or choose another output="
        ) from None
    except OSError as error:
        raise _disk_error(output, error) from None


def _make(
    folder: Path,
    recipe: making.Recipe,
    chosen: making.Corruptions,
    images: UInt8[ndarray, "n ..."],
    labels: "ndarray | None",
    device: str,
    reporter: Reporter,
) -> MadeCorruptions:
    remaining, began = making.missing(folder, chosen, images), time.monotonic()
    if (needed := sum(remaining.values())) > (free := shutil.disk_usage(folder).free):
        raise UserError(
            f"{folder} needs {_megabytes(needed)}, {_megabytes(free)} is free",
            "Free some space, choose another output=, or fewer names= or severities=",
        )
    if labels is not None:
        _write_labels(folder, labels, reporter)
    total, done = needed // images[0].size, 0
    with reporter.progress("corrupting", "images") as progress:

        def advance(count: int) -> None:
            nonlocal done
            done += count
            progress(done, total)

        for name, size in remaining.items():
            making.write_corruption(folder / f"{name}.npy", chosen[name], images, recipe, device, advance)
            reporter.say(f"{name}.npy: {_megabytes(size)}")
    if "frost" in chosen:
        reporter.say("frost uses textures drawn here: errors under it are not comparable with published ones")
    kept = len(chosen) - len(remaining)
    return MadeCorruptions(images.shape, len(remaining), kept, time.monotonic() - began)


def _require_all(folder: Path, chosen: making.Corruptions, images: UInt8[ndarray, "n ..."], shards: int) -> None:
    remaining = making.missing(folder, chosen, images)
    lacking = {i % shards: name for i, name in enumerate(chosen) if name in remaining}
    if lacking:
        told = ", ".join(f"shard={shard} ({name}.npy)" for shard, name in sorted(lacking.items()))
        raise UserError(f"{folder} lacks files of these shards: {told}", "Run them again: each makes what is missing.")


def _write_labels(folder: Path, labels: ndarray, reporter: Reporter) -> None:
    """Write the labels once for each severity of the file that has most of them, whichever call made it."""
    recorded = read_json(folder / making.RECORD) or {}
    counts = {len(levels) for levels in recorded["severities"].values()}
    if len(counts) > 1:
        most = max(counts)
        reporter.say(f"labels.npy repeats the labels {most} times; files with fewer severities use its first part")
    making.write_labels(folder, labels, max(counts))


def _check_device(name: str) -> None:
    import torch

    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise UserError(
            f"device={name} cannot be used: {str(error).splitlines()[0]}", "device=cpu always works."
        ) from None


def read_input(name: str, labels: str | None) -> tuple[UInt8[ndarray, "n ..."], "ndarray | None"]:
    """Read images ``(n, h, w[, c])``, and labels if there are any.

    Args:
        name: a ``.npy`` file of images, or a dataset of labelled images, whose test split is used.
        labels: a ``.npy`` file of n labels; None for those of the dataset.

    Raises:
        UserError: the file or dataset does not exist, or is not of this kind.
    """
    found: Any
    if Path(name).suffix.lower() == ".npy":
        images, found = making.check_images(making.read_array(Path(name), f"input={name}"), f"input={name}"), None
    else:
        images, found = _of_dataset(name)
    if labels is not None:
        found = making.read_array(Path(labels), f"labels={labels}")
    return images, None if found is None else making.check_labels(found, f"labels={labels}", len(images))


def _of_dataset(name: str) -> tuple[UInt8[ndarray, "n h w c"], ndarray]:
    known = groups()["dataset"]
    if name not in known:
        fix = "numpy.save writes a .npy file." if Path(name).exists() else f"Datasets: {', '.join(known)}"
        raise UserError(f"input={name} is neither a .npy file nor a dataset", fix)
    source = build_dataset(validate(to_plain(compose([f"dataset={name}"]))))
    if not isinstance(source, ImageSource):
        raise UserError(f"input={name} is not a dataset of labelled images", "For example input=cifar10")
    split = source.read("test")
    return np.ascontiguousarray(split.images.transpose(0, 2, 3, 1)), split.labels


def _disk_error(folder: Path, error: OSError) -> UserError:
    if error.errno in FULL:
        return UserError(
            f"the disk is full: {folder} cannot hold more",
            "Finished corruptions are kept. Free some space and repeat the command: it resumes.",
        )
    return UserError(f"{folder} cannot be written to: {error.strerror or error}", "Choose another output=")


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.1f} MB"
