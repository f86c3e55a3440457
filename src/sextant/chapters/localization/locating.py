"""What ``sextant locate`` does: photos or a video located in posed photos, and the results as files and pictures."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from sextant.atomic_files import write_atomically, write_csv
from sextant.chapters.localization.data.frames import Photos
from sextant.chapters.localization.data.rosbag import Bag
from sextant.chapters.localization.given_cameras import check_cameras
from sextant.chapters.localization.pose_map import LocatedPhoto, PoseMap
from sextant.chapters.localization.pose_map_files import FORMAT
from sextant.chapters.places.describing import upright_size
from sextant.data.file_kinds import is_hidden
from sextant.data.image_files import decode_image
from sextant.data.photo_files import reason_alone
from sextant.data.videos import Video
from sextant.errors import ArgumentError, UserError
from sextant.reporter import Advance
from sextant.tables import counted

COLUMNS = (
    *("file", "verdict", "x", "y", "z", "qw", "qx", "qy", "qz", "sigma_position", "sigma_deg", "inliers", "matches"),
    *("log10_false_alarms", "seen", "fx", "fy", "cx", "cy", "nearest", "error"),
)
#: of tables of earlier versions
EARLIER = tuple(each for each in COLUMNS if each != "seen")
#: photos whose matches are drawn, and the folder of these pictures
DRAWN, MATCHES = 12, "matches"
#: files of a COLMAP model, and their folder
MODEL, COLMAP = ("cameras.txt", "images.txt", "points3D.txt"), "colmap"


@dataclass(frozen=True, eq=False)
class LocatedFrame:
    """A photo or frame: where it was taken, or why it could not be read."""

    name: str
    found: LocatedPhoto | None
    width: int = 0
    height: int = 0
    problem: str = ""


def map_of_folder(folder: Path, progress: Advance, local: str | None = None) -> tuple[PoseMap, Sequence[Path]]:
    """A saved map, or one made of posed photos; and the files of its images, none of a saved map.

    Args:
        folder: of the map or the photos.
        progress: is given the images done and their number.
        local: the local features; None: XFeat's, or those of the saved map.

    Raises:
        UserError: the folder is neither, or there are no such local features.
    """
    if (folder / FORMAT.header).is_file():
        return PoseMap.open(folder, local), []
    poses = PoseMap.from_folder(folder, local=local or "xfeat", progress=progress)
    return poses, [folder / name for name in poses.names]


def files_before(output: Path) -> list[Path]:
    """The files that a former run wrote to a folder, by its ``poses.csv``.

    Raises:
        ArgumentError: files there are not of a former run, and would be replaced or mixed with the COLMAP model.
    """
    fixed = [output / name for name in ("poses.csv", "trajectory.tum", "from_above.png")]
    names, located = _names_before(fixed[0])
    before = fixed[:2] if names else []
    if located:
        before += [fixed[2], *(output / COLMAP / name for name in MODEL)]
        before += [output / MATCHES / _picture(name) for name in located]
    there = [*fixed, *(each for each in sorted((output / COLMAP).glob("*")) if not is_hidden(each.name))]
    if others := [str(each) for each in there if each.exists() and each not in before]:
        raise ArgumentError(
            f"output={output} has files that sextant locate did not write, and would replace or add to: "
            f"{', '.join(others[:5])}",
            f"Name a folder of its own: output={output / 'located'}",
        )
    return [each for each in before if each.exists()]


def _names_before(table: Path) -> tuple[list[str], list[str]]:
    """The images in a table that :func:`write_located` wrote, and those located; none if it is another table."""
    try:
        with table.open(newline="", encoding="utf-8") as file:
            rows = csv.DictReader(file)
            if tuple(rows.fieldnames or ()) not in (COLUMNS, EARLIER):
                return [], []
            found = [(row["file"], row["verdict"]) for row in rows]
    except (OSError, ValueError, csv.Error):
        return [], []
    return [name for name, _ in found], [name for name, verdict in found if verdict == "located"]


def locate_frames(
    poses: PoseMap, frames: Photos | Video | Bag, camera: object, output: Path, paths: Sequence[Path], progress: Advance
) -> list[LocatedFrame]:
    """Locate each frame; the matches of the first that are located are drawn to ``output/matches``.

    Images of a bag with a camera are straightened by it, unless another ``camera`` is given. Files of a former run are
    removed from the output, except its tables, which are replaced at the end.

    Raises:
        UserError: the output has files of another origin, the recorded camera cannot be used, or no image can be read.
    """
    recorded = frames.camera if isinstance(frames, Bag) and camera is None else None
    if isinstance(frames, Bag) and camera is None and frames.camera_problem:
        raise UserError(frames.camera_problem, "Give the camera of straight images: camera=<fx>,<fy>,<cx>,<cy>")
    results: list[LocatedFrame] = []
    drawn = 0
    for old in files_before(output):
        if old.parent != output or old.suffix == ".png":
            old.unlink(missing_ok=True)
    for frame in frames.read(None):
        if frame.image is None:
            results.append(LocatedFrame(frame.name, None, problem=frame.problem))
            continue
        image = np.repeat(frame.image, 3, 2) if frame.image.shape[2] == 1 else frame.image
        if recorded is not None:
            lens = recorded.pinhole(image.shape[1], image.shape[0], frame.name)
            check_cameras([lens], [frame.name], "camera_info of the bag")
            camera = lens
            image = recorded.straight(image, frame.name)
        found = poses.locate(image, camera)
        results.append(LocatedFrame(frame.name, found, image.shape[1], image.shape[0]))
        if found.verdict == "located" and paths and drawn < DRAWN:
            draw_matches(image, found, paths, poses.names, output / MATCHES / _picture(frame.name))
            drawn += 1
        progress(len(results), len(frames))
    if not any(each.found for each in results):
        raise UserError(
            f"none of {counted(len(results), 'image')} can be read: {results[0].problem}", "Give other photos."
        )
    return results


def write_located(results: Sequence[LocatedFrame], poses: PoseMap, output: Path) -> list[Path]:
    """Write ``poses.csv``, ``trajectory.tum``, a COLMAP model of the located images, and the view from above."""
    write_csv(output / "poses.csv", COLUMNS, [_row(each, poses) for each in results])
    located = [each for each in results if each.found is not None and each.found.verdict == "located"]
    lines = [" ".join(map(str, (k, *_values(each)))) for k, each in enumerate(results) if each in located]
    _write(output / "trajectory.tum", ["# number tx ty tz qx qy qz qw: world_from_camera", *lines])
    written = [output / "poses.csv", output / "trajectory.tum"]
    if located:
        written += [*_write_colmap(located, output / COLMAP), draw_from_above(located, poses, output)]
    return written


def _pose(frame: LocatedFrame) -> ndarray:
    assert frame.found is not None
    assert frame.found.world_from_camera is not None
    return frame.found.world_from_camera


def _values(frame: LocatedFrame) -> list[float]:
    pose = _pose(frame)
    return [*pose[:3, 3].round(6).tolist(), *Rotation.from_matrix(pose[:3, :3]).as_quat().round(8).tolist()]


def _row(frame: LocatedFrame, poses: PoseMap) -> dict[str, object]:
    found = frame.found
    if found is None:
        return {"file": frame.name, "verdict": "unreadable", "error": reason_alone(frame.name, frame.problem)}
    row: dict[str, object] = {"file": frame.name, "verdict": found.verdict, "matches": found.matches}
    row["seen"] = f"{found.seen:.3f}"
    if found.verdict != "located" or found.covariance is None:
        return row
    x, y, z, qx, qy, qz, qw = _values(frame)
    spread = np.sqrt([np.linalg.eigvalsh(found.covariance[k : k + 3, k : k + 3])[-1] for k in (0, 3)])
    return row | {
        **{"x": x, "y": y, "z": z, "qw": qw, "qx": qx, "qy": qy, "qz": qz, "inliers": found.inliers},
        **{"sigma_position": f"{spread[0]:.5f}", "sigma_deg": f"{np.degrees(spread[1]):.4f}"},
        "log10_false_alarms": f"{found.log10_false_alarms:.1f}",
        **{key: f"{getattr(found.camera, key):.3f}" for key in ("fx", "fy", "cx", "cy")},
        "nearest": poses.names[found.nearest or 0],
    }


def _write_colmap(located: Sequence[LocatedFrame], folder: Path) -> list[Path]:
    """``cameras.txt``, ``images.txt`` and an empty ``points3D.txt``; COLMAP's first pixel is centred at (0.5, 0.5).

    A name ends at a space there, so that spaces are replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cameras, images = [], []
    for number, frame in enumerate(located, start=1):
        inverse = np.linalg.inv(_pose(frame))
        x, y, z, w = Rotation.from_matrix(inverse[:3, :3]).as_quat().tolist()
        camera = frame.found.camera if frame.found is not None else None
        assert camera is not None
        model = (camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5)
        cameras.append(" ".join(map(str, (number, "PINHOLE", frame.width, frame.height, *model))))
        images += [
            " ".join(map(str, (number, w, x, y, z, *inverse[:3, 3].tolist(), number, frame.name.replace(" ", "_")))),
            "",
        ]
    for name, lines in zip(MODEL, (cameras, images, []), strict=True):
        _write(folder / name, lines)
    return [folder]


