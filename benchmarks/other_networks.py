"""Cameras from fields, rays, and a network of others: ``python -m benchmarks.other_networks``.

First, exact fields and rays of drawn cameras: largest errors of the fitted camera, and the time of a fit. Second, the
package's network taken as one of others: the scale of its spreads on photos with known cameras of ``SEXTANT_DATA``, and
the share of its errors inside their intervals with scales fitted without their source. Third, the joint camera on York
Urban with that network as the package's own, and as one of others with the scale of all other sets.
"""

import math
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import UInt8
from numpy import ndarray

from sextant.applications import PhotoCalibrator
from sextant.applications.failures import FailedPhoto
from sextant.baselines.calibration import CameraBelief, Observed, ObservedField, ObservedRays, map_points
from sextant.chapters.calibration.data.known_photos import KnownPhoto, known_photos
from sextant.chapters.calibration.finding import Finding
from sextant.chapters.calibration.inference import find_cameras
from sextant.chapters.calibration.metrics.photo_benchmark import Answers, Truth
from sextant.chapters.calibration.network_scale import NetworkScale, fit_scale
from sextant.chapters.calibration.other_networks import OtherNetwork
from sextant.composing.compose import compose, to_plain
from sextant.config.building import build_part
from sextant.console.arguments import parse_arguments
from sextant.geometry import CameraParameters, k2_of_k1
from sextant.geometry.distortion import max_distorted_radius
from sextant.geometry.perspective import perspective_bearings
from sextant.geometry.perspective_field import perspective_field
from sextant.tables import TextTable

CAMERAS, TESTED = 100, "york_urban"
SETS = (TESTED, "phone_gravity", "exif_focal", "camera_boards")
ASPECTS = (3 / 4, 1.0, 4 / 3, 16 / 9)


def drawn(count: int, seed: int = 0) -> Iterator[tuple[CameraParameters, float]]:
    """Cameras of many kinds, all of whose picture is before the fold of the lens, with their aspects."""
    rng = np.random.default_rng(seed)
    while count:
        numbers = (*rng.uniform(-0.6, 0.6, 2), math.exp(rng.uniform(-0.9, 0.9)), rng.uniform(-0.3, 0.1))
        camera, aspect = CameraParameters(*torch.tensor(numbers, dtype=torch.float64)), float(rng.choice(ASPECTS))
        fold = camera.focal * max_distorted_radius(camera.k1, k2_of_k1(camera.k1))
        if math.hypot(aspect, 1) / 2 < fold:
            count -= 1
            yield camera, aspect


def exact(camera: CameraParameters, aspect: float) -> tuple[ObservedField, ObservedRays]:
    """What a network without errors would say."""
    points = map_points(24, 32, aspect)
    field, sure = perspective_field(camera, torch.from_numpy(points)), np.full(len(points), 0.02)
    k1 = camera.k1[None]
    rays = perspective_bearings(torch.from_numpy(points), camera.focal[None], k1, k2_of_k1(k1))
    observed = ObservedField(points, field.latitude.numpy(), field.up.numpy(), sure, sure)
    return observed, ObservedRays(points, rays.numpy())


def exact_rows() -> list[list[str]]:
    """Largest errors over the cameras, and the mean time of a fit."""
    off, taken = np.zeros((2, 4)), np.zeros(2)
    for camera, aspect in drawn(CAMERAS):
        for i, said in enumerate[Observed](exact(camera, aspect)):
            began = time.perf_counter()
            found = said.belief()
            taken[i] += (time.perf_counter() - began) / CAMERAS
            numbers = np.array([found.tilt, found.roll, found.focal, found.k1_hat * found.focal**2])
            off[i] = np.maximum(off[i], np.abs(numbers - [float(each) for each in camera]))
    shown = [["–" if i and k < 2 else f"{value:.0e}" for k, value in enumerate(row)] for i, row in enumerate(off)]
    return [[name, *shown[i], f"{taken[i]:.2f} s"] for i, name in enumerate(("field", "rays"))]


