"""Where a photo was taken among posed photos: its pose, the matches that give it, and the map from above."""

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from sextant.applications.pixels import AnyImage, as_pixels
from sextant.chapters.localization.data.posed_photos import StraightPhotos, posed_photos
from sextant.chapters.localization.locating import map_of_folder
from sextant.chapters.localization.pose_map import LEAST_SEEN, LOG10_FALSE_ALARMS, LocatedPhoto, PoseMap
from sextant.correspondence import Pinhole
from sextant.data.photos import read_photo
from sextant.errors import ArgumentError, UserError
from sextant.tools.demonstration.pictures import data_address, shrunk
from sextant.tools.demonstration.posed_office import ELSEWHERE, SAMPLES, kept_posed_office

#: its name, for people
OFFICE = "a rendered office"
#: longer side at which features of the office are found, in pixels; twice that of its pictures
OFFICE_SIDE = 640
#: inliers, matches and points that are drawn
DOTS, LINES, POINTS = 400, 60, 3000
#: standard deviations of the axes of an ellipse that holds 95 % of a Gaussian of two dimensions
ELLIPSE_95 = float(np.sqrt(-2 * np.log(0.05)))
#: weight of the direction that the photos call up, where their positions alone do not tell which plane is the floor
UPRIGHT = 0.05


class WhereTaken:
    """Locates photos in one map.

    >>> found = WhereTaken.in_folder(Path("posed photos")).answer(Path("photo.jpg"))  # doctest: +SKIP
    >>> print(found["verdict"], found["quantities"])  # doctest: +SKIP

    Args:
        name: of the map, for people.
        poses: the map.
        images: its photos, in its order; none of a saved map.
        samples: photos to try, by name; of those in the map with their position in ``truth``.
    """

    def __init__(
        self,
        name: str,
        poses: PoseMap,
        images: Sequence[AnyImage] = (),
        samples: Mapping[str, Path] | None = None,
        truth: Mapping[str, Float64[ndarray, "3"]] | None = None,
    ):
        self.name, self.poses, self.images = name, poses, images
        self.samples, self.truth = samples or {}, truth or {}

    @classmethod
    def in_folder(cls, folder: Path, progress: Callable[[int, int], None] = lambda done, total: None) -> Self:
        """Read posed photos, or a saved map.

        Raises:
            UserError: the folder is neither, or a package is missing.
        """
        poses, paths = map_of_folder(folder, progress)
        return cls(folder.name or str(folder), poses, _straight(folder) if paths else ())

    @classmethod
    def in_office(cls) -> Self:
        """Render the office, unless it is in the cache, and map it.

        Raises:
            UserError: a package is missing.
        """
        folder = kept_posed_office()
        poses = PoseMap.from_folder(folder / "map", side=OFFICE_SIDE)
        samples = {name: folder / "photos" / f"{name}.png" for name in SAMPLES}
        with (folder / "truth.csv").open() as file:
            rows = list(csv.DictReader(file))
        truth = {Path(row["file"]).stem: np.array([float(row[key]) for key in "xyz"]) for row in rows}
        return cls(OFFICE, poses, _straight(folder / "map"), samples, truth)

    def of_sample(self, name: str, same_camera: bool = False) -> dict[str, Any]:
        """The answer for one of the samples, with the truth.

        Raises:
            UserError: there is none of this name.
        """
        if name not in self.samples:
            raise ArgumentError(f"sample={name}: no such sample of this map", "Choose one of the list, or a photo.")
        found = self.answer(self.samples[name], same_camera)
        for row, value in zip(found["quantities"], self.truth.get(name, ()), strict=False):
            row["truth"] = float(value)
        return found | {"elsewhere": name.startswith(ELSEWHERE)}

    def answer(self, path: Path, same_camera: bool = False) -> dict[str, Any]:
        """Where a photo was taken; pixels are of the pictures that are returned.

        Args:
            path: file of the photo.
            same_camera: it was taken by the camera of the map; otherwise its focal length is estimated.

        Raises:
            UserError: the photo cannot be read, or the map has no camera of its size.
        """
        photo = read_photo(path)
        camera = self._camera(photo.width, photo.height) if same_camera else None
        found = self.poses.locate(path, camera)
        shown = shrunk(photo.image)
        return {
            "map": {"name": self.name, "images": len(self.poses.names), "points": len(self.poses.posed.points)},
            "photo": _picture(shown),
            "verdict": found.verdict,
            "inliers": found.inliers,
            "matches": found.matches,
            "log10_false_alarms": _finite(found.log10_false_alarms),
            "limit": LOG10_FALSE_ALARMS,
            "seen": found.seen,
            "least_seen": LEAST_SEEN,
            "quantities": _quantities(found, known=camera is not None),
            **self._matches(found, shown.shape[1] / photo.width),
            "above": self._above(found),
        }

    def _camera(self, width: int, height: int) -> Pinhole:
        cameras = {each for each in self.poses.posed.cameras if (each.width, each.height) == (width, height)}
        if len(cameras) != 1:
            raise UserError(
                f"the map has {len(cameras) or 'no'} camera{'s' * (len(cameras) != 1)} of {width}x{height} pixels",
                "Leave the camera unknown, or give a photo of the map's camera in its size.",
            )
        return next(iter(cameras))

    def _matches(self, found: LocatedPhoto, scale: float) -> dict[str, Any]:
        """Inliers in the photo, and those that were matched in the map's image with the most in both pictures."""
        dots = (scale * (_some(found.pixels, DOTS) + 0.5)).round(1).tolist()
        if found.nearest is None:
            return {"dots": dots, "nearest": None, "lines": []}
        name, camera = self.poses.names[found.nearest], self.poses.posed.cameras[found.nearest]
        if not self.images:
            return {"dots": dots, "nearest": {"name": name}, "lines": []}
        shown = shrunk(_colour(as_pixels(self.images[found.nearest])))
        ends = [scale * (found.pixels_in_nearest + 0.5), shown.shape[1] / camera.width * (found.map_pixels + 0.5)]
        lines = _some(np.hstack(ends), LINES).round(1).tolist()
        return {"dots": dots, "nearest": {"name": name, **_picture(shown)}, "lines": lines}

    def _above(self, found: LocatedPhoto) -> dict[str, Any]:
        """The map from above, in its units: points, and positions with the directions of view."""
        posed = self.poses.posed
        plane = floor_of(posed.poses)
        low, high = np.quantile(posed.points, [0.02, 0.98], axis=0)
        inside = posed.points[((posed.points >= low) & (posed.points <= high)).all(1)]
        shown = _some(inside, POINTS) @ plane.T
        above: dict[str, Any] = {"points": shown.round(3).tolist(), "images": _views(posed.poses, plane).tolist()}
        if found.world_from_camera is None or found.covariance is None:
            return above | {"found": None}
        turn = plane @ found.world_from_camera[:3, :3]
        variances, axes = np.linalg.eigh(turn @ found.covariance[:3, :3] @ turn.T)
        angle = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
        radii = ELLIPSE_95 * np.sqrt(variances.clip(min=0))
        return above | {
            "found": _views(found.world_from_camera[None], plane)[0].tolist(),
            "ellipse": [float(radii[1]), float(radii[0]), float(angle)],
        }


