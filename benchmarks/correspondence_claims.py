"""Claims of correspondences, on sources that took no part in their development.

``python -m benchmarks.correspondence_claims claim=poses|places [output=<folder>] [keep=<folder>]``

``claim=poses``: frames of rendered offices (:mod:`benchmarks.posed_office`, fresh seeds) and, beside, of three real
scenes (:mod:`benchmarks.posed_photos`, measured before). Compared are the errors of the pose by correspondences and of
the better of two poses by descriptors: that of the most similar image, and the mean of the three most similar ones. A
frame that is not located has the pose of the most similar image.

``claim=places``: recall@1 without and with re-ranking by XFeat at 640 pixels, on pairs of real traverses that were not
compared before: maps and queries exchanged, other traverses of one walk, other stretches, the floors of a tower.

Each writes ``recorded.csv``, ``replicates.csv`` and ``dates.csv``, of which ``sextant claims`` makes its verdicts.
"""

import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from numpy import ndarray
from scipy.spatial.transform import Rotation

from benchmarks import posed_office, reranking
from benchmarks.machine import describe_machine
from benchmarks.place_sets import ImageSet, image_sets, interval
from benchmarks.posed_photos import PARTS, scenes
from benchmarks.replicates import Row, now, over_worlds, store
from sextant import PlaceMap, PoseMap
from sextant.applications.pixels import as_pixels
from sextant.chapters.localization.pose_map import _described
from sextant.chapters.places.photo_features import PhotoFeatures
from sextant.console.arguments import parse_arguments
from sextant.correspondence import Pinhole
from sextant.correspondence.left_out import displacement
from sextant.correspondence.reranking import reranked
from sextant.evaluation.positives import Positives
from sextant.tables import TextTable

USAGE = "python -m benchmarks.correspondence_claims claim=poses|places [output=<folder>] [keep=<folder>]"
KEYS = {
    "claim": "poses or places",
    "output": "folder for the tables (default: results/localization/correspondences, results/places/reranking)",
    "keep": "places: folder in which inliers are kept, so that an interrupted measurement goes on",
    "first": "poses: seed of the first office (default: 513)",
    "offices": "poses: number of offices (default: 4)",
}
#: images whose poses are averaged
AVERAGED = 3
#: of every so many queries, whose frames are neighbours, one is taken
EVERY = {"IE Tower, floor": 9, "Corridor, exchanged": 1}
SIZE = (320, 240)
#: poses of an office's drives, 4 cm apart, from one image to the next
SPARSE = 24
#: points of recall by which a set is harmed
HARMED = 1.0


def main(arguments: list[str]) -> None:
    given = parse_arguments(arguments, KEYS, USAGE)
    torch.set_num_threads(1)
    print(describe_machine(), flush=True)
    begun, data = now(), Path(os.environ["SEXTANT_DATA"])
    if given["claim"] == "places":
        output = Path(given.get("output", "results/places/reranking"))
        replicates, rows = places(data, Path(given["keep"]) if "keep" in given else None)
    else:
        output = Path(given.get("output", "results/localization/correspondences"))
        first = int(given.get("first", "513"))
        replicates, rows = poses(data / "strecha_posed", range(first, first + int(given.get("offices", "4"))))
    store(output, replicates, rows, begun, now())


# -- poses -------------------------------------------------------------------------------------------------------------


def poses(folder: Path, seeds: range) -> tuple[TextTable, list[Row]]:
    """Errors of each office and scene, and what the claim rests on: per cent less error than by descriptors."""
    table, saved = [], dict[str, list[float]]()
    for seed in seeds:
        images, world_from_camera, kind = posed_office.office(seed, *SIZE, every=SPARSE)
        focal = SIZE[1] / 2 / np.tan(np.deg2rad(posed_office.VFOV_DEG / 2))
        lens, mapped = Pinhole.centred(*SIZE, focal), np.flatnonzero(kind < 0)
        built = PoseMap.from_images(list(images[mapped]), world_from_camera[mapped], lens, side=640)
        for number, name in enumerate(posed_office.NAMES):
            asked = np.flatnonzero(kind == number)
            rows = [compared(built, images[k], world_from_camera[k], lens) for k in asked]
            _note(table, saved, f"office {seed}", name, np.array(rows))
    for scene, (files, world_from_camera, camera) in scenes(folder).items():
        asked = np.arange(len(files)) % PARTS == 0
        rest = np.flatnonzero(~asked)
        built = PoseMap.from_images([files[k] for k in rest], world_from_camera[rest], camera)
        rows = [compared(built, files[k], world_from_camera[k], camera) for k in np.flatnonzero(asked)]
        _note(table, saved, scene, "scenes", np.array(rows))
    source = "replicates.csv: 100 (1 - correspondences / descriptors), in degrees their difference"
    heads = ["replicate", "queries", "number", "located"]
    heads += [f"{by}_{unit}" for unit in ("m", "deg") for by in ("correspondences", "nearest", "mean_of_three")]
    return TextTable(heads, table), [over_worlds(name, values, source) for name, values in saved.items()]