class AsOthers:
    """The package's network as one of others: a camera with half its 68 % intervals as spreads."""

    def __init__(self) -> None:
        self.own = PhotoCalibrator.load().network

    def predict(self, image: UInt8[ndarray, "h w 3"]) -> CameraBelief:
        (found,) = find_cameras(self.own, [("photo", image)])
        if isinstance(found, FailedPhoto):
            raise found.error
        zoom = found.zoom
        tilt, roll, focal, k1 = map(float, found.camera)
        seen, whole = (4 * each / (4 * each**2 + 1) for each in (focal, focal * zoom))  # |d vfov / d ln f|
        half = found.half["68"] * [1, 1, whole / seen, zoom**-2]
        return CameraBelief(tilt, roll, focal * zoom, k1 / (focal * zoom) ** 2, tuple(map(float, half)))  # type: ignore[arg-type]


def photos_of(names: tuple[str, ...]) -> Iterator[tuple[str, KnownPhoto]]:
    """The photos of these sets, each with its source."""
    sampling: Any = build_part(to_plain(compose(["task=calibration", "sampling=lopez_4x3"]))["sampling"])
    for name in names:
        folder = Path(os.environ["SEXTANT_DATA"]) / name
        for photo in known_photos(folder, sampling, cuts=2, seed=0, leave_out=(), skipped={}):
            yield photo.cluster if name == "exif_focal" else name, photo


def scale_on(source: AsOthers, names: tuple[str, ...]) -> NetworkScale:
    """The scale of a network's spreads on these sets."""
    network, cameras, truth, half, sources = OtherNetwork(source), [], [], [], []
    for name, photo in photos_of(names):
        (found,) = find_cameras(network, [(photo.name, photo.image)])
        if isinstance(found, Finding):
            cameras.append([float(each) for each in found.camera])
            truth.append([photo.tilt, photo.roll, photo.focal, photo.k1])
            half.append(found.half["68"])
            sources.append(name)
    known = Truth(np.array(truth), np.ones(len(truth)), sources)
    return fit_scale(known, Answers(np.array(cameras), {"68": np.array(half)}, [""] * len(truth)))


def joint_rows(source: AsOthers, scale: NetworkScale) -> list[list[str]]:
    """Median errors of the joint camera and shares inside its 68 and 95 % intervals."""
    rows = []
    named = {
        "the package's own": PhotoCalibrator.load(),
        "one of others, unscaled": PhotoCalibrator(source),
        "one of others, scaled": PhotoCalibrator(source, scale=scale.values),
    }
    for name, calibrator in named.items():
        off, inside = [], []
        for _, photo in photos_of((TESTED,)):
            found = calibrator.calibrate(photo.image)
            tilt, focal = math.degrees(photo.tilt), photo.focal * found.height
            off.append([abs(found.tilt_deg - tilt), 100 * abs(found.focal_px / focal - 1)])
            for level in (found.interval_68, found.interval_95):
                ends = (level.tilt_deg, level.focal_px)
                inside.append([low <= true <= high for (low, high), true in zip(ends, (tilt, focal), strict=True)])
        shares = 100 * np.array(inside).reshape(-1, 2, 2).mean(0)
        told = [" / ".join(f"{share:.0f}" for share in shares[:, k]) for k in (0, 1)]
        middle = np.median(off, axis=0)
        rows.append([name, f"{middle[0]:.2f}", f"{middle[1]:.1f}", *told])
    return rows


def main() -> None:
    parse_arguments(sys.argv[1:], {}, "python -m benchmarks.other_networks")
    titles = ["observations", "tilt (rad)", "roll (rad)", "focal (heights)", "k1", "time"]
    print(TextTable(titles, exact_rows()).markdown())
    source = AsOthers()
    print(TextTable(*scale_on(source, SETS).table()).markdown(), flush=True)
    titles = ["network", "tilt (°)", "focal (%)", "tilt inside 68 / 95 %", "focal inside 68 / 95 %"]
    print(TextTable(titles, joint_rows(source, scale_on(source, SETS[1:]))).markdown())


if __name__ == "__main__":
    main()
