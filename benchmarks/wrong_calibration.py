"""Effects of wrong calibration on localization: ``python -m benchmarks.wrong_calibration csv=costs.csv``.

Each seed is a town with a map in summer by a known, level camera without distortion, and a drive in winter and at night
by a wider one with barrel distortion, tilt and roll. The assumed calibration of that camera is varied; both are
straightened to the view that the assumed cameras share. Shares are means over seeds with Korn and Graubard's 95 %
intervals, differences from the truth means of paired differences with t intervals.
"""

import csv
import math
import sys
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy import ndarray
from PIL import Image
from rich.console import Console
from rich.table import Table

from benchmarks.machine import describe_machine
from sextant import Localizer, PhotoCalibrator
from sextant.applications.pixels import as_pixels
from sextant.atomic_files import write_csv
from sextant.baselines import Hog
from sextant.chapters.localization.data.drive import motions_along
from sextant.console.arguments import parse_arguments
from sextant.evaluation import mean_interval, share_interval
from sextant.evaluation.protocols import TOWN_LOCALIZATION
from sextant.figures.style import COLOURS, new_figure, plain, save_figure
from sextant.geometry import PerspectiveCamera, level_camera_pose
from sextant.tools.walks.shared_camera import SharedCamera, shared_view
from sextant.worlds import Rays, Town, condition, drive, irregular_streets, random_walk

KEYS = {
    "seeds": "their number; 8 by default",
    "believed": "the truth, and assumptions whose names begin with this; all by default",
    "csv": "a file for the result of each seed",
    "read": "an existing file of this kind; nothing is measured",
    "figure": "a picture of the result",
    "example": "a folder for the map and the drives of the first seed, for sextant walk; nothing is measured",
}
SIZE, ROWS = (320, 240), 60
MAP, DRIVES = "summer_noon", ("winter_noon", "night_clear")
METRES, STEP_M, FRAMES, JUDGED_FROM = 360, 3.0, 60, 20
#: ``None`` is the default of colour images of this size
DESCRIPTORS = {"zoo:places": lambda: None, "HOG": Hog}
#: R@1, and the shares of frames from the twentieth on that are within 5 m and 20 degrees
MEASURES = ("places, R@1", "with odometry", "without odometry")
ZOOMS = (0.6, 0.8, 0.9, 1.1, 1.2, 1.4)


def camera(lens: PerspectiveCamera, tilt: float = 0.0, roll: float = 0.0) -> SharedCamera:
    """A camera of known parameters."""
    focal = float(lens.focal) * lens.height / max(SIZE)
    return SharedCamera(*SIZE, focal, float(lens.k1), float(lens.k2), np.array([tilt]), np.array([roll]), {})


def zoomed(known: SharedCamera, by: float) -> SharedCamera:
    """The same with another focal length, and the distortion kept as visible in the image."""
    k1 = known.k1 * by**2
    return replace(known, focal=known.focal * by, k1=k1, k2=known.k2 * by**4)


def beliefs(drawn: SharedCamera, found: SharedCamera, mapped: SharedCamera, map_found: SharedCamera) -> dict:
    """Assumed calibrations of the drive's and the map's camera; None leaves images unchanged."""
    level = {"tilts": np.zeros(1), "rolls": np.zeros(1)}
    return {
        "truth": (drawn, mapped),
        "estimated, both": (found, map_found),
        "estimated, the map's known": (found, mapped),
        **{f"focal {by - 1:+.0%}": (zoomed(drawn, by), mapped) for by in ZOOMS},
        "focal +20%, both": (zoomed(drawn, 1.2), zoomed(mapped, 1.2)),
        "distortion ignored": (replace(drawn, k1=0.0, k2=0.0), mapped),
        "tilt and roll ignored": (replace(drawn, **level), mapped),
        "not straightened": None,
    }


def pictures(town: Town, name: str, poses: ndarray, lens: PerspectiveCamera, tilt: float, roll: float) -> ndarray:
    """The pictures of a camera on a car."""
    at = np.stack([level_camera_pose(x, y, 1.6, turn, tilt, roll).numpy() for x, y, turn in poses])
    look = condition(name)
    return town.renderer(look).pictures(Rays.of_camera(lens, 1), at, look, seeds=np.arange(len(at)))


