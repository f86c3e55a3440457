"""Parts and numbers of the default localizer, over worlds and walks: ``python -m benchmarks.switch_offs csv=a.csv``.

A world is a real walk in a changed world (those of ``benchmarks.changed_walks``), a rendered office by day and by night
(``benchmarks.landmarks``), a rendered town in winter and by night (``benchmarks.wrong_calibration``, cameras known), or
a rendered city in three conditions, a tenth as large as that of ``dataset=town_city``, one of each seed. All drives of
a world are runs of one filter with the default number of particles (2,000, in a city 8,600), one seed each.
``without=scale`` leaves out a part, ``without=filter`` all of it (the most similar image is the answer), and
``set=RARE=0.02,FEW=6`` changes numbers of ``sextant.localization.constants``; each call adds its rows to the file.
``compare=true`` reads it: means over worlds, and paired differences from the default with t intervals over worlds.
Frames count from the sixtieth of a walk on, the thirtieth of an uneven one (without odometry), the twentieth of other
drives, and the twentieth or fifteenth after a kidnapping to the beginning of the drive.
"""

import csv
import os
import pickle
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy import ndarray
from rich.console import Console
from rich.table import Table

from sextant.console.arguments import parse_arguments
from sextant.localization import constants

if TYPE_CHECKING:  # it reads constants
    from sextant.chapters.localization.data.drive import LocalizationData

USAGE = "python -m benchmarks.switch_offs csv=found.csv"
KEYS = {
    "worlds": "those whose names begin with this: walk, office, town or city; by default all but cities",
    "drives": "those whose names begin with one of these, separated by commas; all by default",
    "count": "number of offices, of towns and of cities; 4 by default",
    "without": "scale, sharpening, adaptation, support, window or filter; places: a kernel that tells places apart",
    "set": "numbers of sextant.localization.constants, such as RARE=0.02, separated by commas",
    "csv": "a file to which the results are added",
    "kept": "a folder for descriptors, so that a second call need not work them out",
    "compare": "true: the table of the file; nothing is measured",
}
CHI2_95 = 5.991
#: frames of a walk, its first, those that count, standing ones at its end, and frames of another world
FRAMES, FIRST, COUNTED, STANDS, ELSEWHERE = 130, 20, 60, 50, 80
#: within, m
LIMITS = {"walk": 2.0, "office": 0.9, "town": 5.0, "city": 5.0}
#: a city of 0.9 km2 in eight headings, its drives of 270 m after those for validation
CITY = {"images": 17_200, "headings": 8, "size_m": 933.0, "block_m": 92.0, "query_frames": 167, "query_step_m": 2.0}
COLUMNS = ("within", "in region", "lost", "sure and wrong")
HEADER = ["change", "world", "drive", *COLUMNS]

for _part in (part for word in sys.argv[1:] if word.startswith("set=") for part in word[4:].split(",")):
    _name, _, _value = _part.partition("=")  # before the modules that read them
    try:
        setattr(constants, _name, type(getattr(constants, _name))(float(_value)))
    except (AttributeError, ValueError):
        _known = ", ".join(name for name in vars(constants) if name.isupper())
        sys.exit(f"set={_part} must name a number and its value, such as RARE=0.02; the numbers are {_known}")


@dataclass(frozen=True)
class Drive:
    """Descriptors, odometry (None: there is none) and truth of a drive, and its first frame that counts."""

    name: str
    seen: ndarray
    motion: ndarray | None
    truth: ndarray
    counted: int


def kidnapped(drive: Drive, name: str, after: int) -> Drive:
    """The second half of a drive, then its first."""
    half = len(drive.seen) // 2
    order = np.r_[half : len(drive.seen), 0:half]
    assert drive.motion is not None
    return Drive(name, drive.seen[order], drive.motion[order], drive.truth[order], len(order) - half + after)


