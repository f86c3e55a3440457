"""Fit and judge the verdicts on joint cameras: ``python -m benchmarks.joint_verdicts [cache=<file>] [write=true]``.

On the photos of ``benchmarks.joint_intervals`` and two further crops of each of its panoramas, the model of errors
(``chapters/calibration/error_model.py``) and the threshold of *good* are fitted to all sources but one, and judged on
that one, by a rule that was fixed before (lab/calibration.md). ``write=true`` writes those fitted to all sources to
``chapters/calibration/verdicts.json``, from which the package reads them.
"""

import os
import pickle
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int
from numpy import ndarray

from benchmarks.error_model_fit import fit_error_model, likely_right
from benchmarks.joint_intervals import SCENES, SETS, table
from sextant.applications import PhotoCalibrator
from sextant.applications.failures import FailedPhoto, attempted
from sextant.atomic_files import write_json
from sextant.chapters.calibration.confidence import UNLIKELY, beside_probabilities
from sextant.chapters.calibration.data.known_photos import KnownPhoto, known_photos
from sextant.chapters.calibration.inference import find_cameras
from sextant.chapters.calibration.jointly import by_method
from sextant.chapters.calibration.metrics.photo_benchmark import WRONG as WRONG_ERRORS
from sextant.chapters.calibration.metrics.photo_benchmark import Truth
from sextant.chapters.calibration.verdict_probabilities import FITTED, RIGHT, WRONG, Verdicts, evidence_on_errors
from sextant.composing.compose import compose, to_plain
from sextant.config.building import build_part
from sextant.console.arguments import parse_arguments
from sextant.zoo import model_file, read_card

KEYS = {
    "cache": "file of the answers, read if it is there and written otherwise",
    "write": "true: write the numbers fitted to all sources into the package",
}
#: crops of each panorama; the first is that of ``benchmarks.joint_intervals cuts=1``
CUTS = 3
#: most wrong answers among the good ones on average, and the thresholds tried
MOST, GRID = 0.02, np.arange(50, 100) / 100
VERDICTS = ("good", "weak", "not trustworthy")


@dataclass(frozen=True, eq=False)
class Judged:
    """Joint cameras of n photos, with what their verdicts are judged by.

    Attributes:
        errors: of tilt, roll (radians) and log focal length; nan where unknown.
        sigma, covariates: as :func:`~sextant.chapters.calibration.verdict_probabilities.evidence_on_errors` gives them.
        wrong: whether an error is above its limit.
        allowed: best verdict that all else allows.
        sources: source of each photo.
        further: whether it is a further crop of a panorama.
    """

    errors: Float64[ndarray, "n 3"]
    sigma: Float64[ndarray, "n 3"]
    covariates: Float64[ndarray, "n 3 k"]
    wrong: Bool[ndarray, "n"]
    allowed: Int[ndarray, "n"]
    sources: ndarray
    further: Bool[ndarray, "n"]

    def fitted(self, *left_out: str) -> Verdicts:
        """The models of errors by all sources but some, without a threshold."""
        kept = ~np.isin(self.sources, left_out)
        owners = self.sources[kept].tolist()
        tilt, roll, focal = (
            fit_error_model(self.errors[kept, k], self.sigma[kept, k], self.covariates[kept, k], owners)
            for k in range(3)
        )
        return Verdicts((tilt, roll, focal), 1.0)

    def chances(self, by: Verdicts, limits: tuple[float, float, float], own: ndarray) -> Float64[ndarray, "m"]:
        """Probabilities that the errors of some photos are within limits."""
        return np.asarray(by.within(limits, self.sigma[own], self.covariates[own]).prod(axis=1))

    def threshold(self, fits: dict[frozenset[str], Verdicts], *left_out: str) -> float:
        """The threshold by all sources but some, each by widths fitted without it."""
        right = np.zeros(len(self.wrong))
        for source in set(self.sources) - {*left_out}:
            own, left = self.sources == source, frozenset({source, *left_out})
            if left not in fits:
                fits[left] = self.fitted(*left)
            right[own] = self.chances(fits[left], RIGHT, own)
        kept = ~np.isin(self.sources, left_out) & (self.allowed == 0)
        return likely_right(right[kept], self.wrong[kept], MOST, GRID)


