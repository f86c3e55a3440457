"""Errors, intervals and verdicts on all photos of known cameras: ``python -m benchmarks.joint_intervals [run=<run>]``.

Lines, the network and both on the sets of ``SEXTANT_DATA``; panoramas are those that the network was not trained on,
with two crops each (``cuts=``) of cameras of ``lopez_4x3``. Four tables: errors; the joint camera against the better of
its parts, by source; the coverage of its intervals, with multiples of its standard errors chosen on all sources but the
tested one; verdicts. Last, the multiples by all sources, which ``chapters/calibration/jointly.py`` uses. These
multiples and other constants of the joint method were chosen on some of these data, so only the leave-one-source-out
results, and the sets :data:`LATER`, test them.
"""

import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.applications import PhotoCalibrator
from sextant.chapters.calibration.jointly import MULTIPLES
from sextant.chapters.calibration.metrics.photo_benchmark import WRONG, Answers, Truth
from sextant.chapters.calibration.metrics.summary import AUC_DEG
from sextant.chapters.calibration.options import NetworkOptions
from sextant.chapters.calibration.predict import calibrator_of_others
from sextant.console.arguments import parse_arguments
from sextant.lifecycle.photo_benchmark import PhotoBenchmark, benchmark_calibration
from sextant.zoo import model_file, read_card

KEYS = {
    "run": "a run of calibration; zoo:calibration by default",
    "network": "or a network of others: geocalib:<file> or anycalib:<file>",
    "scale": "the scale of its spreads, from sextant benchmark calibration",
    "cuts": "crops of each panorama (default: 2)",
}
#: the folders of each set
SETS = {
    "York Urban": ["york_urban"],
    "panoramas": ["panoramas", "panoramas_more"],
    "iPhones": ["phone_gravity"],
    "EXIF of many cameras": ["exif_focal"],
    "chessboards": ["camera_boards"],
    "castle": ["photos/sceaux_castle"],
    "street": ["photos/lund"],
    "posed photos": ["strecha_posed"],
    "more iPhones": ["phone_gravity_more"],
    "drones": ["drone_gravity"],
    "new panoramas": ["panoramas_new"],
}
#: sets that came after the constants of the joint method were chosen
LATER = ("posed photos", "more iPhones", "drones", "new panoramas")
#: one house and one school, whose photos are not independent, and two makers of panoramas: each is a source, as is
#: each set
HOUSES = ("zind", "jameskuk")
SCENES = (*HOUSES, "polyhaven", "humus")
#: fewest photos of a source in the comparison with the better part
COMPARED = 20
#: what the joint camera may be worse by than the better part: this share of its error or, if larger, so much
SHARE, MARGINS = 0.1, {"tilt_deg": 0.3, "roll_deg": 0.3, "focal_percent": 1.0}
LEVELS = {"68": 0.68, "95": 0.95}
NUMBERS = ("tilt", "roll", "vfov", "k1/f²")


@dataclass(frozen=True, eq=False)
class Measured:
    """A set: the estimates of each method for its photos, and their sources."""

    name: str
    truth: Truth
    methods: dict[str, Answers]
    sources: list[str]


def measured(name: str, parts: list[PhotoBenchmark]) -> Measured:
    """A set of several folders."""
    names = [each for part in parts for each in part.names]
    scenes = [each.partition("__")[0] for each in names]
    owners = [cluster for part in parts for cluster in part.truth.clusters]
    clusters = [scene if scene in HOUSES else owner for scene, owner in zip(scenes, owners, strict=True)]
    cameras = np.concatenate([part.truth.cameras for part in parts])
    truth = Truth(cameras, np.concatenate([part.truth.aspect for part in parts]), clusters)
    methods = {}
    for method in parts[0].methods:
        answers = [part.methods[method] for part in parts]
        half = {level: np.concatenate([each.half[level] for each in answers]) for level in LEVELS}
        verdicts = [verdict for each in answers for verdict in each.verdicts]
        methods[method] = Answers(np.concatenate([each.cameras for each in answers]), half, verdicts)
    return Measured(name, truth, methods, [scene if scene in SCENES else name for scene in scenes])


def error_rows(of: Measured) -> list[list[str]]:
    """Medians with intervals over independent photos, and AUC, of each method."""
    rows = []
    for method, answers in of.methods.items():
        found, row = of.truth.summaries(answers.cameras), [of.name, str(len(of.sources)), method]
        for error, digits in (
            ("tilt_deg", 2),
            ("roll_deg", 2),
            ("vfov_deg", 2),
            ("focal_percent", 1),
            ("bearing_deg", 2),
        ):
            median = found[error].median if error in found else None
            row.append(
                "–"
                if median is None
                else f"{median.value:.{digits}f} [{median.low:.{digits}f}, {median.high:.{digits}f}]"
            )
        for error in ("roll_deg", "tilt_deg", "vfov_deg"):
            areas = [found[error].auc[at].value for at in AUC_DEG] if error in found else []
            row.append(" / ".join(f"{100 * area:.0f}" for area in areas) or "–")
        rows.append(row)
    return rows


