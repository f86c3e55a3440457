"""``python -m sextant.corruptions make``: files of corrupted images in the layout of CIFAR-10-C."""

import errno
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray
from pydantic import Field
from rich.markup import escape

from sextant import __version__
from sextant.cli.arguments import SPLIT, Options, UserPath
from sextant.cli.console import console, key_value_table, reporting_mistakes
from sextant.cli.work_progress import work_progress
from sextant.errors import UserError

if TYPE_CHECKING:
    from sextant.corruptions.making import Corruptions, Images

USAGE = "python -m sextant.corruptions make set=cifar10_c input=cifar10 output=CIFAR-10-C [names=fog,snow] [seed=0]"
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
Mode = Literal["faithful", "corrected"]


class MakeOptions(Options):
    """What the user chose."""

    benchmark: str = Field(alias="set")
    """whose parameters: cifar10_c, mnist_c or imagenet_c"""
    input: str
    """a dataset such as cifar10, of which the test split is taken, or a .npy file of uint8 (n, h, w[, c])"""
    output: UserPath
    """folder of the files"""
    names: Annotated[tuple[str, ...], SPLIT] = ()
    """corruptions or groups of them, separated by commas; all unless given"""
    severities: Annotated[tuple[Literal["1", "2", "3", "4", "5"], ...], SPLIT] = Field(
        (), title="some of 1,2,3,4,5", examples=["1,3,5"]
    )
    """some of 1,2,3,4,5; the published ones unless given"""
    seed: int = Field(0, ge=0, examples=[0])
    """of all random draws; 0 unless given"""
    mode: Mode = Field("faithful", examples=["corrected"])
    """faithful to the authors' code, or corrected; faithful unless given"""
    labels: str | None = None
    """a .npy file of n labels to write beside the images; those of the dataset unless given"""
    device: str = "cpu"
    """where to compute; cpu unless given"""


def run(arguments: Sequence[str]) -> None:
    """Run the command; a user's mistake ends with one message and exit status 2."""
    with reporting_mistakes():
        main(arguments)


def main(arguments: Sequence[str]) -> None:
    """Parse ``make key=value ...`` and write the files.

    Raises:
        UserError: an argument is wrong, the input cannot be read, or the output cannot be written.
    """
    verb, *rest = arguments or ("",)
    if verb in ("-h", "--help", ""):
        rest = ["--help"]
    elif verb != "make":
        raise UserError(f"{verb}: not understood", USAGE)
    options = MakeOptions.parse(rest, USAGE)
    _check_device(options.device)
    chosen = _chosen(options)
    images, labels = _input(options.input, options.labels)
    folder = options.output
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder / ".lock", timeout=0):
            _make(options, chosen, images, labels)
    except Timeout:
        raise UserError(f"another process is writing to {folder}", "Wait for it, or choose another output=") from None
    except OSError as error:
        raise _disk_error(folder, error) from None
    except KeyboardInterrupt:
        console.print("interrupted: the same command resumes; corruptions that are done are kept")
        raise SystemExit(130) from None


def _make(options: MakeOptions, chosen: "Corruptions", images: "Images", labels: NDArray[Any] | None) -> None:
    from sextant.corruptions import making

    folder, mode, seed = options.output, options.mode, options.seed
    recipe = making.Recipe(options.benchmark, mode, seed, making.images_digest(images), __version__)
    making.begin(folder, recipe, chosen)
    remaining, began = making.missing(folder, chosen, images), time.monotonic()
    if (needed := sum(remaining.values())) > (free := shutil.disk_usage(folder).free):
        raise UserError(
            f"{folder} needs {_megabytes(needed)}, {_megabytes(free)} is free",
            "Free some space, choose another output=, or fewer names= or severities=",
        )
    if labels is not None:
        _write_labels(folder, chosen, labels)
    total = needed // images[0].size
    done = 0
    with work_progress("corrupting", "images") as progress:

        def advance(images: int) -> None:
            nonlocal done
            done += images
            progress(done, total)

        for name, size in remaining.items():
            making.write_corruption(folder / f"{name}.npy", chosen[name], images, recipe, options.device, advance)
            console.print(f"{escape(name)}.npy: {_megabytes(size)}")
    seconds = time.monotonic() - began
    rows = {"images": f"{len(images):,} of {' x '.join(map(str, images.shape[1:]))}", "mode": mode, "seed": str(seed)}
    rows |= {
        "made": f"{len(remaining)} corruptions",
        "kept": f"{len(chosen) - len(remaining)}",
        "seconds": f"{seconds:,.1f}",
    }
    console.print(key_value_table(options.benchmark, rows | {"path": str(folder)}))
    if "frost" in chosen:
        console.print("frost has textures drawn here: errors under it do not compare with published ones")


def _write_labels(folder: Path, chosen: "Corruptions", labels: NDArray[Any]) -> None:
    """Write them as often as the files have severities, if all have equally many."""
    from sextant.corruptions.making import write_labels

    counts = {len(corruption.levels) for corruption in chosen.values()}
    if len(counts) == 1:
        write_labels(folder, labels, counts.pop())
        return
    write_labels(folder, labels, 1)
    console.print("labels.npy is for one severity: the corruptions chosen have different numbers of severities")


# ---------------------------------------------------------------------------------------------------------- arguments


def _chosen(options: MakeOptions) -> "Corruptions":
    from sextant.corruptions import benchmark_set

    severities = [int(each) for each in options.severities]
    return benchmark_set(options.benchmark).build(list(options.names) or None, severities or None, options.mode)


def _check_device(name: str) -> None:
    import torch

    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise UserError(
            f"device={name} cannot be used: {str(error).splitlines()[0]}", "device=cpu always can."
        ) from None


def _input(text: str, labels: str | None) -> "tuple[Images, NDArray[Any] | None]":
    """Images ``(n, h, w[, c])``, and labels if there are any."""
    from sextant.corruptions.making import check_images, check_labels, read_array

    if Path(text).suffix == ".npy":
        images, found = check_images(read_array(Path(text), f"input={text}"), f"input={text}"), None
    else:
        images, found = _dataset(text)
    if labels is not None:
        found = read_array(Path(labels), f"labels={labels}")
    return images, None if found is None else check_labels(found, f"labels={labels}", len(images))


def _dataset(name: str) -> "tuple[Images, NDArray[Any]]":
    """The test split of a dataset of labelled images."""
    from sextant.composing.compose import compose, to_plain
    from sextant.composing.config_files import groups
    from sextant.config import validate
    from sextant.data.source import ImageSource
    from sextant.recipes.assemble import build_dataset

    if name not in groups()["dataset"]:
        raise UserError(
            f"input={name} is neither a .npy file nor a dataset", f"Datasets: {', '.join(groups()['dataset'])}"
        )
    source = build_dataset(validate(to_plain(compose([f"dataset={name}"]))))
    if not isinstance(source, ImageSource):
        raise UserError(f"input={name} is not a dataset of labelled images", USAGE)
    split = source.read("test")
    return np.ascontiguousarray(split.images.transpose(0, 2, 3, 1)), split.labels


# ------------------------------------------------------------------------------------------------------------- messages


def _disk_error(folder: Path, error: OSError) -> UserError:
    if error.errno in FULL:
        return UserError(
            f"the disk is full: {folder} cannot hold more",
            "Finished corruptions are kept. Free some space and repeat the command: it resumes.",
        )
    return UserError(f"{folder} cannot be written to: {error.strerror or error}", "Choose another output=")


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.1f} MB"
