"""Benchmark of all methods of a calibrator on a folder of photos with known cameras."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

import numpy as np

from sextant.applications.failures import FailedPhoto, attempted
from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_atomically, write_csv
from sextant.chapters.calibration.calibrator import PhotoCalibrator
from sextant.chapters.calibration.confidence import photo_camera
from sextant.chapters.calibration.data import CameraDistribution
from sextant.chapters.calibration.data.known_photos import KnownPhoto, known_photos
from sextant.chapters.calibration.finding import LEVELS, Finding
from sextant.chapters.calibration.inference import find_cameras
from sextant.chapters.calibration.jointly import Method, by_method
from sextant.chapters.calibration.metrics.photo_benchmark import (
    PUBLISHED_BY,
    Answers,
    Table,
    Truth,
    blame_table,
    error_table,
    interval_table,
    verdict_table,
    worst_table,
)
from sextant.chapters.calibration.network import CameraNetwork
from sextant.chapters.calibration.network_scale import fit_scale, write_scale
from sextant.chapters.calibration.other_networks import OtherNetwork
from sextant.composing.compose import compose, to_plain
from sextant.config.building import build_part
from sextant.tables import TextTable

#: numbers of a failed photo
NOTHING = (math.nan,) * 12


@dataclass(frozen=True, eq=False)
class PhotoBenchmark:
    """Estimates of every method for the photos of a folder.

    Attributes:
        folder: folder of the photos.
        truth: the ground-truth cameras.
        names: names of the photos.
        methods: estimates by method.
        skipped: reasons by photo that cannot be read.
    """

    folder: Path
    truth: Truth
    names: tuple[str, ...]
    methods: dict[str, Answers]
    skipped: dict[str, str] = field(default_factory=dict)

    def tables(self) -> dict[str, Table]:
        """The tables by title: errors and intervals; of the joint method verdicts, what is to blame, worst photos."""
        return {
            "Median error [95 % interval over independent photos] and AUC; *in italics*: published, each on photos of "
            f"its own ({PUBLISHED_BY})": error_table(self.truth, self.methods),
            "Truth inside the interval, %": interval_table(self.truth, self.methods),
            "Verdicts of the joint method": verdict_table(self.truth, self.methods["joint"]),
            "Which part is to blame where the joint method is wrong": blame_table(self.truth, self.methods),
            "The worst photos of the joint method": worst_table(self.truth, self.names, self.methods),
        }

    def markdown(self) -> str:
        """The tables under their titles."""
        return "\n".join(f"{title}:\n\n{TextTable(*table).markdown()}" for title, table in self.tables().items())

    def rows(self) -> list[dict[str, object]]:
        """The errors of each method on each photo."""
        found: list[dict[str, object]] = []
        for method, answers in self.methods.items():
            errors = self.truth.errors(answers.cameras)
            for i, name in enumerate(self.names):
                row = {"photo": name, "method": method, "verdict": answers.verdicts[i]}
                found.append(row | {key: float(values[i]) for key, values in errors.items()})
        return found


def benchmark_calibration(
    calibrator: PhotoCalibrator,
    folder: Path,
    *,
    sampling: str = "lopez_4x3",
    cuts: int = 7,
    seed: int = 0,
    leave_out: Sequence[str] = (),
    progress: Callable[[int], None] = lambda done: None,
) -> PhotoBenchmark:
    """Run lines alone, the network alone and both jointly on photos with known cameras.

    Args:
        calibrator: calibrator whose network is measured.
        folder: folder of photos or panoramas; see :mod:`sextant.chapters.calibration.data.known_photos`.
        sampling: distribution of the cameras of photos cut from panoramas.
        cuts: number of photos cut from each panorama.
        seed: seed of these cameras.
        leave_out: file name patterns of files to leave out.
        progress: is called with the number of photos done.

    Raises:
        UserError: there is no photo with a known camera, or a table of cameras is wrong.
    """
    config = to_plain(compose(["task=calibration", f"sampling={sampling}"]))
    distribution: CameraDistribution = build_part(config["sampling"])
    known: list[KnownPhoto] = []
    answers: dict[Method, list[tuple[tuple[float, ...], str]]] = {method: [] for method in reversed(get_args(Method))}
    skipped: dict[str, str] = {}
    for photo in known_photos(folder, distribution, cuts=cuts, seed=seed, leave_out=leave_out, skipped=skipped):
        (found,) = find_cameras(calibrator.network, [(photo.name, photo.image)], look_at_lines=True)
        for method, said in answers.items():
            said.append(_numbers(found, method, calibrator.network))
        known.append(_without_pixels(photo))
        progress(len(known))
    truth = Truth(
        np.array([[photo.tilt, photo.roll, photo.focal, photo.k1] for photo in known]),
        np.array([photo.image.shape[1] / photo.image.shape[0] for photo in known]),
        [photo.cluster for photo in known],
    )
    names = tuple(photo.name for photo in known)
    return PhotoBenchmark(folder, truth, names, {method: _answers(said) for method, said in answers.items()}, skipped)


def write_benchmark(found: PhotoBenchmark, output: Path) -> list[Path]:
    """Write ``benchmark.md`` (the tables) and ``benchmark.csv`` (the errors of each method on each photo).

    Raises:
        UserError: the disk is full, or the folder is not writable.
    """
    text, rows = f"# {found.folder.name}\n\n{found.markdown()}", found.rows()
    with telling_write_errors(output):
        write_atomically(output / "benchmark.md", lambda file: file.write(text.encode()))
        write_csv(output / "benchmark.csv", list(rows[0]), rows)
    return [output / "benchmark.md", output / "benchmark.csv"]


def write_network_scale(found: PhotoBenchmark, calibrator: PhotoCalibrator, path: Path) -> tuple[str, Path]:
    """Fit the scale of the spreads of a network of others to a benchmark and write it; returns its table and the file.

    Raises:
        UserError: the disk is full, or the folder is not writable.
    """
    fitted = fit_scale(found.truth, found.methods["network"])
    source = calibrator.network.source if isinstance(calibrator.network, OtherNetwork) else None
    with telling_write_errors(path.parent):
        write_scale(path, fitted, getattr(source, "card", {}), found.folder)
    title = "Scale of the network's spreads, and its errors inside their intervals with scales of the other sources, %"
    return f"{title}:\n\n{TextTable(*fitted.table()).markdown()}", path


def _numbers(
    found: Finding | FailedPhoto, method: Method, network: CameraNetwork | OtherNetwork
) -> tuple[tuple[float, ...], str]:
    """The camera and the half-widths of its intervals as one row, lengths in image heights; and the verdict."""
    if not isinstance(found, FailedPhoto):
        found = attempted(found.name, by_method, found, method)
    if isinstance(found, FailedPhoto):
        return NOTHING, "failed"
    camera = photo_camera(found, network)
    numbers = [math.radians(camera.tilt_deg), math.radians(camera.roll_deg), camera.focal_px / camera.height, camera.k1]
    for ends in (camera.interval_68, camera.interval_95):
        halves = ((pair[1] - pair[0]) / 2 for pair in (ends.tilt_deg, ends.roll_deg, ends.vfov_deg))
        numbers += [math.radians(half) for half in halves]
        numbers.append((ends.k1[1] - ends.k1[0]) / 2 / numbers[2] ** 2)
    return tuple(numbers), camera.verdict


def _without_pixels(photo: KnownPhoto) -> KnownPhoto:
    rows, columns = photo.image.shape[:2]
    shape = np.broadcast_to(np.zeros((1, 1, 3), np.uint8), (rows, columns, 3))
    return KnownPhoto(photo.name, photo.cluster, shape, photo.tilt, photo.roll, photo.focal, photo.k1)


def _answers(said: list[tuple[tuple[float, ...], str]]) -> Answers:
    numbers = np.array([row for row, _ in said])
    half = {level: numbers[:, 4 + 4 * i : 8 + 4 * i] for i, level in enumerate(LEVELS)}
    return Answers(numbers[:, :4], half, [verdict for _, verdict in said])
