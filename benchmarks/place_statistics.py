"""The similarity of pairs of aligned traverses, such as rendered and real ones, by several statistics.

``python -m benchmarks.place_statistics reference=<images> query=<images> [reference2=<images> query2=<images>]``
``python -m benchmarks.place_statistics [reference=<images> query=<images>] town=true [seeds=0,1,2] [json=<file>]``

Images are a folder, in the order of the file names, or an ``.npy`` of uint8 (n, h, w, 3). Images at one index show one
place. With ``town=true`` two drives through a town under ``nordland_town.SETTINGS`` follow for each of ``seeds``, of as
many places as the images (or ``places=``), rendered into the stores of ``sextant data list`` by ``threads=`` threads.
Every further pair is shown with its ratio to the first, and with Kendall's tau between the rankings of descriptors.
``json=`` writes all of it, and the settings, to a file.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError
from rich.console import Console
from rich.table import Table
from scipy.stats import kendalltau

from benchmarks.nordland_town import PLACES, SETTINGS, town_traverses
from benchmarks.traverse_statistics import PlaceStatistics, place_statistics
from sextant.console.arguments import parse_arguments
from sextant.errors import UserError
from sextant.runs.outputs_folder import default_outputs

USAGE = """python -m benchmarks.place_statistics reference=<images> query=<images> [reference2=<images> query2=<images>]
python -m benchmarks.place_statistics [reference=<images> query=<images>] town=true [seeds=0,1,2] [json=<file>]"""
KEYS = {
    "reference": "images of the first pair",
    "query": "images of the same places",
    "reference2": "images of the second pair",
    "query2": "images of the same places",
    "town": "true: render drives through a town as further pairs",
    "seeds": "of the towns; 0 by default",
    "places": f"number per drive if there are no images; {PLACES} by default",
    "threads": "number of rendering threads; 2 by default",
    "json": "file for the results",
}
PAIRS = (("reference", "query"), ("reference2", "query2"))
SUFFIXES = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True)
class Job:
    """The options of the command line.

    Attributes:
        pairs: reference and query images.
        seeds: seeds of the towns to render.
        places: places per drive; None for as many as the first pair has.
        threads: number of rendering threads.
        json: file for the results.
    """

    pairs: tuple[tuple[Path, Path], ...]
    seeds: tuple[int, ...] = ()
    places: int | None = None
    threads: int = 2
    json: Path | None = None


def main(arguments: list[str]) -> None:
    console = Console(width=150)
    try:
        job = parse(arguments)
        measured = {name: measure(*pair) for name, pair in zip(("images", "images 2"), job.pairs, strict=False)}
        places = job.places or (next(iter(measured.values())).frames if measured else PLACES)
        for seed in job.seeds:
            with console.status(f"town {seed}: {2 * places:,} pictures"):
                measured[f"town {seed}"] = measure_town(seed, places, job.threads)
        if job.json:
            write_json(job, measured)
    except UserError as error:
        raise SystemExit(str(error)) from None
    for name, (reference, query) in zip(measured, job.pairs, strict=False):
        console.print(f"{name}: query {query} -> reference {reference}", soft_wrap=True)
    console.print(side_by_side(measured))
    names = list(measured)
    for name in names[1:]:
        tau = ranking_tau(measured[names[0]], measured[name])
        console.print(f"Kendall's tau between the rankings of descriptors by recall, {names[0]} and {name}: {tau:.2f}")


def parse(arguments: Sequence[str]) -> Job:
    """The job; pairs must be complete, and the first is required unless a town is given."""
    given = parse_arguments(arguments, KEYS, USAGE)
    town = _truth(given.pop("town", "false"))
    seeds = tuple(_whole("seeds", text, 0) for text in given.pop("seeds", "0").split(",")) if town else ()
    places = _whole("places", given.pop("places"), 1) if town and "places" in given else None
    threads = _whole("threads", given.pop("threads", "2"), 1)
    file = given.pop("json", "")
    legal = [{name for pair in PAIRS[:count] for name in pair} for count in range(0 if town else 1, 3)]
    if set(given) not in legal or not all(given.values()) or len(set(seeds)) < len(seeds):
        raise UserError(f"cannot understand the arguments: {' '.join(arguments) or 'none given'}", USAGE)
    if places and given:
        raise UserError("places= cannot be combined with images, which set the number of places", USAGE)
    paths = {name: Path(path).expanduser() for name, path in given.items()}
    pairs = tuple((paths[reference], paths[query]) for reference, query in PAIRS if reference in paths)
    return Job(pairs, seeds, places, threads, Path(file).expanduser() if file else None)


def _truth(text: str) -> bool:
    if text not in ("true", "false"):
        raise UserError(f"town={text}: must be true or false", USAGE)
    return text == "true"


def _whole(name: str, text: str, least: int) -> int:
    if not text.isdecimal() or int(text) < least:
        raise UserError(f"{name}: {text!r} is not a whole number from {least} on", USAGE)
    return int(text)


def measure_town(seed: int, places: int, threads: int) -> PlaceStatistics:
    try:
        return place_statistics(*town_traverses(seed, default_outputs() / "data", places=places, threads=threads))
    except ValueError as error:
        raise UserError(f"town {seed}: {error}") from error


def write_json(job: Job, measured: dict[str, PlaceStatistics]) -> None:
    assert job.json is not None
    first = next(iter(measured.values()))
    pairs = [
        {
            "name": name,
            "statistics": {key: _finite(value) for key, value in found.rows().items()},
            "kendall_tau_to_first": _finite(ranking_tau(first, found)),
        }
        for name, found in measured.items()
    ]
    settings = {"town": SETTINGS, "seeds": job.seeds} if job.seeds else {}
    try:
        job.json.parent.mkdir(parents=True, exist_ok=True)
        job.json.write_text(json.dumps({"pairs": pairs, **settings}, indent=2) + "\n")
    except OSError as error:
        raise UserError(f"{job.json} cannot be written: {error}") from error


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


def _finite(value: float) -> float | None:
    """JSON has no nan."""
    return value if np.isfinite(value) else None


def side_by_side(measured: dict[str, PlaceStatistics]) -> Table:
    """A column for each pair, and one for its ratio to the first."""
    first, *others = [statistics.rows() for statistics in measured.values()]
    names = list(measured)
    table = Table("statistic", names[0], *(title for name in names[1:] for title in (name, "ratio")))
    for name, value in first.items():
        cells = [(f"{other[name]:.4g}", f"{other[name] / value:.2f}" if value else "-") for other in others]
        table.add_row(name, f"{value:.4g}", *(text for pair in cells for text in pair))
    return table


def ranking_tau(first: PlaceStatistics, second: PlaceStatistics) -> float:
    """Kendall's tau-b; nan if all descriptors have the same recall on one of them."""
    names = list(first.recall)
    return float(kendalltau([first.recall[name] for name in names], [second.recall[name] for name in names]).statistic)


def _read_array(path: Path) -> np.ndarray:
    try:
        images: np.ndarray = np.load(path, mmap_mode="r", allow_pickle=False)
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
