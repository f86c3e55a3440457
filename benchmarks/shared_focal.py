"""Focal length from two to ten photos of a still scene: ``python -m benchmarks.shared_focal``.

Groups of consecutive photos, spread over each set. Developed on the fountain and the entrance of ``strecha_posed``; the
other sets were only measured. The focal length of the castle in Sceaux is from the model of the camera, that of the
tree from structure from motion, both in another's software. Intervals are 95 % by Clopper and Pearson over groups,
which overlap. One thread.

``fit=true`` adds the overdispersion that makes the errors of three photos and more as large as they say, by maximum
likelihood with an interval by its profile.

``fixating=true`` takes made-up photos instead: 400 points in a box of 5 x 3.6 x 4 m, seen by cameras that look at its
centre from 6 m, each some degrees further around it, with pixels that err by 0.4 pixels of 640; seeds 0 to 5.
"""

import csv
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from numpy import ndarray
from scipy.stats import beta, chi2

from benchmarks.machine import describe_machine
from benchmarks.posed_photos import scenes
from sextant.applications.pixels import as_pixels
from sextant.console.arguments import parse_arguments
from sextant.correspondence import LocalFeatures, XFeatures, detected, shared_focal_length
from sextant.correspondence.shared_focal import MODEL, OVERDISPERSION

SIZES = (2, 3, 5, 10)
#: of the made-up photos of 640 x 480 pixels
FOCAL = 520.0
KEYS = {
    "sets": "beginnings of names of sets, separated by commas (default: all)",
    "groups": "groups of each size (default: 8)",
    "side": "longer side of the images in pixels (default: 1024)",
    "sizes": "numbers of photos, separated by commas (default: 2,3,5,10)",
    "fit": "true: also fit the overdispersion",
    "rows": "CSV file that each group's error and standard deviation are added to",
    "fixating": "true: made-up photos of cameras that fixate one point",
}


def main(
    begins: tuple[str, ...] = ("",),
    groups: int = 8,
    side: int = 1024,
    sizes: tuple[int, ...] = SIZES,
    fit: bool = False,
    kept: Path | None = None,
) -> None:
    """Print a row for each set and number of photos."""
    torch.set_num_threads(1)
    print(describe_machine())
    heads = (
        "set",
        "photos",
        "groups",
        "known",
        "error %, quartiles",
        "largest",
        "stated sigma %",
        "in the 95 % interval",
    )
    print(f"| {' | '.join((*heads, 'CPU s'))} |\n|{'---|' * (len(heads) + 1)}", flush=True)
    answered: list[ndarray] = []
    for name, (files, focal) in sets(Path(os.environ["SEXTANT_DATA"])).items():
        if not name.startswith(begins):
            continue
        features = [detected(XFeatures(4096, side), as_pixels(file)) for file in files]
        for size in sizes:
            starts = np.unique(np.linspace(0, len(files) - size, groups).round().astype(int)).tolist()
            if len(files) < size:
                continue
            rows = np.array([measured(features[start : start + size], focal) for start in starts])
            if kept is not None:
                with kept.open("a", newline="") as file:
                    csv.writer(file).writerows([name, size, *np.round(row[:3], 4).tolist()] for row in rows)
            print(f"| {name} | {size} | {len(rows)} | {cells(rows)} |", flush=True)
            if size > 2:
                answered.append(rows[np.isfinite(rows[:, 0]), :2])
    if fit:
        best, low, high = overdispersion(np.concatenate(answered))
        number = sum(map(len, answered))
        print(f"overdispersion {best:.1f} [{low:.1f}, {high:.1f}] by {number} groups; now {OVERDISPERSION:g}")


def fixating() -> None:
    """Print a row for each turn between photos and number of photos."""
    print(describe_machine())
    heads = ("degrees between photos", "photos", "scenes", "known or unchecked", "error %, median", "largest")
    print(f"| {' | '.join((*heads, 'in the 95 % interval'))} |\n|{'---|' * (len(heads) + 1)}", flush=True)
    for degrees in (1, 2, 4):
        for size in SIZES[:3]:
            rows = np.array([measured(around(degrees, size, seed), FOCAL) for seed in range(6)])
            known, error = np.isfinite(rows[:, 0]), np.abs(rows[:, 0])
            told = f"{np.nanmedian(error):.1f} | {np.nanmax(error):.1f}" if known.any() else "– | –"
            held = f"{int(rows[:, 2].sum())} of {len(rows)}"
            print(f"| {degrees} | {size} | {len(rows)} | {known.sum()} | {told} | {held} |", flush=True)