def measured(localizer: Localizer, mapped: ndarray, seen: ndarray, poses: ndarray, seed: int) -> list[float]:
    """The measures of one drive."""
    rows = np.stack([localizer.describe(image) for image in seen])
    known = localizer.model.map.descriptors.numpy()
    nearest = np.argmin(np.square(rows[:, None] - known[None]).sum(-1), axis=1)
    limit, turned = TOWN_LOCALIZATION.position, math.radians(TOWN_LOCALIZATION.heading_deg)
    shares = [np.mean(np.hypot(*(mapped[nearest] - poses)[:, :2].T) <= limit)]
    rng = np.random.default_rng(seed)
    motions = motions_along(poses)
    motions = motions * (1 + 0.1 * rng.standard_normal(motions.shape))
    for odometry in (True, False):
        localizer.reset(seed)
        told = [localizer.step(motions[k] if odometry and k else None, descriptor=row) for k, row in enumerate(rows)]
        away = np.stack([each.pose for each in told]) - poses
        turn = np.abs((away[:, 2] + np.pi) % (2 * np.pi) - np.pi)
        shares.append(np.mean(((np.hypot(*away[:, :2].T) <= limit) & (turn <= turned))[JUDGED_FROM:]))
    return [float(share) for share in shares]


@dataclass(frozen=True)
class World:
    """A town, the poses of its map and of a drive, and the two cameras."""

    town: Town
    mapped: ndarray
    walked: ndarray
    narrow: PerspectiveCamera
    wide: PerspectiveCamera
    tilt: float
    roll: float

    @classmethod
    def of(cls, seed: int) -> "World":
        """The world of a seed."""
        rng = np.random.default_rng([seed, 27])
        streets = irregular_streets(size_m=300, block_m=85, seed=seed)
        town, way = Town(streets, seed=seed), random_walk(streets, METRES, seed=seed)
        mapped = drive(streets, way, seed=1).sample_by_distance(STEP_M).poses
        walked = drive(streets, way, seed=2).sample_by_distance(STEP_M).poses[20 : 20 + FRAMES]
        narrow = PerspectiveCamera.from_vfov(math.radians(rng.uniform(45, 60)), *SIZE)
        wide = PerspectiveCamera.from_vfov(math.radians(rng.uniform(65, 85)), *SIZE, k1=-rng.uniform(0.2, 0.3))
        tilt, roll = math.radians(rng.uniform(3, 8)), math.radians(rng.uniform(2, 5)) * rng.choice([-1, 1])
        return cls(town, mapped, walked, narrow, wide, tilt, roll)

    def map_pictures(self) -> ndarray:
        """The pictures of the map's camera."""
        return pictures(self.town, MAP, self.mapped, self.narrow, 0.0, 0.0)

    def drive_pictures(self, name: str) -> ndarray:
        """The pictures of the drive's camera under a condition."""
        return pictures(self.town, name, self.walked, self.wide, self.tilt, self.roll)


def one_seed(seed: int, calibrator: PhotoCalibrator, believed: str = "") -> list[dict]:
    """The truth and the assumptions whose names begin with ``believed``, in one town."""
    world = World.of(seed)
    mapped, walked, tilt, roll = world.mapped, world.walked, world.tilt, world.roll
    images = world.map_pictures()
    map_found = SharedCamera.of(calibrator.one_camera(images[::6]))
    rows = []
    for name in DRIVES:
        seen = world.drive_pictures(name)
        drawn, found = camera(world.wide, tilt, roll), SharedCamera.of(calibrator.one_camera(seen[::3]))
        all_of_them = beliefs(drawn, found, camera(world.narrow), map_found)
        if not any(belief.startswith(believed) for belief in all_of_them):
            sys.exit(f"believed={believed} must begin the name of an assumption: {', '.join(all_of_them)}")
        for belief, pair in all_of_them.items():
            if belief != "truth" and not belief.startswith(believed):
                continue
            if pair is None:
                both = [np.stack([as_pixels(each, (ROWS, 80, 3)) for each in part]) for part in (seen, images)]
            else:
                view = shared_view(pair, ROWS)
                both = [
                    np.stack([of.straighten(each, view, 0)[0] for each in part])
                    for of, part in zip(pair, (seen, images), strict=True)
                ]
            for label, made in DESCRIPTORS.items():
                localizer = Localizer.from_images(both[1], mapped, made())
                shares = measured(localizer, mapped, both[0], walked, seed)
                told = {"seed": seed, "drive": name, "descriptor": label, "belief": belief}
                error = {} if pair is None else {"focal_error": pair[0].focal / drawn.focal - 1}
                rows.append(told | error | dict(zip(MEASURES, shares, strict=True)))
                print(*rows[-1].values(), flush=True)
    return rows