def _write(path: Path, lines: Sequence[str]) -> None:
    text = "".join(f"{line}\n" for line in lines)
    write_atomically(path, lambda file: file.write(text.encode()))


def draw_matches(
    image: ndarray, found: LocatedPhoto, paths: Sequence[Path], names: Sequence[str], path: Path, most: int = 80
) -> None:
    """Draw a photo beside the map's image with the most inliers, with lines between matches."""
    from PIL import Image, ImageDraw

    assert found.nearest is not None
    scale = 480 / image.shape[0]
    left = Image.fromarray(image).resize((round(image.shape[1] * scale), 480))
    width, height = upright_size(paths[found.nearest])
    right = Image.fromarray(decode_image(paths[found.nearest], height, width, 3))
    right = right.resize((round(480 * width / height), 480))
    page = Image.new("RGB", (left.width + right.width + 8, 480), "white")
    page.paste(left, (0, 0))
    page.paste(right, (left.width + 8, 0))
    lines = ImageDraw.Draw(page)
    step = max(1, len(found.map_pixels) // most)
    pairs = zip(found.pixels_in_nearest[::step], found.map_pixels[::step], strict=True)
    for (x1, y1), (x2, y2) in pairs:
        there = (left.width + 8 + x2 * 480 / height, y2 * 480 / height)
        lines.line([(x1 * scale, y1 * scale), there], fill=(0, 158, 115), width=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, lambda file: page.save(file, "JPEG", quality=88))


def _picture(name: str) -> str:
    """The file name of the matches of a photo, folders included."""
    flat = name.replace("/", "__").replace("\\", "__").replace(" ", "_")
    return flat if flat.lower().endswith(".jpg") else f"{flat}.jpg"


def draw_from_above(located: Sequence[LocatedFrame], poses: PoseMap, output: Path) -> Path:
    """Draw the map and where the photos were taken, along the axis in which the map's images vary least."""
    from sextant.figures.style import new_figure, save_figure

    there = poses.posed.poses[:, :3, 3]
    flat = int(np.ptp(there, axis=0).argmin())
    u, v = (axis for axis in range(3) if axis != flat)
    figure, (axes,) = new_figure(6.0, 5.0)
    low, high = np.quantile(poses.posed.points, [0.02, 0.98], axis=0)
    inside = ((poses.posed.points >= low) & (poses.posed.points <= high)).all(1)
    axes.plot(*poses.posed.points[inside][:, [u, v]].T, ".", color="0.7", markersize=1, label="points of the map")
    axes.plot(there[:, u], there[:, v], "o", color="0.4", markersize=3, label="images of the map")
    found = np.array([each.found.world_from_camera for each in located if each.found is not None])
    ahead = found[:, :3, 2] * 0.05 * float(np.ptp(there[:, [u, v]], axis=0).max() or 1.0)
    axes.quiver(
        found[:, u, 3], found[:, v, 3], ahead[:, u], ahead[:, v], color="C1", angles="xy", scale_units="xy", scale=1,
        label="located photos", width=0.004,
    )  # fmt: skip
    axes.set_aspect("equal")
    axes.set_xlabel("xyz"[u])
    axes.set_ylabel("xyz"[v])
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=7)
    return save_figure(figure, output, "from_above")[0]