def around(degrees: float, size: int, seed: int) -> list[LocalFeatures]:
    """Features of points seen by cameras that look at their middle."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((-2.5, -1.8, -2), (2.5, 1.8, 2), (400, 3))
    names = np.linalg.qr(rng.normal(size=(400, 400)))[0].astype(np.float16)
    found = []
    for k in range(size):
        angle = np.radians(degrees * k)
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        inside = points @ turn.T + (0, 0, 6)
        pixels = FOCAL * inside[:, :2] / inside[:, 2:] + (319.5, 239.5) + rng.normal(0, 0.4, (400, 2))
        seen = ((pixels > 0) & (pixels < (640, 480))).all(1)
        found.append(LocalFeatures(pixels[seen].astype(np.float32), names[seen], 640, 480))
    return found


def overdispersion(rows: ndarray) -> tuple[float, float, float]:
    r"""The likeliest overdispersion, and where twice the log-likelihood falls by 3.84.

    Errors of the logarithm of the focal length are normal with the variance :math:`c^2 \varphi / \varphi_0 + m^2`,
    with the stated variance :math:`c^2 + m^2` at today's :math:`\varphi_0`, and m of the model of a camera.
    """
    error, sigma = np.log1p(rows[:, 0] / 100), rows[:, 1] / 100
    curved = np.maximum(sigma**2 - MODEL**2, 1e-8)
    tried = np.geomspace(0.25, 64, 400)
    variance = curved * tried[:, None] / OVERDISPERSION + MODEL**2
    deviation = (error**2 / variance + np.log(variance)).sum(1)
    inside = tried[deviation <= deviation.min() + chi2.ppf(0.95, 1)]
    return float(tried[deviation.argmin()]), float(inside[0]), float(inside[-1])


def sets(data: Path) -> dict[str, tuple[list[Path], float]]:
    """Photos in order, and their focal length in pixels."""
    found = {name: (files, camera[0]) for name, (files, _, camera) in scenes(data / "strecha_posed").items()}
    matrix = (data / "photos/sceaux_castle/K.txt").read_text().split()
    found["sceaux"] = sorted((data / "photos/sceaux_castle").glob("*.JPG")), float(matrix[0])
    with (data / "phone_gravity/phone_gravity.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["f_sfm_px"]]
    found["tree"] = [data / "phone_gravity" / row["file"] for row in rows], float(rows[0]["f_sfm_px"])
    return found


def measured(features: list[LocalFeatures], focal: float) -> tuple[float, ...]:
    """Error in per cent and its standard deviation, nan if unknown; whether the interval holds; CPU seconds."""
    began = time.process_time()
    found = shared_focal_length(features)
    held = found.interval_px[0] <= focal <= found.interval_px[1]
    sigma = np.nan if found.focal_sigma is None else 100 * found.focal_sigma
    return 100 * (found.focal_px / focal - 1), sigma, float(held), time.process_time() - began


def cells(rows: ndarray) -> str:
    """The rest of a row."""
    known = np.isfinite(rows[:, 0])
    held = int(rows[:, 2].sum())
    low, high = (100 * each for each in clopper(held, len(rows)))
    covered = f"{held} of {len(rows)} [{low:.0f}, {high:.0f}]"
    seconds = f"{np.median(rows[:, 3]):.1f}"
    if not known.any():
        return f"0 | – | – | – | {covered} | {seconds}"
    error, sigma = np.abs(rows[known, 0]), np.median(rows[known, 1])
    a, b, c = np.quantile(error, [0.25, 0.5, 0.75])
    return f"{known.sum()} | {b:.2f} [{a:.2f}, {c:.2f}] | {error.max():.1f} | {sigma:.2f} | {covered} | {seconds}"


def clopper(held: int, total: int) -> tuple[float, float]:
    """The 95 % interval of a share."""
    low = beta.ppf(0.025, held, total - held + 1) if held else 0.0
    high = beta.ppf(0.975, held + 1, total - held) if held < total else 1.0
    return float(low), float(high)


if __name__ == "__main__":
    given = parse_arguments(
        sys.argv[1:], KEYS, "python -m benchmarks.shared_focal [sets=fountain] [groups=8] [fit=true] [fixating=true]"
    )
    numbers = tuple(map(int, given.get("sizes", "2,3,5,10").split(",")))
    begins, groups, side = given.get("sets", "").split(","), int(given.get("groups", 8)), int(given.get("side", 1024))
    if given.get("fixating") == "true":
        fixating()
    else:
        main(
            tuple(begins),
            groups,
            side,
            numbers,
            given.get("fit") == "true",
            Path(given["rows"]) if "rows" in given else None,
        )
