"""Drives with poses: the settings that ``dataset=pose_folder`` needs for them."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sextant.chapters.localization.data.pose_folder import FILES, PoseFormat
from sextant.chapters.localization.data.pose_formats import AHEAD, PLANES, Ahead, to_plane
from sextant.chapters.localization.data.posed_photos import COLUMNS, NAMED, ORDERED
from sextant.chapters.localization.data.recorded_poses import RECORDED
from sextant.chapters.places.data.gps_poses import local_poses
from sextant.chapters.places.data.pose_files import read_pose_table
from sextant.config.override_words import override, overrides_of, plain_name
from sextant.errors import ArgumentError
from sextant.evaluation.protocols import OFFICE_LOCALIZATION, TOWN_LOCALIZATION
from sextant.tools.inspection.gps import positions, same_ground
from sextant.tools.inspection.poses import FoundPoses
from sextant.tools.inspection.seen import Seen
from sextant.tools.inspection.suggestion import Suggestion, command, outputs
from sextant.tools.inspection.traverses import MAPS
from sextant.user_files import table_header

#: largest number of videos and recordings that get a command
MOST_STREAMS = 4
#: metres: shorter steps do not indicate a direction of motion
STEP = 1e-3
#: the body's upright axis, by the axis that points ahead: y of a camera points down, z of a robot up
UPRIGHT: dict[Ahead, int] = {"z": 1, "x": 2}
#: commands for photos in a map of the user's own, and for images too small for the network that describes photos
OF_PHOTOS, OF_SMALL = ("experiment=localization_folder",), ("task=localization", "dataset=pose_folder")
#: pixels of the shorter side from which an image is a photo, as in chapters/localization/localizer_folder.py
ENOUGH = 48
#: cosine from which a body is level enough, on average
LEVEL = 0.7


def localization(seen: Seen) -> Iterator[Suggestion]:
    """Localization in a map of the user's own and, for videos, in that of a run."""
    yield from _located(seen)
    walks = list(_walks(seen))
    yield from walks
    yield from _of_poses(seen)
    streams = [Path(each.name) for each in seen.videos] + list(seen.recordings)
    given: dict[Path, dict[str, object]] = {
        each: {"every": 10, **(_odometry(seen, each) if each in seen.files.videos else {})} for each in streams
    }
    posed = {images for _, _, images in _usable(seen)}
    if not walks:
        moved = {each.folder: _odometry(seen, each.folder) for each in seen.folders if each.folder not in posed}
        given |= {folder: {**table} for folder, table in moved.items() if table}
    if given:
        answers = outputs("localization", seen.folder, given)
        answers[Path()] = Path("localization", seen.folder.resolve().name)
        yield Suggestion(
            "localize a drive in a map",
            "<map> is a run of task=localization or a saved map of these places, such as one that sextant walk writes"
            + "; every=10 takes every tenth image" * bool(streams),
            tuple(
                command("localize", map="<map>", input=seen.folder / each, **more, output=answers[each])
                for each, more in list(given.items())[:MOST_STREAMS]
            ),
        )  # fmt: skip


def _read_first(folder: Path) -> str | None:
    """The file of poses that ``sextant locate`` reads below a folder."""
    return next((name for name in (*NAMED, *ORDERED) if (folder / name).is_file()), None)


def _located(seen: Seen) -> Iterator[Suggestion]:
    """Images without poses beside a folder of photos with six-dimensional poses."""
    named = [(each, base) for each in seen.poses for base in each.file.parents if base.name and each.images is not None]
    homes = {
        base: poses
        for poses, base in named
        if not poses.problem
        and poses.posed
        and (poses.images or base).is_relative_to(base)
        and poses.file.relative_to(base).as_posix() == _read_first(seen.folder / base)
        and (poses.file.name not in ORDERED or (poses.count == poses.posed and not poses.unposed))
        and (poses.format != "csv" or set(COLUMNS) <= set(table_header(seen.folder / poses.file)))
    }
    if not homes:
        return
    home = min(homes, key=lambda each: not each.name.lower().startswith(MAPS))
    posed = [*homes, *(each.images for each in seen.poses if each.images is not None and not each.unposed)]
    others = [each.folder for each in seen.folders] + [Path(each.name) for each in seen.videos]
    found = [
        each for each in others if not any(each.is_relative_to(other) or other.is_relative_to(each) for other in posed)
    ]
    if found:
        located = outputs("located", seen.folder, found)
        yield Suggestion(
            "locate photos among photos with poses",
            f"{homes[home].file.as_posix()} has poses in six dimensions; it takes pip install 'sextant-vision[local]'",
            tuple(
                command("locate", map=seen.folder / home, input=seen.folder / each, output=located[each])
                for each in found[:MOST_STREAMS]
            ),
        )  # fmt: skip


