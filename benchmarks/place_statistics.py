"""How alike two pairs of aligned traverses are, such as rendered places and real ones, statistic by statistic.

``python -m benchmarks.place_statistics reference=<images> query=<images> [reference2=<images> query2=<images>]``

Images are a folder, in the order of the file names, or an ``.npy`` of uint8 (n, h, w, 3). Images at one index show one
place. With a second pair the table has its ratio to the first, and Kendall's tau between the rankings of descriptors.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError
from rich.console import Console
from rich.table import Table
from scipy.stats import kendalltau

from sextant.errors import UserError
from sextant.evaluation.place_statistics import PlaceStatistics, place_statistics

USAGE = "python -m benchmarks.place_statistics reference=<images> query=<images> [reference2=<images> query2=<images>]"
PAIRS = (("reference", "query"), ("reference2", "query2"))
SUFFIXES = (".jpg", ".jpeg", ".png")


def main(arguments: list[str]) -> None:
    try:
        paths = parse(arguments)
        pairs = [pair for pair in PAIRS if pair[0] in paths]
        measured = [measure(paths[reference], paths[query]) for reference, query in pairs]
    except UserError as error:
        raise SystemExit(str(error)) from None
    console = Console(width=130)
    for reference, query in pairs:
        console.print(f"query {paths[query]} -> reference {paths[reference]}", soft_wrap=True)
    console.print(side_by_side(measured))
    if len(measured) == 2:
        console.print(f"Kendall's tau between the rankings of descriptors by recall: {ranking_tau(*measured):.2f}")


def parse(arguments: list[str]) -> dict[str, Path]:
    """The paths by name; each pair whole, and the first one there."""
    given = {name: path for name, _, path in (argument.partition("=") for argument in arguments)}
    legal = [{name for pair in PAIRS[:count] for name in pair} for count in (1, 2)]
    if set(given) not in legal or len(given) != len(arguments) or not all(given.values()):
        raise UserError(f"cannot understand the arguments: {' '.join(arguments) or 'none given'}", USAGE)
    return {name: Path(path).expanduser() for name, path in given.items()}


def measure(reference: Path, query: Path) -> PlaceStatistics:
    try:
        return place_statistics(read_images(reference), read_images(query))
    except ValueError as error:
        raise UserError(f"{reference} and {query}: {error}") from error


def read_images(path: Path) -> np.ndarray:
    """uint8 (n, h, w, 3) of a folder or an ``.npy`` file."""
    if path.suffix == ".npy":
        return _read_array(path)
    if not path.is_dir():
        raise UserError(f"{path} is neither a folder of images nor an .npy file", USAGE)
    files = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
    if not files:
        raise UserError(f"{path} has no image ({', '.join(SUFFIXES)})")
    first = _decode(files[0])
    images = np.empty((len(files), *first.shape), np.uint8)
    for target, file in zip(images, files, strict=True):
        image = _decode(file)
        if image.shape != first.shape:
            raise UserError(f"{file} has shape {image.shape}, {files[0].name} has {first.shape}; need one size")
        target[:] = image
    return images


def side_by_side(measured: list[PlaceStatistics]) -> Table:
    columns = [statistics.rows() for statistics in measured]
    table = Table("statistic", *("first", "second", "second / first")[: 1 if len(columns) == 1 else 3])
    for name, first in columns[0].items():
        values = [column[name] for column in columns]
        ratio = [f"{values[1] / first:.2f}" if first else "-"] if len(values) == 2 else []
        table.add_row(name, *(f"{value:.4g}" for value in values), *ratio)
    return table


def ranking_tau(first: PlaceStatistics, second: PlaceStatistics) -> float:
    """Kendall's tau-b; nan where one of them recalls alike by every descriptor."""
    names = list(first.recall)
    return float(kendalltau([first.recall[name] for name in names], [second.recall[name] for name in names]).statistic)


def _read_array(path: Path) -> np.ndarray:
    try:
        images = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError) as error:
        raise UserError(f"{path} cannot be read: {error}") from error
    if images.dtype != np.uint8 or images.ndim != 4 or images.shape[3] != 3:
        raise UserError(f"{path} holds {images.dtype} {images.shape}, need uint8 (n, h, w, 3)")
    return images


def _decode(file: Path) -> np.ndarray:
    try:
        with Image.open(file) as image:
            return np.asarray(image.convert("RGB"))
    except (OSError, UnidentifiedImageError) as error:
        raise UserError(f"{file} cannot be decoded: {error}") from error


if __name__ == "__main__":
    main(sys.argv[1:])
