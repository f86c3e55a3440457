"""Commands that fit a folder of photos, poses or videos."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from sextant.config.override_words import override
from sextant.data.name_matching import match_names
from sextant.data.photos.header import PhotoHeader
from sextant.data.reconstructions import NAMED_FORMATS
from sextant.tables import counted
from sextant.tools.inspection.drives import localization
from sextant.tools.inspection.photos import camera_groups, described, fit_for_calibration
from sextant.tools.inspection.poses import FoundPoses
from sextant.tools.inspection.seen import Seen
from sextant.tools.inspection.suggestion import Suggestion, command, outputs
from sextant.tools.inspection.times import FolderOfPhotos
from sextant.tools.inspection.traverses import ImageFolders, image_folders
from sextant.user_files import table_header

#: files of a dataset in its published layout, below the folder that ``paths.data`` names
STANDARD = {
    "dataset=mnist": "MNIST/raw/train-images-idx3-ubyte",
    "dataset=cifar10": "cifar-10-batches-py/data_batch_5",
    "task=localization dataset=cold": "cold/seq1_night1.json",
}


def known_cameras(folder: Path, tables: Sequence[Path], headers: Mapping[Path, PhotoHeader]) -> dict[Path, str]:
    """Folders of photos with known cameras, and the files that state them.

    See :mod:`sextant.chapters.calibration.data.known_photos`.
    """
    found: dict[Path, str] = {}
    for file in tables:
        beside = any(each.is_relative_to(file.parent) for each in headers)
        if beside and (file.name in ("K.txt", "calibration_computed.json") or "f_px" in _columns(folder / file)):
            found.setdefault(file.parent, file.name)
    return found


def level_panoramas(folder: Path, tables: Sequence[Path], panoramas: Sequence[Path]) -> dict[Path, str]:
    """Folders with a table of panoramas that has a column ``file``, but no cameras."""
    inside = {path.parent for path in panoramas}
    columns = {file: _columns(folder / file) for file in tables if file.parent in inside}
    return {file.parent: file.name for file, names in columns.items() if "file" in names and "f_px" not in names}


def standard_sets(folder: Path) -> dict[str, Path]:
    """Options for each published dataset in a folder, or that the folder is part of, with its ``paths.data``."""
    here = folder.resolve()
    found: dict[str, Path] = {}
    for overrides, file in STANDARD.items():
        for base in (here, *here.parents[:2]):
            whole = base / file
            if os.path.isfile(whole) and whole.is_relative_to(here):  # False without permission to read
                found[overrides] = base
    return found


def _columns(path: Path) -> set[str]:
    """The column names of a CSV file; empty for any other file."""
    if path.suffix.lower() != ".csv":
        return set()
    return set(table_header(path))


#: largest number of commands
MOST = 3
#: words that the name of a reference contains
REFERENCE = ("ground", "gt", "truth", "ref", "poses")


def trajectory_pairs(seen: Seen) -> Iterator[Suggestion]:
    """``sextant trajectory`` for pairs that have frames in common."""
    usable = [each for each in seen.poses if not each.problem and each.poses is not None]
    pairs = [pair for pair in combinations(usable, 2) if _same_frames(*pair)]
    if not pairs:
        return
    commands = []
    for number, pair in enumerate(pairs[:MOST], 1):
        files = [each.file for each in sorted(pair, key=lambda each: not _is_reference(each))]
        figure = "figure=plan.png" if number == 1 else f"figure=plan_{number}.png"
        commands.append(command("trajectory", *(str(seen.folder / file) for file in files), figure))
    why = f"{len(pairs):,} pairs of files have poses of the same frames; the reference comes first"
    yield Suggestion("compare two trajectories", why, tuple(commands))


def _same_frames(one: FoundPoses, other: FoundPoses) -> bool:
    if one.images is not None and other.images is not None and one.images != other.images:
        return False  # two drives
    if one.format in NAMED_FORMATS and other.format in NAMED_FORMATS:
        same = match_names(one.names, other.names)
        return any(row is not None for row in same.rows) and one.file.with_suffix("") != other.file.with_suffix("")
    if one.format != other.format:
        return False
    if one.times_s is not None and other.times_s is not None:
        return one.times_s[0] <= other.times_s[1] and other.times_s[0] <= one.times_s[1]
    first, second = one.file.stem, other.file.stem
    return one.count == other.count and (first in second or second in first)


def _is_reference(poses: FoundPoses) -> bool:
    name = poses.file.as_posix().lower()
    return any(word in name for word in REFERENCE)


#: shorter side that at least half of the photos must have for calibration to be worth a command, pixels
SMALLEST_PHOTO = 200
#: largest number of commands for folders of one camera each
CAMERAS = 4
#: least number of images of a class, panoramas and focal lengths that are worth a command
LEAST_OF_A_CLASS, LEAST_PANORAMAS, LEAST_FOCALS = 5, 3, 5
#: number of classes up to which each needs as many images as there are classes; of more, each needs this many
MANY_CLASSES = 20
#: batch sizes by default, of classifiers and of calibration, which cuts that many photos from each panorama
BATCH, BATCH_OF_CROPS, CROPS = 32, 64, 8
#: names of the frames of a video; largest time in seconds between frames
FRAME, BETWEEN_FRAMES = re.compile(r"(?:^|[^a-z])frame[_-]?\d+$", re.IGNORECASE), 2.0


def suggestions(seen: Seen) -> Iterator[Suggestion]:
    """Tasks that fit, those with the fewest requirements first."""
    photos = {file: header for file, header in seen.headers.items() if file not in set(seen.panoramas)}
    folders = image_folders(seen)
    yield from _calibration(seen)
    yield from _calibration_of_videos(seen)
    yield from _benchmark(seen, photos)
    yield from _panoramas(seen)
    yield from _places(seen, folders)
    yield from localization(seen)
    yield from _classes(seen, folders)
    yield from _example(seen, photos)
    yield from trajectory_pairs(seen)
    for overrides, base in standard_sets(seen.folder).items():
        words = [*overrides.split(), f"paths.data={override(base)}"]
        yield Suggestion(
            "train on a published set", f"{words[-2]} is here in its published layout", (command("train", *words),)
        )


def _calibration(seen: Seen) -> Iterator[Suggestion]:
    photos = fit_for_calibration(seen.headers, seen.panoramas)
    fine = sum(min(each.width, each.height) >= SMALLEST_PHOTO for each in photos.values())
    if not fine or fine < len(photos) / 2:
        return
    by_folder: dict[Path, list[PhotoHeader]] = {}
    for file, header in photos.items():  # the commands take the small ones too
        by_folder.setdefault(file.parent, []).append(header)
    groups = camera_groups(list(photos.values()))
    each_its_own = all(len(camera_groups(headers)) == 1 and len(headers) > 1 for headers in by_folder.values())
    commands, why = list[str](), counted(len(photos), "photo")
    if len(groups) > 1 and each_its_own and 1 < len(by_folder) <= CAMERAS:
        why += ", each folder of one camera"
        for place, output in outputs("calibrated", seen.folder, by_folder).items():
            commands.append(command("predict", input=seen.folder / place, output=output, camera="one"))
    else:
        one = {"camera": "one"} if len(groups) == 1 and len(photos) > 1 else {}
        if one:
            unnamed = "of one size: if one camera with one zoom took them all"
            why += f" of one camera ({groups[0].camera})" if groups[0].camera else f" {unnamed}"
        elif len(photos) > 1:
            why += f" of {described(groups)}, each by itself"
        commands.append(command("predict", input=seen.given, output="calibrated", **one))
    if all(header.focal_px for header in photos.values()):
        why += "; all have a focal length in EXIF: focal_prior=exif uses it"
    if any(header.gravity == "accelerometer (Apple)" for header in photos.values()):
        why += "; gravity_prior=exif uses the accelerometer of those that have it"
    yield Suggestion("calibrate the photos", why, tuple(commands))


def _calibration_of_videos(seen: Seen) -> Iterator[Suggestion]:
    fine = [Path(each.name) for each in seen.videos if min(each.width, each.height) >= SMALLEST_PHOTO]
    if fine:
        calibrated = outputs("calibrated", seen.folder, fine)
        yield Suggestion(
            "calibrate the camera of a video",
            "some of its frames, as photos of one camera",
            tuple(command("predict", input=seen.folder / each, output=calibrated[each]) for each in fine[:CAMERAS]),
        )


def _benchmark(seen: Seen, photos: dict[Path, PhotoHeader]) -> Iterator[Suggestion]:
    known = known_cameras(seen.folder, seen.files.tables, photos)
    known |= level_panoramas(seen.folder, seen.files.tables, seen.panoramas)
    if not known and sum(header.focal_px is not None for header in photos.values()) >= LEAST_FOCALS:
        known = {Path(): "focal lengths in EXIF"}
    if known:
        own = {place: {"output": to} for place, to in outputs("benchmark", seen.folder, known).items()}
        commands = [
            command("benchmark", "calibration", folder=seen.folder / place, **(own[place] if len(known) > 1 else {}))
            for place in known
        ]
        why = f"ground truth beside the photos: {', '.join(dict.fromkeys(known.values()))}"
        yield Suggestion("measure calibration on photos of known cameras", why, tuple(commands))


def _panoramas(seen: Seen) -> Iterator[Suggestion]:
    around = set(seen.panoramas)
    if len(around) < LEAST_PANORAMAS:
        return
    if len(around) == len(seen.headers):
        pure = [Path()]
    else:
        pure = [f.folder for f in seen.folders if around.issuperset(f.files) and len(f.files) >= LEAST_PANORAMAS]
    commands = [
        command(
            "train",
            "task=calibration",
            "dataset=panorama_folder",
            f"dataset.folder={override(seen.folder / each)}",
            *_smaller_batch(len([file for file in around if file.is_relative_to(each)]) // 2 * CROPS, BATCH_OF_CROPS),
        )
        for each in pure
    ]
    why = f"{counted(len(around), 'panorama')}, from which photos of known cameras are cut; they must be level"
    if not pure:
        why += "; first move them into a folder of their own"
    yield Suggestion("train a calibration network on the panoramas", why, tuple(commands))


def _places(seen: Seen, folders: ImageFolders) -> Iterator[Suggestion]:
    if len(folders.traverses) < 2:
        return
    reference, *others = folders.traverses
    known = {} if folders.places == "none" else {"places": folders.places}
    commands = [
        command(
            "predict", run="zoo:places", map=seen.folder / reference, queries=seen.folder / other,
            output=f"matches/{other.name}", **known,
        )
        for other in others[:CAMERAS]
    ]  # fmt: skip
    said = {
        "name": "equal names are assumed to be equal places",
        "csv": "their tables state where each image was taken",
        "gps": "EXIF states where each image was taken",
        "utm": "their names state where each image was taken",
        "none": "add places=order if the i-th images show one place",
    }
    why = f"{len(others) + 1} folders, {reference.as_posix()} as the map; {said[folders.places]}"
    yield Suggestion("recognise places", f"{why}; with the network of the package", tuple(commands))


def _classes(seen: Seen, folders: ImageFolders) -> Iterator[Suggestion]:
    least = min(max(LEAST_OF_A_CLASS, len(folders.classes)), MANY_CLASSES)
    if len(folders.classes) < 2 or min(folders.classes.values()) < least:
        return
    if _of_videos([each for each in seen.folders if each.folder.is_relative_to(folders.base)]):
        return  # places, by their frames: neighbours of a frame would be in training and test alike
    words: tuple[str, ...] = ("dataset=image_folder", f"dataset.folder={override(seen.folder / folders.base)}")
    words += _smaller_batch(sum(folders.classes.values()) // 2, BATCH)
    names = sorted(folders.classes)
    why = f"{counted(len(names), 'folder')} of images, {names[0]} to {names[-1]}: if each is a class"
    yield Suggestion("classify images", why, (command("train", *words),))


def _smaller_batch(surely: int, usual: int) -> tuple[str, ...]:
    """The batch size, where what is surely left for training, once some is held out, does not fill the usual one."""
    return () if surely >= usual else (f"trainer.batch_size={2 ** (surely.bit_length() - 1)}",)


def _of_videos(folders: Sequence[FolderOfPhotos]) -> bool:
    """Whether most images are frames of videos, by their names, or by times that follow each other closely."""
    frames = 0
    for each in folders:
        steps = np.abs(np.diff(each.times_s or ()))
        close = bool(steps.size) and 0 < np.median(steps) <= BETWEEN_FRAMES
        frames += len(each.files) if close else sum(bool(FRAME.search(file.stem)) for file in each.files)
    return frames > sum(len(each.files) for each in folders) / 2


def _example(seen: Seen, photos: dict[Path, PhotoHeader]) -> Iterator[Suggestion]:
    first = next(iter(photos), None)
    if first is None or len(photos) < 2 or min(photos[first].width, photos[first].height) < SMALLEST_PHOTO:
        return
    point = f"{photos[first].width // 2},{photos[first].height // 2}"
    yield Suggestion(
        "find what is shown in one example",
        "point= is the pixel of the example, here the middle of the first photo",
        (
            command("predict", "task=cosfire", prototype=seen.folder / first, point=point, input=seen.given,
                    output="detections"),
        ),
    )  # fmt: skip
