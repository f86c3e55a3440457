"""The result of localizing a walk."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.atomic_files import write_atomically, write_json
from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.written_poses import Row
from sextant.data.photos import Pinhole
from sextant.tables import NOTHING, TextTable
from sextant.tools.walks.shared_camera import SharedCamera


@dataclass(frozen=True, eq=False)
class Walk:
    """The result of localizing a walk.

    Attributes:
        camera: camera of the walk.
        map_camera: camera of the map's images; None for a map that was already straightened.
        view: the virtual camera that both are rendered through.
        rows: where each image was taken.
        unseen: mean share of the straightened images that the camera does not cover.
        remarks: remarks for the user.
        files: files that were written.
        interrupted: Ctrl-C came before the last image.
    """

    camera: SharedCamera
    map_camera: SharedCamera | None
    view: Pinhole
    rows: list[Row]
    unseen: float
    remarks: tuple[str, ...]
    files: tuple[Path, ...]
    interrupted: bool = False

    def facts(self) -> dict[str, Any]:
        """The cameras and their shared view, as plain values."""
        cameras = {"walk": self.camera.row, "map": self.map_camera and self.map_camera.row}
        return {
            "images": len(self.rows),
            "lost": sum(row.told.lost for row in self.rows),
            "cameras": cameras,
            "view": self.view.facts() | {"vfov_deg": self.view.vfov_deg},
            "unseen": self.unseen,
            "remarks": list(self.remarks),
        }


#: number of images shown before and after
MOST_SHOWN = 6


def write_walk_report(
    walk: Walk,
    shown: Sequence[tuple[int, ndarray, ndarray]],
    localizer: Localizer,
    mapped: UInt8[ndarray, "n h w 3"] | None,
    output: Path,
) -> list[Path]:
    """Write ``report.md``, ``walk.json`` and ``straightened.png``.

    Args:
        walk: the localized walk.
        shown: number, image and straightened image of some frames.
        localizer: localizer in the map.
        mapped: the map's straightened images, if they are known.
        output: an existing folder.

    Raises:
        OSError: a file cannot be written.
    """
    from sextant.chapters.localization.figures.trajectories import WalkedImage, straightened_walk
    from sextant.figures.style import save_figure

    pictures = []
    for number, taken, straight in shown:
        row = walk.rows[number]
        apart = localizer.model.map.poses[:, :2].numpy() - row.told.pose[:2]
        image = None if mapped is None else mapped[int(np.square(apart).sum(1).argmin())]
        title = f"{Path(row.name).name}{', lost' if row.told.lost else ''}"
        pictures.append(WalkedImage(title, taken, straight, image))
    files = save_figure(straightened_walk(pictures), output, "straightened") if pictures else []
    write_json(output / "walk.json", walk.facts())
    text = _page(walk, localizer.unit).encode()
    write_atomically(output / "report.md", lambda file: file.write(text))
    return [output / "report.md", output / "walk.json", *files]


def _page(walk: Walk, unit: str) -> str:
    remarks = [*walk.remarks, *(f"the walk's camera: {doubt}" for doubt in walk.camera.row.get("doubts", ()))]
    if walk.map_camera:
        remarks += [f"the map's camera: {doubt}" for doubt in walk.map_camera.row.get("doubts", ())]
    view = walk.view
    return "\n".join([
        "# A walk with an unknown camera\n",
        "## Poses\n",
        _poses(walk, unit).markdown(),
        "Standard deviations are the localizer's; the path is in `poses.csv` and `trajectory.tum`.\n",
        "![the path over the map](trajectory.png)\n",
        "## The cameras\n",
        _cameras(walk).markdown(),
        "Intervals contain the true value in 95 % of the photos of the sets on which this was measured; ± is the "
        "spread over the photos.\n",
        f"Both are rendered through one camera of {view.width}x{view.height} pixels without distortion and roll, with "
        f"a vertical field of view of {view.vfov_deg:.1f}° and tilted by {math.degrees(view.tilt):+.1f}°. "
        f"{100 * walk.unseen:.1f} % of its images lie outside the walk's images, and are filled from their edges.\n",
        "![as taken, straightened, and the map where it was found](straightened.png)\n",
        *(["## Remarks\n", *(f"- {remark}" for remark in remarks), ""] if remarks else []),
    ])  # fmt: skip


def _poses(walk: Walk, unit: str) -> TextTable:
    told = [row.told for row in walk.rows]
    known = np.array([each.sigmas for each in told if not each.lost]).reshape(-1, 3)
    lost = sum(each.lost for each in told)
    rows = [
        ["images", f"{len(told):,}"],
        ["localized", f"{len(told) - lost:,}"],
        ["reported as lost", f"{lost:,}"],
        ["could not be used", f"{sum(bool(row.problem) for row in walk.rows):,}"],
    ]
    if len(known):
        place = np.hypot(known[:, 0], known[:, 1])
        for name, values, of in (("position", place, unit), ("heading", np.degrees(known[:, 2]), "°")):
            low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
            rows.append([f"standard deviation of the {name}, {of}", f"{middle:.2g} [{low:.2g}, {high:.2g}]"])
    return TextTable(["", "median [5 %, 95 %]"], rows)


def _cameras(walk: Walk) -> TextTable:
    rows = [row for row in (walk.camera.row, walk.map_camera.row if walk.map_camera else None)]
    names = ("focal length, px", "field of view, °", "k1", "tilt, °", "roll, °", "photos fused", "verdict")
    columns = [dict.fromkeys(names, NOTHING) if row is None else _camera(row, names) for row in rows]
    return TextTable(["camera", "walk", "map"], [[name, *(column[name] for column in columns)] for name in names])


def _camera(row: dict[str, Any], names: Sequence[str]) -> dict[str, str]:
    camera, ends = row["camera"], row["camera"]["intervals"]["95"]

    def within(value: float, key: str, form: str) -> str:
        low, high = (format(end, form) if end is not None and math.isfinite(end) else "?" for end in ends[key])
        return f"{value:{form}} [{low}, {high}]"

    values = (
        within(camera["focal_px"], "focal_px", ".0f"), within(camera["vfov_deg"], "vfov_deg", ".1f"),
        within(camera["k1"], "k1", "+.3f"), f"{row['tilt_deg']:+.1f} ± {row['tilt_spread_deg']:.1f}",
        f"{row['roll_deg']:+.1f} ± {row['roll_spread_deg']:.1f}", f"{len(row['kept'])} of {row['photos']}",
        camera["confidence"]["verdict"],
    )  # fmt: skip
    return dict(zip(names, values, strict=True))