def uneven(images: int) -> ndarray:
    """Images of a camera that stands, walks and runs, ten images each, over and over."""
    rows = FIRST + np.cumsum(([0] * 10 + [1] * 10 + [3] * 10) * (FRAMES // 30 + 1))
    return rows[rows < images][:FRAMES]


def drives(world: str, kept: dict) -> Iterator[Drive]:
    """The drives of a world."""
    rng = np.random.default_rng(0)
    if not world.startswith("walk"):
        for condition, found in kept["drives"].items():
            erring = 1.0 if world.startswith("office") else 1 + 0.1 * rng.standard_normal(found["motion"].shape)
            usual = Drive(f"odometry, {condition}", found["seen"], found["motion"] * erring, found["truth"], FIRST)
            yield usual
            yield replace(usual, name=f"no odometry, {condition}", motion=None)
            yield kidnapped(usual, f"kidnapped, {condition}", 15)
        return
    whole, at = kept["drives"][""]["seen"], kept["drives"][""]["at"]
    seen, at, way = whole[FIRST:][:FRAMES], at[FIRST:], np.diff(at)[FIRST - 1 :]
    noise = rng.standard_normal((len(whole) - FIRST, 3)) * (0.1, 0.02, 0.005)
    moved, noise, truth = way[:FRAMES, None], noise[:FRAMES], np.zeros((len(seen), 3))
    truth[:, 0] = at[:FRAMES]
    usual = Drive("odometry", seen, moved * (np.array([1.0, 0, 0]) + noise), truth, COUNTED)
    yield usual
    yield replace(usual, name="a tenth short", motion=moved * (np.array([0.9, 0, 0]) + noise))
    yield replace(usual, name="no odometry", motion=None)
    rows = uneven(len(whole))
    places = np.zeros((len(rows), 3))
    places[:, 0] = kept["drives"][""]["at"][rows]
    yield Drive("uneven", whole[rows], None, places, 30)
    yield kidnapped(usual, "kidnapped", 20)
    order = np.r_[0:COUNTED, np.full(STANDS, COUNTED - 1)]
    assert usual.motion is not None
    still = usual.motion[order] * (np.arange(len(order)) < COUNTED)[:, None]
    yield Drive("standing", seen[order], still, truth[order], len(order) - 10)
    away = Drive("elsewhere", kept["elsewhere"][:ELSEWHERE], usual.motion[:ELSEWHERE], truth[:ELSEWHERE] - 1e6, 40)
    yield away
    yield replace(away, name="elsewhere, no odometry", motion=None)


def described_worlds(begins: str, count: int, kept: Path) -> Iterator[tuple[str, dict]]:
    """Descriptors of the map and the drives of each world, and the map's likeliest kernel."""
    from benchmarks.changed_walks import WALKS

    kinds = ("city",) if begins.startswith("city") else ("office", "town")
    names = [f"walk {name}" for name in WALKS] + [f"{kind} {k}" for kind in kinds for k in range(count)]
    for name in (name for name in names if name.startswith(begins)):
        path = kept / f"{name}.pkl"
        if not path.is_file():
            kind, _, which = name.partition(" ")
            made = {"walk": _walk, "office": _office, "town": _town, "city": _city}[kind](which)
            path.write_bytes(pickle.dumps(made))
        yield name, pickle.loads(path.read_bytes())


def _walk(name: str) -> dict:
    from benchmarks.changed_walks import ELSEWHERE as OTHER
    from benchmarks.changed_walks import WALKS, photos

    data = Path(os.environ["SEXTANT_DATA"])
    mapped, query, first, last = WALKS[name]
    images, places = photos(data / mapped, "gallery", first, last, None)
    seen, at = photos(data / query, "query", first, last, None)
    away, _ = photos(data / next(OTHER[key] for key in OTHER if name.startswith(key)), "query", 0, 100, None)
    poses = np.zeros((len(images), 3))
    poses[:, 0] = places
    return _described(images, poses, {"": (seen, {"at": at})}, away)


def _office(seed: str) -> dict:
    from benchmarks.landmarks import office

    with tempfile.TemporaryDirectory() as folder:
        return _rendered(office(int(seed), Path(folder)))


def _rendered(data: "LocalizationData") -> dict:
    images = np.asarray(data.map.images[np.arange(len(data.map))])
    driven = {
        each.condition: (each.images[np.arange(len(each))], {"motion": each.motion, "truth": each.poses})
        for each in data.test
    }
    return _described(images, data.map.poses, driven)


def _city(seed: str) -> dict:
    from sextant.chapters.localization.data import as_localization_source
    from sextant.data.worlds import TownCity

    conditions = ["summer_noon", "autumn_rain", "night_clear"]
    with tempfile.TemporaryDirectory() as folder:
        dataset = TownCity(
            roots=(Path(folder),), width=96, height=64, vfov_deg=55.0, samples=1, streets=None, conditions=conditions,
            seed=int(seed), **CITY,
        )  # fmt: skip
        return _rendered(as_localization_source(dataset).read())


def _town(seed: str) -> dict:
    from benchmarks import wrong_calibration as towns

    world, driven = towns.World.of(int(seed)), {}
    pair = (towns.camera(world.wide, world.tilt, world.roll), towns.camera(world.narrow))
    view = towns.shared_view(pair, towns.ROWS)
    images = np.stack([pair[1].straighten(each, view, 0)[0] for each in world.map_pictures()])
    for name in towns.DRIVES:
        seen = np.stack([pair[0].straighten(each, view, 0)[0] for each in world.drive_pictures(name)])
        driven[name] = (seen, {"motion": towns.motions_along(world.walked), "truth": world.walked})
    return _described(images, world.mapped, driven)


def _described(images: ndarray, poses: ndarray, driven: dict, elsewhere: ndarray | None = None) -> dict:
    from sextant import Localizer
    from sextant.chapters.localization.saved_filter import fitted_kernel

    made = Localizer.from_images(images, poses)
    found = made.model.map

    def rows(several: ndarray) -> ndarray:
        return np.stack([made.describe(image) for image in several])

    return {
        "poses": found.poses.numpy(), "descriptors": found.descriptors, "kernel": fitted_kernel(found),
        "drives": {name: {"seen": rows(seen)} | told for name, (seen, told) in driven.items()},
        "elsewhere": None if elsewhere is None else rows(elsewhere),
    }  # fmt: skip


#: what ``without=`` takes
PARTS = ("scale", "sharpening", "adaptation", "support", "window", "places", "filter")


def retrieved(world: str, kept: dict, begin: tuple[str, ...]) -> Iterator[list]:
    """How often the most similar image is near enough; it has no region and no verdict."""
    mapped, places = torch.from_numpy(np.asarray(kept["descriptors"], np.float32)), np.asarray(kept["poses"])
    limit = LIMITS[world.split(maxsplit=1)[0]]
    for each in drives(world, kept):
        if not begin or each.name.startswith(begin):
            rows = torch.cdist(torch.from_numpy(np.asarray(each.seen, np.float32)), mapped).argmin(1).numpy()
            near = np.hypot(*(places[rows] - each.truth)[each.counted :, :2].T) <= limit
            yield [world, each.name, (100 * near.mean()).round(2), np.nan, np.nan, np.nan]


def measured(world: str, kept: dict, without: str, begin: tuple[str, ...]) -> Iterator[list]:
    """The columns of each drive of a world, in per cent."""
    if without == "filter":
        yield from retrieved(world, kept, begin)
        return
    from benchmarks.place_kernel import discriminative_kernel
    from sextant.chapters.localization.saved_filter import usual_filter, usual_particles, usual_radius
    from sextant.localization.adaptation import Adaptation
    from sextant.localization.descriptor_map import DescriptorMap
    from sextant.localization.initialisation import UniformStart
    from sextant.localization.likelihood import Likelihood
    from sextant.localization.localize import Localized, Steps
    from sextant.localization.observation.cached_local_gp import CachedLocalGP
    from sextant.localization.observers import Camera
    from sextant.localization.recovery import BayesRestart

    found = DescriptorMap.of(torch.from_numpy(np.asarray(kept["poses"], np.float64)), kept["descriptors"])
    kernel = sharp = kept["kernel"]
    if without == "places":
        sharp = discriminative_kernel(kernel, found)
    elif without != "sharpening":
        sharp = kernel.sharpened(constants.SHARPER, constants.NOISE)
    model = CachedLocalGP(min(16, len(found)), map_evidence="mean").fit(found, sharp)
    filter = usual_filter(found.poses, kernel, recovery=BayesRestart() if without == "window" else None)
    filter = replace(filter, support=None) if without == "support" else filter
    likelihood = Likelihood(tempering=constants.TEMPERING)
    learns = without != "adaptation"
    odds = None if without in ("scale", "adaptation") else constants.ODDS
    rules = Adaptation(model, likelihood, learns=learns, odds=odds)
    kind = world.split(maxsplit=1)[0]
    steps = Steps(filter, UniformStart(), usual_particles(len(found)), usual_radius(found.poses), rules)
    driven = [each for each in drives(world, kept) if not begin or each.name.startswith(begin)]
    if not driven:
        return
    camera = Camera(model, likelihood, np.concatenate([each.seen for each in driven]).astype(np.float32))
    first = np.cumsum([0, *(len(each.seen) for each in driven[:-1])])
    draws, limit = torch.Generator().manual_seed(0), LIMITS[kind]
    now: Localized | None = None
    rows: list[list[tuple[bool, ...]]] = [[] for _ in driven]
    for step in range(max(len(each.seen) for each in driven)):
        frames = first + [min(step, len(each.seen) - 1) for each in driven]
        motion = [np.full(3, np.nan) if each.motion is None else each.motion[step % len(each.seen)] for each in driven]
        looked = torch.tensor([step < len(each.seen) for each in driven])
        now = steps.step(now, torch.from_numpy(np.stack(motion)), camera, frames, looked, draws)
        told, lost = now.found, now.lost
        for run, each in enumerate(driven):
            if each.counted <= step < len(each.seen):
                away = told.pose[run, :2].numpy() - each.truth[step, :2]
                covariance = told.covariance[run, :2, :2].numpy() + 1e-12 * np.eye(2)
                near, inside = np.hypot(*away) <= limit, away @ np.linalg.solve(covariance, away) < CHI2_95
                rows[run].append((near, inside, bool(lost[run]), not (lost[run] or near or inside)))
    for each, values in zip(driven, rows, strict=True):
        yield [world, each.name, *(100 * np.mean(np.array(values, float), axis=0)).round(2)]


def table(rows: list[list[str]]) -> Table:
    """Each change beside the default, by kind of world and of drive."""
    from sextant.evaluation import mean_interval

    made = Table("change", "worlds", "drive", "number", *(f"{name}, %" for name in COLUMNS))
    cells = {(change, world, drive): np.array(values, float) for change, world, drive, *values in rows}
    kinds = dict.fromkeys(
        (change, world.split(maxsplit=1)[0], drive.partition(",")[0] if "elsewhere" not in drive else drive)
        for change, world, drive in cells
    )
    for change, kind, drive in kinds:
        pairs: dict[str, list[tuple[ndarray, ndarray]]] = {}
        for (other, world, name), values in cells.items():
            alike = world.startswith(kind) and (name == drive or name.startswith(f"{drive}, ")) and other == change
            if alike and not (drive == "elsewhere" and name != drive) and ("default", world, name) in cells:
                pairs.setdefault(world, []).append((values, cells["default", world, name]))
        if not pairs or change == "default":
            continue
        both = np.array([np.mean(each, axis=0) for each in pairs.values()])
        told = []
        for own, usual in both.transpose(2, 1, 0):
            low, high = mean_interval(own - usual) if len(own) > 1 else (np.nan, np.nan)
            told.append(
                "–"
                if np.isnan(own).all()
                else f"{usual.mean():.0f} → {own.mean():.0f} ({(own - usual).mean():+.1f} [{low:+.1f}, {high:+.1f}])"
            )
        made.add_row(change, kind, drive, str(len(both)), *told)
    return made


def main() -> None:
    """Measure, or compare what was measured."""
    given = parse_arguments(sys.argv[1:], KEYS, USAGE)
    path, without = Path(given["csv"]) if "csv" in given else None, given.get("without", "")
    if without and without not in PARTS:
        sys.exit(f"without={without} must be {', '.join(PARTS)}")
    change = " ".join(filter(None, (without and f"without {without}", given.get("set", "")))) or "default"
    if given.get("compare") != "true":
        begin, any_row = tuple(filter(None, given.get("drives", "").split(","))), False
        with tempfile.TemporaryDirectory() as folder, torch.no_grad():
            kept = Path(given.get("kept", folder))
            kept.mkdir(parents=True, exist_ok=True)
            for world, found in described_worlds(given.get("worlds", ""), int(given.get("count", 4)), kept):
                for row in measured(world, found, without, begin):
                    any_row = True
                    print(change, *row, flush=True)
                    if path is not None:
                        begun = path.is_file()
                        with path.open("a", newline="") as file:
                            csv.writer(file).writerows([[change, *row]] if begun else [HEADER, [change, *row]])
        if not any_row:
            asked = " ".join(f"{key}={given[key]}" for key in ("worlds", "drives") if key in given)
            sys.exit(f"{asked} leaves no drive: names begin with these, for example worlds=office drives=kidnapped")
    elif path is None:
        sys.exit(f"compare=true needs csv=..., for example {USAGE} compare=true")
    else:
        Console(width=200).print(table(list(csv.reader(path.open()))[1:]))


if __name__ == "__main__":
    main()