def compared(built: PoseMap, photo: object, pose: ndarray, camera: object) -> list[float]:
    """Whether a photo is located, and the errors in metres and degrees by correspondences, nearest image, and mean."""
    pixels = as_pixels(photo)  # type: ignore[arg-type]
    similarity = built._descriptors @ _described(built._described_by, pixels)[0]
    near = built.posed.poses[np.argsort(-similarity, kind="stable")[:AVERAGED]]
    mean = np.eye(4)
    mean[:3, :3], mean[:3, 3] = Rotation.from_matrix(near[:, :3, :3]).mean().as_matrix(), near[:, :3, 3].mean(0)
    found = built.locate(photo, camera).world_from_camera  # type: ignore[arg-type]
    errors = [displacement(each, pose) for each in (near[0] if found is None else found, near[0], mean)]
    metres = [float(np.linalg.norm(error[:3])) for error in errors]
    return [float(found is not None), *metres, *(float(np.rad2deg(np.linalg.norm(error[3:]))) for error in errors)]


def _note(table: list[Row], saved: dict[str, list[float]], world: str, name: str, rows: ndarray) -> None:
    """The medians of a world, and how much smaller they are than those of the better pose by descriptors.

    In metres per cent, in degrees their difference: robots repeat their headings, so that the most similar image may be
    off by 0.
    """
    medians = np.median(rows, axis=0)
    table.append([world, name, str(len(rows)), f"{rows[:, 0].mean():.3f}", *(f"{each:.4f}" for each in medians[1:])])
    saved.setdefault(f"poses/{name}_metres", []).append(100 * (1 - medians[1] / min(medians[2:4])))
    saved.setdefault(f"poses/{name}_degrees", []).append(min(medians[5:7]) - medians[4])
    print(" | ".join(table[-1]), flush=True)


# -- places ------------------------------------------------------------------------------------------------------------


def places(data: Path, kept: Path | None) -> tuple[TextTable, list[Row]]:
    """Queries won and lost in each set, and what the claim rests on: points of recall@1 gained."""
    network = PlaceMap.load("zoo:places")
    describer, size = network.descriptor.describer, (network.size.height, network.size.width)
    assert describer is not None
    table, gains = [], dict[str, list[float]]()
    for each in fresh_sets(data):
        features = PhotoFeatures(reranking.extractor("xfeat", 640, network))
        similarities = each.described(describer.describe, *size).similarities()
        every = EVERY.get(each.name, 3)
        found = reranking.counted(each, similarities, features, every, False, kept, network.model, {})
        before, numbers = found.right[:, 0], np.arange(len(found.right))
        after = found.right[numbers, [reranked(counts)[0] for counts in found.inliers]]
        gain = 100 * (after.astype(float) - before)
        gains.setdefault(each.family, []).append(float(gain.mean()))
        low, high = interval(gain)
        counts = (int((after & ~before).sum()), int((before & ~after).sum()))
        told = [f"{value:.2f}" for value in (100 * before.mean(), 100 * after.mean(), gain.mean(), low, high)]
        table.append([each.name, each.family, str(len(gain)), *told, *map(str, counts), f"{found.per_query:.2f}"])
        print(" | ".join(table[-1]), flush=True)
    source = "replicates.csv: gain"
    every_set = [gain for of_family in gains.values() for gain in of_family]
    harmed = str(sum(gain < -HARMED for gain in every_set))
    rows = [
        over_worlds("reranking/gain", every_set, source),
        over_worlds("reranking/gain_of_families", [float(np.mean(each)) for each in gains.values()], source),
        ["reranking/sets_harmed", "counted", "", harmed, "", "", "0", source],
    ]
    heads = ["set", "family", "queries", "recall", "reranked", "gain", "low", "high", "won", "lost", "cpu_s_a_query"]
    return TextTable(heads, table), rows


def fresh_sets(data: Path) -> list[ImageSet]:
    """Pairs of real traverses that were not compared before the claim."""
    sets = {each.name: each for each in image_sets(data, floors=True, corridor=True)}
    garden = {
        name: sorted((data / "gardens_point" / name).iterdir()) for name in ("day_left", "day_right", "night_right")
    }
    found = []
    for queries, maps in (("night_right", "day_left"), ("day_left", "night_right")):
        frames = np.arange(len(garden[maps]))
        near = Positives.within_frames(np.arange(len(garden[queries])), frames, 2)
        name = f"Gardens Point, {queries} in {maps}"
        found.append(ImageSet(name, "gardens_point", garden[maps], garden[queries], near))
    found += [_exchanged(sets["Essex"]), _exchanged(sets["Corridor"])]
    seasons = [sorted((data / "nordland" / season).iterdir()) for season in ("summer", "winter")]
    for first, ((maps, queries), told) in (
        (0, (seasons, "winter in summer")),
        (800, (seasons[::-1], "summer in winter")),
    ):
        frames = np.arange(375)
        near, part = Positives.within_frames(frames, frames, 1), slice(first, first + 375)
        found.append(ImageSet(f"Nordland, {first} on, {told}", "nordland", maps[part], queries[part], near))
    return [*found, sets["IE Tower, floor"]]


def _exchanged(each: ImageSet) -> ImageSet:
    """The set with map and queries exchanged; only queries whose place is in the map."""
    near: list[list[int]] = [[] for _ in each.maps]
    for query in range(len(each.queries)):
        for image in each.positives[query]:
            near[int(image)].append(query)
    asked = [image for image, queries in enumerate(near) if queries]
    positives = Positives.from_lists([np.array(near[image]) for image in asked], len(each.queries))
    return ImageSet(
        f"{each.name}, exchanged", each.family, each.queries, [each.maps[image] for image in asked], positives
    )


if __name__ == "__main__":
    main(sys.argv[1:])
