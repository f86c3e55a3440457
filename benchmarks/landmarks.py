"""Hand-picked landmarks as evidence for localization: ``python -m benchmarks.landmarks``.

Each seed is an office with a map drive by day and a drive by day and by night. Clicks are simulated by the corners of
image regions that differ most from their surroundings (Shi and Tomasi), three on one photo of the map or on each of
eight. Shares are means over seeds with Korn and Graubard's intervals, differences paired, with t intervals.
"""

import math
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np
from numpy import ndarray
from rich.console import Console
from rich.table import Table

from benchmarks.machine import describe_machine
from sextant import Localizer
from sextant.atomic_files import write_csv
from sextant.chapters.cosfire.landmarks import Landmarks
from sextant.chapters.localization.data import as_localization_source
from sextant.chapters.places.saved_descriptor import named_baseline
from sextant.console.arguments import parse_arguments
from sextant.data.worlds import OfficeWalk
from sextant.errors import UserError
from sextant.evaluation import mean_interval, share_interval
from sextant.evaluation.protocols import OFFICE_LOCALIZATION
from sextant.figures.style import COLOURS, new_figure, save_figure
from sextant.localization.motion import ExponentialMotion

KEYS = {
    "seeds": "their number; 8 by default",
    "csv": "a file for the result of each seed",
    "figure": "draw three landmarks of the first seed and their responses along its drives; nothing is measured",
}
CLICKS, PHOTOS, JUDGED_FROM = 3, 8, 20
#: of the drive's frames; its first ones are for validation in a run
MEASURES = ("nearest image, R@1", "500 particles", "100 particles")
LASER = {"beams": 8, "field_of_view_rad": math.pi, "max_range_m": 15.0, "range_sigma_m": 0.02, "dropout": 0.01}


def office(seed: int, folder: Path, beams: int = 8):
    """A small office, rendered: the map, and drives by day and by night, with a laser of so many beams."""
    dataset = OfficeWalk(
        roots=(folder,), size_m=(20.0, 14.0), metres=(60.0, 2.0, 24.0), trajectories=(), every=6, width=96, height=64,
        vfov_deg=60.0, samples=1, conditions=["summer_noon", "night_clear"], laser={**LASER, "beams": beams}, seed=seed,
    )  # fmt: skip
    return as_localization_source(dataset).read()


def clicks(image: ndarray) -> list[tuple[float, float]]:
    """Simulated clicks; none on a bare wall."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    inside = np.zeros_like(grey)
    inside[12:-12, 12:-12] = 255
    found = cv2.goodFeaturesToTrack(grey, CLICKS, 0.01, 16, mask=inside)
    return [] if found is None else [tuple(point) for point in found[:, 0].tolist()]


def has_landmarks(image: ndarray) -> bool:
    """Whether there is a click at which filters can be configured."""
    try:
        return Landmarks(image, clicks(image), None).responses(image[None]).size > 0
    except UserError:
        return False


def landmarks(images: ndarray, photos: int, beside: str | None) -> Landmarks:
    """Landmarks of evenly spaced photos; a photo without any is replaced by the next that has some."""
    evenly = [round(at) for at in (np.arange(photos) + 0.5) / photos * (len(images) - 1)]
    first, *others = (next(filter(has_landmarks, np.roll(images, -at, axis=0))) for at in evenly)
    made = Landmarks(first, clicks(first), beside)
    for photo in others:
        made.add(photo, clicks(photo))
    return made


def descriptors(images: ndarray) -> dict:
    """The descriptors that are compared."""
    return {
        "whitened PCA": named_baseline("whitened_pca"),
        "3 landmarks alone": landmarks(images, 1, None),
        "24 landmarks alone": landmarks(images, PHOTOS, None),
        "whitened PCA and 3 landmarks": landmarks(images, 1, "whitened_pca"),
        "whitened PCA and 24 landmarks": landmarks(images, PHOTOS, "whitened_pca"),
    }


def within(found: ndarray, poses: ndarray) -> ndarray:
    """Which estimates are close enough."""
    turn = np.abs((found[:, 2] - poses[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    limit = OFFICE_LOCALIZATION
    return (np.hypot(*(found - poses)[:, :2].T) <= limit.position) & (turn <= math.radians(limit.heading_deg))


def one_seed(seed: int, folder: Path) -> list[dict]:
    """All descriptors in one office."""
    data = office(seed, folder)
    mapped, images = data.map.poses, np.asarray(data.map.images[np.arange(len(data.map))])
    rows = []
    for label, descriptor in descriptors(images).items():
        localizer = Localizer.from_images(images, mapped, descriptor.fit(images), motion=ExponentialMotion())
        for drive in data.test:
            seen = np.concatenate([descriptor.describe(np.asarray(drive.images[[k]])) for k in range(len(drive))])
            known = localizer.model.map.descriptors.numpy()
            nearest = np.argmin(np.square(seen[:, None] - known[None]).sum(-1), axis=1)
            shares = [within(mapped[nearest], drive.poses).mean()]
            for particles in (500, 100):
                localizer.particles = particles
                localizer.reset(seed)
                told = [
                    localizer.step(m if k else None, descriptor=row)
                    for k, (m, row) in enumerate(zip(drive.motion, seen, strict=True))
                ]
                shares.append(within(np.stack([each.pose for each in told]), drive.poses)[JUDGED_FROM:].mean())
            rows.append(
                {
                    "seed": seed,
                    "light": drive.condition,
                    "descriptor": label,
                    **dict(zip(MEASURES, map(float, shares), strict=True)),
                }
            )
            print(*rows[-1].values(), len(drive), flush=True)
    return rows


def summary(rows: list[dict]) -> list[list[str]]:
    """By light and descriptor: each measure with its interval, and its difference from the ordinary descriptor's."""
    by = defaultdict(dict)
    for row in rows:
        by[row["light"], row["descriptor"]][row["seed"]] = [row[name] for name in MEASURES]
    lines = []
    for (light, label), seeds in by.items():
        cells = [light, label]
        for k in range(len(MEASURES)):
            values = np.array([seeds[seed][k] for seed in sorted(seeds)])
            ordinary = np.array([by[light, "whitened PCA"][seed][k] for seed in sorted(seeds)])
            low, high = share_interval(values, 50 * len(values))
            cells.append(f"{100 * values.mean():.0f} [{100 * low:.0f}, {100 * high:.0f}]")
            low, high = mean_interval(values - ordinary)
            same = label == "whitened PCA"
            cells.append(
                "" if same else f"{100 * (values - ordinary).mean():+.0f} [{100 * low:+.0f}, {100 * high:+.0f}]"
            )
        lines.append(cells)
    return lines