def against_rows(sets: list[Measured], resamples: int = 2000) -> list[list[str]]:
    """By source: median errors of the parts and the joint camera, and the excess of the latter over the better part.

    The 95 % interval of the excess is by resampling clusters, the same for both. The joint camera is worse only where
    the interval excludes the margin.
    """
    rows = []
    sources = dict.fromkeys(source for each in sets for source in each.sources)
    for source in sources:
        parts = [(each, np.array(each.sources) == source) for each in sets if source in each.sources]
        if sum(int(own.sum()) for _, own in parts) < COMPARED:
            continue
        clusters = [
            name for each, own in parts for name, is_own in zip(each.truth.clusters, own, strict=True) if is_own
        ]
        row = [source, str(len(clusters))]
        for error, least in MARGINS.items():
            found = {
                method: np.concatenate(
                    [each.truth.errors(each.methods[method].cameras)[error][own] for each, own in parts]
                )
                for method in ("network", "lines", "joint")
            }
            truth = [each.truth.errors(each.truth.cameras)[error][own] for each, own in parts]
            known = np.isfinite(np.concatenate(truth))
            if not known.any():
                row += ["–", "–"]
                continue
            found = {method: np.nan_to_num(each[known], nan=np.inf) for method, each in found.items()}
            medians = {method: float(np.median(each)) for method, each in found.items()}
            better = min(("network", "lines"), key=lambda method: medians[method])
            owners = np.unique(np.array(clusters)[known], return_inverse=True)[1]
            members = [np.flatnonzero(owners == k) for k in range(owners.max() + 1)]
            rng, excess = np.random.default_rng(0), []
            for _ in range(resamples):
                drawn = np.concatenate([members[k] for k in rng.integers(0, len(members), len(members))])
                excess.append(np.median(found["joint"][drawn]) - np.median(found[better][drawn]))
            low, high = np.quantile(excess, [0.025, 0.975])
            margin = max(SHARE * medians[better], least)
            row.append(" / ".join(f"{medians[method]:.2f}" for method in ("network", "lines", "joint")))
            interval = f" [{low:+.2f}, {high:+.2f}]" + " worse" * bool(low > margin) if len(members) > 1 else ""
            row.append(f"{medians['joint'] - medians[better]:+.2f}{interval}")
        rows.append(row)
    return rows


def by_source(sets: list[Measured]) -> list[Measured]:
    """The sets again, one for each source."""
    found = []
    for each in sets:
        for source in dict.fromkeys(each.sources):
            own = np.array(each.sources) == source
            clusters = [name for name, is_own in zip(each.truth.clusters, own, strict=True) if is_own]
            truth = Truth(each.truth.cameras[own], each.truth.aspect[own], clusters)
            methods = {
                method: Answers(
                    answers.cameras[own],
                    {level: half[own] for level, half in answers.half.items()},
                    [verdict for verdict, is_own in zip(answers.verdicts, own, strict=True) if is_own],
                )
                for method, answers in each.methods.items()
            }
            found.append(Measured(source, truth, methods, [source] * len(clusters)))
    return found


def off_and_sigma(of: Measured) -> tuple[Float64[ndarray, "n 4"], Float64[ndarray, "n 4"]]:
    """Errors of tilt, roll, vfov and k1 / f² of the joint camera, and its standard errors."""
    answers = of.methods["joint"]
    true, said = (
        np.column_stack([each[:, :2], 2 * np.arctan(0.5 / each[:, 2]), each[:, 3] / each[:, 2] ** 2])
        for each in (of.truth.cameras, answers.cameras)
    )
    return np.abs(said - true), answers.half["68"] / MULTIPLES["68"]


def multiples(ratios: Float64[ndarray, "n 4"], sources: ndarray, level: float) -> Float64[ndarray, "4"]:
    """Multiples for a coverage of ``level``; a source is weighted by the square root of its number of photos."""
    chosen = []
    for column in ratios.T:
        known = np.isfinite(column)
        values, owners = column[known], sources[known]
        counts = {owner: (owners == owner).sum() for owner in np.unique(owners)}
        weights = np.array([counts[owner] ** -0.5 for owner in owners])
        order = np.argsort(values)
        chosen.append(
            np.interp(level, (np.cumsum(weights[order]) - 0.5 * weights[order]) / weights.sum(), values[order])
        )
    return np.array(chosen)