def by_belief(rows: list[dict]) -> dict[tuple[str, str, str], ndarray]:
    """The measures of each seed, by drive, descriptor and assumption."""
    seeds = defaultdict(dict)
    for row in rows:
        told = [float(row[name]) for name in MEASURES]
        seeds[row["drive"], row["descriptor"], row["belief"]][int(row["seed"])] = told
    return {key: np.array([found[seed] for seed in sorted(found)]) for key, found in seeds.items()}


def interval(values: ndarray, measure: int) -> tuple[float, float]:
    """The interval of a mean share over seeds."""
    return share_interval(values, len(values) * (FRAMES - JUDGED_FROM if measure else FRAMES))


def summary(rows: list[dict]) -> list[list[str]]:
    """By drive, descriptor and assumption: each measure with its interval, and its difference from the truth's."""
    lines, found = [], by_belief(rows)
    for (name, label, belief), values in found.items():
        cells = [name, label, belief]
        for k in range(len(MEASURES)):
            (low, high), mean = interval(values[:, k], k), values[:, k].mean()
            cells.append(f"{100 * mean:.0f} [{100 * low:.0f}, {100 * high:.0f}]")
            less = values[:, k] - found[name, label, "truth"][:, k]
            low, high = mean_interval(less)
            same = belief == "truth"
            cells.append("" if same else f"{100 * less.mean():+.0f} [{100 * low:+.0f}, {100 * high:+.0f}]")
        lines.append(cells)
    return lines


def draw(rows: list[dict], path: Path) -> None:
    """A panel per drive and measure, a line per assumption, a colour per descriptor."""
    found, names = by_belief(rows), list(dict.fromkeys(row["belief"] for row in rows))
    figure, panels = new_figure(10.5, 5.6, rows=2, columns=3)
    for panel, (name, k) in zip(panels, ((name, k) for name in DRIVES for k in range(3)), strict=True):
        for number, label in enumerate(DESCRIPTORS):
            values = [found[name, label, belief][:, k] for belief in names]
            at = np.arange(len(names)) + 0.15 * (2 * number - 1)
            panel.hlines(at, *np.transpose([interval(each, k) for each in values]), color=COLOURS[number], lw=1.6)
            panel.plot([each.mean() for each in values], at, "o", color=COLOURS[number], markersize=3.5, label=label)
        panel.set_yticks(range(len(names)), names if k == 0 else [""] * len(names), fontsize=7)
        panel.set(xlim=(-0.02, 1.02), ylim=(len(names) - 0.5, -0.5))
        panel.set_title(f"{name.replace('_', ' ')}: {MEASURES[k]}", fontsize=8)
        panel.tick_params(axis="x", labelsize=7)
        plain(panel)
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False, fontsize=8
    )
    save_figure(figure, path.parent, path.stem)


def write_example(folder: Path) -> None:
    """Write the map with poses.csv, and the drives with their true poses."""
    world = World.of(0)
    for name, poses in ((MAP, world.mapped), *((name, world.walked) for name in DRIVES)):
        (folder / name).mkdir(parents=True, exist_ok=True)
        for k, image in enumerate(world.map_pictures() if name == MAP else world.drive_pictures(name)):
            Image.fromarray(image).save(folder / name / f"{k:03d}.png")
        rows = [f"{k:03d}.png,{x},{y},{math.degrees(turn)}" for k, (x, y, turn) in enumerate(poses)]
        table = folder / name / "poses.csv" if name == MAP else folder / f"{name}_truth.csv"
        table.write_text("\n".join(["file,x,y,heading", *rows]))


def main() -> None:
    """Measure all seeds."""
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.wrong_calibration seeds=8 csv=costs.csv")
    if "example" in given:
        return write_example(Path(given["example"]))
    if "read" in given:
        with Path(given["read"]).open(newline="") as file:
            rows = list(csv.DictReader(file))
    else:
        calibrator = PhotoCalibrator.load()
        rows = []
        for seed in range(int(given.get("seeds", 8))):
            rows += one_seed(seed, calibrator, given.get("believed", ""))
            if "csv" in given:
                write_csv(Path(given["csv"]), ["seed", "drive", "descriptor", "belief", "focal_error", *MEASURES], rows)
    if "figure" in given:
        draw(rows, Path(given["figure"]))
    table = Table("drive", "descriptor", "believed", *(head for name in MEASURES for head in (name, "difference")))
    for line in summary(rows):
        table.add_row(*line)
    console = Console(width=190)
    console.print(describe_machine())
    console.print(table)


if __name__ == "__main__":
    main()