def floor_of(poses: Float64[ndarray, "n 4 4"]) -> Float64[ndarray, "2 3"]:
    """Two orthogonal directions of the floor, which is to the right of the first and ahead of it seen from above.

    The floor is the plane of the positions. Where these lie on a line, it is that on which cameras stand upright.

    >>> floor_of(np.stack([np.eye(4), np.eye(4)]))  # y is down: from above, z is ahead of x
    array([[1., 0., 0.],
           [0., 0., 1.]])
    """
    centred = poses[:, :3, 3] - poses[:, :3, 3].mean(0)
    spread, up = centred.T @ centred, -poses[:, :3, 1].mean(0)
    across = np.linalg.eigh(spread / max(np.trace(spread), 1e-12) - UPRIGHT * np.outer(up, up))[1][:, 0]
    if across @ up < 0:
        across = -across
    axis = np.eye(3)[np.abs(across).round(3).argmin()]
    right = axis - across * (axis @ across)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(across, right)]) + 0.0


def _views(poses: Float64[ndarray, "n 4 4"], plane: Float64[ndarray, "2 3"]) -> Float64[ndarray, "n 4"]:
    """Positions and directions of view from above."""
    return np.hstack([poses[:, :3, 3] @ plane.T, poses[:, :3, 2] @ plane.T]).round(4)


def _quantities(found: LocatedPhoto, known: bool) -> list[dict[str, Any]]:
    """Rows of a table: values with their standard deviations."""
    if found.world_from_camera is None or found.covariance is None or found.camera is None:
        return []
    turn, position = found.world_from_camera[:3, :3], found.world_from_camera[:3, 3]
    sigmas = np.sqrt(np.diag(turn @ found.covariance[:3, :3] @ turn.T))
    turned = np.degrees(np.sqrt(np.linalg.eigvalsh(found.covariance[3:, 3:])[-1]))
    places = [("xyz"[k], position[[k]], sigmas[k], 3, "", "") for k in range(3)]
    rows = [
        *places,
        ("view", turn[:, 2], turned, 2, "°", "x, y and z of the direction"),
        ("focal length", np.array([found.camera.fx]), None, 1, "px", "the map's" if known else "estimated"),
    ]
    return [
        {
            "name": name,
            "values": (values.round(digits) + 0.0).tolist(),
            "sigma": sigma,
            "digits": digits,
            "unit": unit,
            "about": about,
        }
        for name, values, sigma, digits, unit, about in rows
    ]


def _straight(folder: Path) -> Sequence[AnyImage]:
    """The photos of a folder as the map has seen them."""
    photos = posed_photos(folder)
    return photos.paths if photos.cameras is None else StraightPhotos(photos)


def _some(rows: ndarray, most: int) -> ndarray:
    """At most this many rows, evenly spaced."""
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(most, len(rows))).round().astype(int))
    return np.asarray(rows[chosen])


def _picture(image: ndarray) -> dict[str, Any]:
    return {"picture": data_address(image), "width": image.shape[1], "height": image.shape[0]}


def _colour(image: ndarray) -> ndarray:
    return np.repeat(image, 3, 2) if image.shape[2] == 1 else image


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