def draw(data, path: Path) -> None:
    """The photo with its points, and each landmark's strips along the drives."""
    images = np.asarray(data.map.images[np.arange(len(data.map))])
    photo = images[len(images) // 2]
    points = clicks(photo)
    filters = Landmarks(photo, points, None)
    figure, (left, *panels) = new_figure(9.5, 2.6, columns=1 + len(data.test))
    left.imshow(photo)
    left.axis("off")
    for k, (x, y) in enumerate(points):
        left.plot(x, y, "o", color=COLOURS[k], markeredgecolor="white")
        left.annotate(str(k + 1), (x, y), (4, 4), textcoords="offset points", color="white", fontsize=9)
    for panel, drive in zip(panels, data.test, strict=True):
        answers = filters.responses(np.asarray(drive.images[np.arange(len(drive))]))
        panel.imshow(answers.T, aspect="auto", vmin=0, vmax=1, cmap="magma", interpolation="nearest")
        near = np.hypot(*(drive.poses[:, :2] - data.map.poses[len(images) // 2, :2]).T)
        panel.axvline(near.argmin(), color="white", lw=0.8, linestyle=":")
        for k in range(1, len(points)):
            panel.axhline(k * filters.columns - 0.5, color="white", lw=0.6)
        panel.set_yticks((np.arange(len(points)) + 0.5) * filters.columns - 0.5, np.arange(len(points)) + 1, fontsize=8)
        panel.set_title(drive.condition.replace("_", " "), fontsize=8)
        panel.set_xlabel("frame", fontsize=8)
        panel.tick_params(labelsize=7)
    save_figure(figure, path.parent, path.stem)


def main() -> None:
    """Measure all seeds."""
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.landmarks seeds=8 csv=clicks.csv")
    with tempfile.TemporaryDirectory() as folder:
        if "figure" in given:
            return draw(office(0, Path(folder)), Path(given["figure"]))
        rows: list[dict] = []
        for seed in range(int(given.get("seeds", 8))):
            rows += one_seed(seed, Path(folder))
            if "csv" in given:
                write_csv(Path(given["csv"]), list(rows[0]), rows)
    table = Table("light", "descriptor", *(head for name in MEASURES for head in (name, "difference")))
    for line in summary(rows):
        table.add_row(*line)
    console = Console(width=170)
    console.print(describe_machine())
    console.print(table)


if __name__ == "__main__":
    main()
