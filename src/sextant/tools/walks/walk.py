"""The result of localizing a walk."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sextant.chapters.localization.written_poses import Row
from sextant.data.photos import Pinhole
from sextant.tools.walks.shared_camera import SharedCamera


@dataclass(frozen=True, eq=False)
class Walk:
    """The result of localizing a walk.

    Attributes:
        camera: camera of the walk.
        map_camera: camera of the map's images; None for a map that was straightened before.
        view: the virtual camera that both are rendered through.
        rows: where each image was taken.
        unseen: mean share of the straightened images that the camera does not show.
        remarks: what the user should know.
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