def _usable(seen: Seen) -> Iterator[tuple[FoundPoses, PoseFormat, Path]]:
    """Poses that cover all images of a folder, with their format and the folder."""
    for each in seen.poses:
        whole = each.posed and not each.unposed and not each.problem and each.headings
        if whole and each.images is not None and each.format != "cold":
            yield each, each.format, each.images


def _walks(seen: Seen) -> Iterator[Suggestion]:
    """Images without poses beside a folder of images with a file of poses."""
    usable = [each for each in _usable(seen) if each[1] != "gps"]
    homes = {Path(os.path.commonpath([poses.file.parent, images])): poses for poses, _, images in usable}
    maps = [home for home, poses in homes.items() if home.name and axes(poses) is not None]
    if not maps:
        return
    home = min(maps, key=lambda each: not each.name.lower().startswith(MAPS))
    posed = [*homes, *(images for _, form, images in _usable(seen) if form == "gps")]
    folders = [each.folder for each in seen.folders]
    streams = {Path(each.name): {"every": 10} for each in seen.videos}
    found = {
        each: {**streams.get(each, {}), **_odometry(seen, each)}
        for each in (*folders, *streams)
        if each.is_relative_to(home.parent)
        and not any(each.is_relative_to(other) or other.is_relative_to(each) for other in posed)
    }
    if found:
        walks = outputs("walk", seen.folder, found)
        yield Suggestion(
            "localize images without poses in a map of your own",
            f"{homes[home].file.as_posix()} has the poses of {home.as_posix()}; both cameras are calibrated, if each "
            "set of images is from one camera with one zoom",
            tuple(
                command("walk", input=seen.folder / each, map=seen.folder / home, **more, output=walks[each])
                for each, more in list(found.items())[:MOST_STREAMS]
            ),
        )  # fmt: skip


def _of_poses(seen: Seen) -> Iterator[Suggestion]:
    """The drives whose images all have poses of one format."""
    drives: dict[tuple[PoseFormat, str], dict[Path, FoundPoses]] = {}
    for poses, form, images in _usable(seen):
        file = os.path.relpath(poses.file, images)
        if form == "nclt" and Path(file).match(Path(FILES[form]).name):  # its name has the date
            file = os.path.join(os.path.dirname(file), Path(FILES[form]).name)
        drives.setdefault((form, file), {}).setdefault(images, poses)
    for (form, file), all_found in drives.items():
        found = _on_one_ground(seen, all_found) if form == "gps" else all_found
        if len(found) < 2 and form != "gps":
            (poses,) = found.values()
            yield Suggestion(
                "localize in a map of your own",
                f"{poses.file.as_posix()} is of one drive; training and testing need a second one through the same "
                "places, in a folder beside it with its own file of poses; sextant walk needs no poses for it",
                (),
            )
        if len(found) < 2:
            continue
        base = Path(os.path.commonpath(found))
        folders = sorted(found, key=lambda each: not _below(each, base).lower().startswith(MAPS))
        ground = axes(found[folders[0]])
        if ground is None:
            yield Suggestion(
                "localize in a map of your own",
                f"in {found[folders[0]].file.as_posix()} the ground is not a plane of two world axes: align the poses "
                "to it first (COLMAP: model_orientation_aligner)",
                (),
            )
            continue
        tests = {plain_name(_below(each, base)): each.relative_to(base) for each in folders[1:]}
        words = [
            *(OF_PHOTOS if _show_enough(seen, found) else OF_SMALL), f"dataset.folder={override(seen.folder / base)}",
            f"dataset.map={override(folders[0].relative_to(base))}", f"dataset.test={overrides_of(tests)}",
            f"dataset.poses={form}", *([] if FILES.get(form) == file else [f"dataset.pose_file={override(file)}"]),
            *(f"dataset.{key}={value}" for key, value in ground.items()),
        ]  # fmt: skip
        spacing = _spacing(seen, found[folders[0]], folders[0])
        coarse = spacing > OFFICE_LOCALIZATION.position
        words += ["dataset.protocol=town"] * coarse
        why = f"{len(folders)} drives with poses ({form}), {folders[0].as_posix()} as the map"
        if form in ("colmap", "opensfm", "nerfstudio"):
            why += "; lengths must be metres, and all drives in one frame"
        if form == "gps":
            why += "; where EXIF has no direction of view, the camera is assumed to point along the path"
        if coarse:
            limit = TOWN_LOCALIZATION.position
            why += f"; its images are {spacing:.2g} m apart, so {limit:g} m counts as correct (dataset.protocol=town)"
            why += ", which is less than that: few poses can be so close" * (spacing > limit)
        yield Suggestion("localize in a map of your own", why, (command("train", *words),))