def interval_rows(sets: list[Measured]) -> list[list[str]]:
    """By set and source: coverage of intervals with multiples chosen without the source."""
    off, sigma = (np.concatenate(parts) for parts in zip(*map(off_and_sigma, sets), strict=True))
    ratios, sources = off / sigma, np.array([source for each in sets for source in each.sources])
    rows, inside = [], {level: np.full(ratios.shape, np.nan) for level in LEVELS}
    for source in np.unique(sources):
        own = sources == source
        for level, share in LEVELS.items():
            bound = multiples(ratios[~own], sources[~own], share)
            inside[level][own] = np.where(np.isfinite(ratios[own]), ratios[own] <= bound, np.nan)
    for title, own in [
        *((source, sources == source) for source in np.unique(sources)),
        ("all panoramas", np.isin(sources, ("panoramas", "new panoramas", *SCENES))),
    ]:
        shares = [" / ".join(_percent(inside[level][own, i]) for level in LEVELS) for i in range(len(NUMBERS))]
        rows.append([title, str(int(own.sum())), *shares])
    means = []
    for i in range(len(NUMBERS)):
        each = [
            [np.nanmean(inside[level][sources == s, i]) for level in LEVELS]
            for s in np.unique(sources)
            if np.isfinite(ratios[sources == s, i]).any()
        ]
        means.append(" / ".join(f"{100 * share:.0f}" for share in np.mean(each, axis=0)))
    rows.append(["mean over sources", "", *means])
    for level, share in LEVELS.items():
        rows.append([f"multiples, {level} %", "all", *(f"{value:.2f}" for value in multiples(ratios, sources, share))])
    return rows


def _percent(held: Float64[ndarray, "n"]) -> str:
    return f"{100 * np.nanmean(held):.0f}" if np.isfinite(held).any() else "–"


def verdict_row(of: Measured) -> list[str]:
    """Numbers of photos with each verdict, and of wrong ones among the good."""
    verdicts = np.array(of.methods["joint"].verdicts)
    errors = of.truth.errors(of.methods["joint"].cameras)
    good = verdicts == "good"
    wrong = np.any([errors[name][good] > most for name, most in WRONG.items()], axis=0)
    off, _ = off_and_sigma(of)
    outside = (off > of.methods["joint"].half["95"])[good, :3].any(axis=1)
    counts = [str(int((verdicts == each).sum())) for each in ("good", "weak", "not trustworthy", "failed")]
    return [
        of.name,
        *counts,
        str(int((errors["focal_percent"][good] > 20).sum())),
        str(int(wrong.sum())),
        str(int(outside.sum())),
    ]


def table(titles: list[str], rows: list[list[str]]) -> str:
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def show(sets: list[Measured]) -> None:
    """Print the tables."""
    titles = ["set", "photos", "method", "tilt", "roll", "vfov", "focal %", "rays", "AUC roll", "AUC tilt", "AUC vfov"]
    print(table(titles, [row for each in sets for row in error_rows(each)]))
    excess = [cell for name in ("tilt", "roll", "focal %") for cell in (f"{name}, network / lines / joint", "excess")]
    print(table(["source", "photos", *excess], against_rows(sets)))
    print(table(["source left out", "photos", *(f"{name}, 68 / 95 %" for name in NUMBERS)], interval_rows(sets)))
    verdicts = [
        "good",
        "weak",
        "not trustworthy",
        "failed",
        "good, focal off by > 20 %",
        "good, wrong",
        "good, outside a 95 % interval",
    ]
    print(table(["source", *verdicts], [verdict_row(each) for each in by_source(sets)]))


def main() -> None:
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.joint_intervals")
    cuts = int(given.pop("cuts", 2))
    others, data = NetworkOptions.of(given), Path(os.environ["SEXTANT_DATA"])
    own = given.get("run", "zoo:calibration")
    calibrator = PhotoCalibrator.load(own) if others.network is None else calibrator_of_others(others)
    trained = [
        entry["file"]
        for files in read_card(model_file("zoo:calibration"))["data"].values()
        if isinstance(files, list)
        for entry in files
    ]
    began, sets = time.process_time(), list[Measured]()
    for name, folders in SETS.items():
        parts = [benchmark_calibration(calibrator, data / each, cuts=cuts, leave_out=trained) for each in folders]
        sets.append(measured(name, parts))
        for part in parts:
            for photo, reason in part.skipped.items():
                print(f"left out: {photo}: {reason}", file=sys.stderr)
    show(sets)
    print(f"{time.process_time() - began:.0f} s of CPU")


if __name__ == "__main__":
    main()
