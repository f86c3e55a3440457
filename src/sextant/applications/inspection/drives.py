"""Drives with poses: what ``dataset=pose_folder`` needs to be told of them."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sextant.applications.inspection.gps import positions, same_ground
from sextant.applications.inspection.poses import FoundPoses
from sextant.applications.inspection.seen import Seen
from sextant.applications.inspection.suggestion import Suggestion, command, override, overrides_of, plain_name
from sextant.applications.inspection.traverses import MAPS
from sextant.data.localization.plane import AHEAD, PLANES, Ahead, to_plane
from sextant.data.localization.pose_folder import FILES, PoseFormat
from sextant.errors import ArgumentError

#: videos and recordings that get a command, at most
MOST_STREAMS = 4
#: metres: shorter steps tell nothing of where a body looks
STEP = 1e-3
#: the body's axis that is upright where another looks ahead: y of a camera points down, z of a robot up
UPRIGHT: dict[Ahead, int] = {"z": 1, "x": 2}
#: cosine from which a body is level enough, on average
LEVEL = 0.7


def localization(seen: Seen) -> Iterator[Suggestion]:
    """Localization in a map of the user's own, and in one of a run for a video."""
    yield from _of_poses(seen)
    streams = [seen.folder / each.name for each in seen.videos] + [seen.folder / bag for bag in seen.files.recordings]
    if streams:
        yield Suggestion(
            "localize a video or a recording in a map",
            "<run> is a run of task=localization, whose map has these places; every=10 takes each tenth image",
            tuple(
                command("predict", run="<run>", input=name, every=10, output=f"localization/{name.stem}")
                for name in streams[:MOST_STREAMS]
            ),
        )


def _of_poses(seen: Seen) -> Iterator[Suggestion]:
    """The drives whose images all have poses of one format."""
    usable = [each for each in seen.poses if each.posed and not each.unposed and not each.problem and each.headings]
    drives: dict[tuple[PoseFormat, str], dict[Path, FoundPoses]] = {}
    for poses in usable:
        if poses.images is not None and poses.format != "cold":
            file = os.path.relpath(poses.file, poses.images)
            drives.setdefault((poses.format, file), {}).setdefault(poses.images, poses)
    for (form, file), all_found in drives.items():
        found = _on_one_ground(seen, all_found) if form == "gps" else all_found
        if len(found) < 2 and form != "gps":
            (poses,) = found.values()
            yield Suggestion(
                "localize in a map of your own",
                f"{poses.file.as_posix()} is of one drive; a second one through the same places is needed, in a folder "
                "beside it with a file of poses of its own",
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
                f"in {found[folders[0]].file.as_posix()} no two axes of the world are the ground: align them to it "
                "first (COLMAP: model_orientation_aligner)",
                (),
            )
            continue
        tests = {plain_name(_below(each, base)): each.relative_to(base) for each in folders[1:]}
        words = [
            "task=localization", "dataset=pose_folder", f"dataset.folder={override(seen.folder / base)}",
            f"dataset.map={override(folders[0].relative_to(base))}", f"dataset.test={overrides_of(tests)}",
            f"dataset.poses={form}", *([] if FILES.get(form) == file else [f"dataset.pose_file={override(file)}"]),
            *(f"dataset.{key}={value}" for key, value in ground.items()),
        ]  # fmt: skip
        why = f"{len(folders)} drives with poses ({form}), {folders[0].as_posix()} as the map"
        if form in ("colmap", "opensfm", "nerfstudio"):
            why += "; lengths must be metres, and all drives in one frame"
        if form == "gps":
            why += "; where EXIF has no direction of view, the camera is taken to look along the way"
        yield Suggestion("localize in a map of your own", why, (command("train", *words),))


def _on_one_ground(seen: Seen, found: dict[Path, FoundPoses]) -> dict[Path, FoundPoses]:
    """The drives that come near the map, which is the first of them."""
    folders = sorted(found, key=lambda each: not each.name.lower().startswith(MAPS))
    drives = {folder: positions(seen.headers, folder) for folder in folders}
    return {folder: found[folder] for folder in folders if same_ground(drives[folders[0]], drives[folder])}


def _below(folder: Path, base: Path) -> str:
    return folder.relative_to(base).as_posix()


def axes(found: FoundPoses) -> dict[str, str] | None:
    """The plane that is moved in and the axis that looks ahead, as far as they are not the defaults.

    The plane's normal is the axis of the world that the body's upright one is nearest to.
    """
    if found.poses is None:
        return {}
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