def _spacing(seen: Seen, found: FoundPoses, folder: Path) -> float:
    """How far apart the images of a map are, in metres; 0 if there are fewer than two positions."""
    if found.poses is not None:
        where = found.poses[:, :3, 3]
    else:
        gps = found.format == "gps"
        poses = (
            local_poses(positions(seen.headers, folder)) if gps else read_pose_table(seen.folder / found.file).values()
        )
        where = np.array([(each.x, each.y) for each in poses])
    steps = np.linalg.norm(np.diff(where, axis=0), axis=1)
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0


def _odometry(seen: Seen, images: Path) -> dict[str, Path]:
    """The table of odometry beside or among some images, with one row per image or with times."""
    photos = next((each for each in seen.folders if each.folder == images), None)
    for file, rows in seen.odometry.items():
        fits = photos is None or photos.times_from == "names" or rows == len(photos.files)
        if fits and file.parent in (images, images.parent):
            return {"odometry": seen.folder / file}
    return {}


def _show_enough(seen: Seen, found: dict[Path, FoundPoses]) -> bool:
    """Whether the images of all drives are large enough for the place-recognition network, which describes photos."""
    sides = [min(each.width, each.height) for file, each in seen.headers.items() if file.parent in found]
    return min(sides, default=0) >= ENOUGH


def _on_one_ground(seen: Seen, found: dict[Path, FoundPoses]) -> dict[Path, FoundPoses]:
    """The drives that come close to the map, which is the first of them."""
    folders = sorted(found, key=lambda each: not each.name.lower().startswith(MAPS))
    drives = {folder: positions(seen.headers, folder) for folder in folders}
    return {folder: found[folder] for folder in folders if same_ground(drives[folders[0]], drives[folder])}


def _below(folder: Path, base: Path) -> str:
    return folder.relative_to(base).as_posix()


def axes(found: FoundPoses) -> dict[str, str] | None:
    """The plane of motion and the axis that points ahead, where they are not the defaults.

    The normal of the plane is the world axis that is closest to the body's upright axis.
    """
    if found.poses is None or found.format == "euroc":
        return {}
    if found.format in RECORDED:
        return {"ahead": "x"}
    choices: list[tuple[float, str, Ahead]] = []
    order: tuple[Ahead, ...] = AHEAD if found.format == "tum" else ("z",)
    for ahead in order:
        upright = np.abs(found.poses[:, :3, UPRIGHT[ahead]].mean(axis=0))
        plane = "xyz".replace("xyz"[int(upright.argmax())], "")
        if upright.max() > LEVEL and plane in PLANES:
            try:
                flat = to_plane(found.poses, plane, ahead, "poses")
            except ArgumentError:
                continue
            step = np.diff(flat[:, :2], axis=0)
            moved = np.hypot(*step.T) > STEP
            along = np.cos(np.arctan2(step[:, 1], step[:, 0]) - flat[:-1, 2])[moved]
            choices.append((float(np.median(along)) if moved.any() else 0.0, plane, ahead))
    if not choices:
        return None
    _, plane, ahead = max(choices, key=lambda choice: choice[0])
    return {key: value for key, value, usual in (("plane", plane, "xy"), ("ahead", ahead, "z")) if value != usual}