def photos() -> Iterator[tuple[str, KnownPhoto]]:
    """All photos, each with the name of its set."""
    sampling: Any = build_part(to_plain(compose(["task=calibration", "sampling=lopez_4x3"]))["sampling"])
    trained = [
        entry["file"]
        for files in read_card(model_file("zoo:calibration"))["data"].values()
        if isinstance(files, list)
        for entry in files
    ]
    for name, folders in SETS.items():
        for folder in folders:
            path = Path(os.environ["SEXTANT_DATA"]) / folder
            for photo in known_photos(path, sampling, cuts=CUTS, seed=0, leave_out=trained, skipped={}):
                yield name, photo


def measured() -> Judged:
    """The joint camera of each photo; those that fail are left out, and named."""
    calibrator, rows = PhotoCalibrator.load(), list[tuple[Any, ...]]()
    for name, photo in photos():
        (found,) = find_cameras(calibrator.network, [(photo.name, photo.image)], look_at_lines=True)
        joint = found if isinstance(found, FailedPhoto) else attempted(found.name, by_method, found, "joint")
        if isinstance(joint, FailedPhoto):
            print(f"left out: {joint.name}: {joint.error}", file=sys.stderr)
            continue
        tilt, roll, focal, _ = map(float, joint.camera)
        sigma, covariates = evidence_on_errors(joint)
        focal *= joint.zoom
        scene = photo.name.partition("__")[0]
        truth = Truth(np.array([[photo.tilt, photo.roll, photo.focal, np.nan]]), np.ones(1), [""])
        off = truth.errors(np.array([[tilt, roll, focal, 0.0]]))
        rows.append((
            [tilt - photo.tilt, roll - photo.roll, np.log(focal / photo.focal)], sigma, covariates,
            any(off[error][0] > most for error, most in WRONG_ERRORS.items()),
            beside_probabilities(joint, calibrator.network)[0],
            scene if scene in SCENES else name, "#" in photo.name and not photo.name.endswith("#0"),
        ))  # fmt: skip
    return Judged(*(np.array(column) for column in zip(*rows, strict=True)))


def judged(of: Judged) -> tuple[ndarray, dict[str, float]]:
    """The verdict on each photo, by widths and a threshold of the other sources; and these thresholds."""
    verdicts, thresholds = np.zeros(len(of.wrong), int), dict[str, float]()
    fits = dict[frozenset[str], Verdicts]()
    for source in np.unique(of.sources):
        own, fitted = of.sources == source, of.fitted(source)
        thresholds[source] = of.threshold(fits, source)
        right, possible = of.chances(fitted, RIGHT, own), of.chances(fitted, WRONG, own)
        verdicts[own] = np.where(possible < UNLIKELY, 2, np.where(right >= thresholds[source], 0, 1))
    return np.maximum(verdicts, of.allowed), thresholds


def rows_of(of: Judged, verdicts: ndarray, titles: Sequence[tuple[str, ndarray]]) -> list[list[str]]:
    """Photos with each verdict among some, and how many of these are wrong."""
    return [
        [title, str(int(own.sum())), *(f"{(own & at).sum()}, {(own & at & of.wrong).sum()}" for at in each)]
        for each in [[verdicts == k for k in range(3)]]
        for title, own in titles
    ]


def main() -> None:
    given = parse_arguments(sys.argv[1:], KEYS, "python -m benchmarks.joint_verdicts")
    cache = Path(given["cache"]) if "cache" in given else None
    of = pickle.loads(cache.read_bytes()) if cache and cache.exists() else measured()
    if cache and not cache.exists():
        cache.write_bytes(pickle.dumps(of))
    verdicts, thresholds = judged(of)
    first = [(source, ~of.further & (of.sources == source)) for source in np.unique(of.sources)]
    every = [("all", ~of.further), ("further crops", of.further)]
    rows = rows_of(of, verdicts, [*first, *every])
    shown = [[*row, f"{thresholds[row[0]]:.2f}" if row[0] in thresholds else ""] for row in rows]
    print(table(["source left out", "photos", *(f"{each}, wrong" for each in VERDICTS), "threshold"], shown))
    whole = of.fitted()
    fitted = Verdicts(whole.models, of.threshold({}))
    print(fitted.row())
    if given.get("write") == "true":
        about = {"network": "zoo:calibration", "photos": len(of.wrong), "sources": len(set(of.sources))}
        write_json(FITTED, {**about, **fitted.row()})


if __name__ == "__main__":
    main()
