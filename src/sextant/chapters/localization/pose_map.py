"""A map of photos at known poses, in which the pose of another photo is found by correspondences.

Candidates are the map's images with the most similar global descriptors; local features that match points of the map
give the pose (:mod:`sextant.correspondence`). The answer is *not in the map* where no more matches agree than chance
allows, or most of what the map shows there is missing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from sextant.applications.arguments import check_several, check_whole, make_folder
from sextant.applications.pixels import AnyImage, as_pixels
from sextant.chapters.localization.data.posed_photos import StraightPhotos, posed_photos
from sextant.chapters.localization.given_cameras import (
    LEAST_POINTS,
    cameras_of,
    check_cameras,
    checked_poses,
    prior_of,
    scaled,
    without_points,
)
from sextant.chapters.localization.pose_map_files import SavedPoseMap, open_pose_map, save_pose_map
from sextant.chapters.places.photo_features import extractor_of
from sextant.chapters.places.saved_descriptor import SavedDescriptor, kept_network
from sextant.correspondence import (
    LocalFeatureExtractor,
    LocalFeatures,
    Located,
    Pinhole,
    PosedMap,
    agreement,
    build_map,
    calibrated,
    detected,
    likely_convention,
)
from sextant.errors import ArgumentError, UserError
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run
from sextant.tables import counted

#: describes whole images, to choose candidates
DESCRIPTOR = "zoo:places"
#: images that a photo is matched to
CANDIDATES = 10
#: The largest logarithm of the number of false alarms of a located photo. Matches are not independent, as the equation
#: assumes: photos of other places reach -76 in maps that they do not show, photos of the maps stay below -1,800
#: (python -m benchmarks.posed_photos). Buildings that look alike reach -389: see LEAST_SEEN.
LOG10_FALSE_ALARMS = -100.0
#: The least share of the points of the nearest image that a located photo shows. Photos of the scenes of strecha_posed
#: show 46 % and more, those of an office at night 50 %, those of one with the same furniture at most 20 % (offices 1
#: and 2 of ``sextant data posed``); set between them before other offices were looked at
LEAST_SEEN = 0.3
#: points an image below which another convention of the poses is looked for; maps of overlapping photos have hundreds,
#: and 12 images of the office 237 in that order, 125 upside down, 65 with poses exchanged
FEW_POINTS = 150
#: Least share of the matches of neighbouring images that agree with the poses of a map of few points: 0.55 and more of
#: those of three real scenes and their halves, thirds and quarters, 0.02 to 0.21 with the poses exchanged
#: (results/localization.md, "Poses that contradict their photos")
LEAST_AGREEMENT = 0.25


@dataclass(frozen=True, eq=False)
class LocatedPhoto:
    """Where a photo was taken.

    Attributes:
        verdict: *located*, or *not in the map*: no more matches agree than chance allows, or most of the points that
            the photo would show are missing, as in another building with the same furniture.
        world_from_camera: x right, y down, z forward; None if it is not in the map.
        covariance: of a displacement (in units of the map) and a rotation (radians) in the axes of the camera,
            scaled by what the map's own images show (:mod:`sextant.correspondence.left_out`).
        inliers: matches that agree with the pose.
        matches: matches with points of the map.
        log10_false_alarms: decimal logarithm of the expected number of poses as well supported by chance.
        seen: of the points of the nearest image that the photo would show at this pose, the share that it matches.
        camera: the camera, with its estimated focal length where that was not known.
        residual_px: standard deviation of an inlier's pixel coordinate.
        nearest: index of the map's image with the most inliers.
        pixels: of the photo, for each inlier.
        map_pixels: of the nearest image, for those inliers that were matched in it, with ``pixels_in_nearest``.
        pixels_in_nearest: their pixels of the photo.
    """

    verdict: Literal["located", "not in the map"]
    world_from_camera: Float64[ndarray, "4 4"] | None = None
    covariance: Float64[ndarray, "6 6"] | None = None
    inliers: int = 0
    matches: int = 0
    log10_false_alarms: float = float("inf")
    seen: float = 0.0
    camera: Pinhole | None = None
    residual_px: float | None = None
    nearest: int | None = None
    pixels: Float32[ndarray, "n 2"] = field(default_factory=lambda: np.empty((0, 2), np.float32))
    pixels_in_nearest: Float32[ndarray, "m 2"] = field(default_factory=lambda: np.empty((0, 2), np.float32))
    map_pixels: Float32[ndarray, "m 2"] = field(default_factory=lambda: np.empty((0, 2), np.float32))


class PoseMap:
    """Photos at known poses, in which other photos are located to a fraction of the distance between them.

    >>> poses = PoseMap.from_images(images, world_from_camera, (fx, fy, cx, cy))  # doctest: +SKIP
    >>> photo = poses.locate("photo.jpg")  # doctest: +SKIP
    >>> print(photo.verdict, photo.world_from_camera, photo.inliers)  # doctest: +SKIP

    Create one with :meth:`from_images`, :meth:`from_folder` or :meth:`open`.

    Attributes:
        posed: features, poses, cameras and points.
        names: of the images.
    """

    def __init__(
        self,
        posed: PosedMap,
        names: Sequence[str],
        descriptors: Float32[ndarray, "n d"],
        described_by: SavedDescriptor,
        features: LocalFeatureExtractor,
        local: str | None = None,
    ):
        self.posed, self.names = posed, list(names)
        self._descriptors, self._described_by, self._features = descriptors, described_by, features
        self._local = local

    @classmethod
    def from_images(
        cls,
        images: Sequence[AnyImage],
        poses: Float64[ndarray, "n 4 4"] | Sequence[Any],
        cameras: Any = None,
        *,
        names: Sequence[str] | None = None,
        keypoints: int = 4096,
        side: int | None = 1024,
        descriptor: str | Path = DESCRIPTOR,
        local: LocalFeatureExtractor | str = "xfeat",
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> Self:
        """Make a map of images at known poses.

        Args:
            images: at least two.
            poses: ``world_from_camera`` of each, 4 x 4: x right, y down, z forward.
            cameras: ``(fx, fy, cx, cy)`` or a :class:`~sextant.correspondence.Pinhole` of all images, or one of each;
                None: square pixels, a centred principal point, and one focal length relative to the longer side, which
                is estimated.
            names: of the images; by default those of their files, or their numbers.
            keypoints: largest number of keypoints of an image.
            side: longer side to which images are scaled for their features; None keeps their size.
            descriptor: run or file of the network for places that chooses candidates, as for
                :meth:`sextant.PlaceMap.load`.
            local: the local features: ``xfeat``; ``trunk``, the activations of the network that chooses candidates;
                ``aliked:<folder>``, with the folder of its weights; or an object that extracts features, which then
                decides on ``keypoints`` and ``side``.
            progress: is given the images done and their number.

        Raises:
            UserError: there are fewer than two images, numbers differ, a pose is no rigid motion or implausibly far
                away, an image cannot be read, no points agree with the poses, or a package of the extra ``local`` is
                missing.
        """
        images = _several(images)
        matrices, known = checked_poses(poses, len(images)), _checked_names(names, images)
        described_by = kept_network(resolve_run(str(descriptor), default_outputs(), "descriptor").checkpoint)
        features = extractor_of(local, described_by.describer, keypoints=keypoints, side=side)
        found, descriptors = _features_of(images, features, described_by, progress)
        posed = _built(found, matrices, cameras_of(cameras, found, matrices, features), features)
        named = local if isinstance(local, str) else None
        return cls(posed, known, descriptors, described_by, features, named)

    @classmethod
    def from_folder(cls, folder: Path | str, **options: Any) -> Self:
        """Make a map of the photos below a folder, with the poses and cameras of a file there.

        The file is a model of COLMAP, nerfstudio's or OpenSfM's, ``poses.csv``, or poses in the order of the photos in
        the formats of TUM or KITTI. Photos are straightened by the distortion that it has.

        Args:
            folder: of photos, see :func:`~sextant.chapters.localization.data.posed_photos.posed_photos`.
            options: ``keypoints``, ``side``, ``descriptor``, ``local`` and ``progress`` of :meth:`from_images`.

        Raises:
            UserError: as there; or the file is missing, of other photos, or has a camera that cannot be of its photo.
        """
        photos = posed_photos(folder)
        names = [path.relative_to(Path(folder).expanduser()).as_posix() for path in photos.paths]
        if photos.cameras is None:
            return cls.from_images(photos.paths, photos.poses, names=names, **options)
        images = StraightPhotos(photos)
        check_cameras(cameras := images.cameras, names, photos.source)
        return cls.from_images(images, photos.poses, cameras, names=names, **options)

    def add(
        self, images: Sequence[AnyImage], poses: Any, cameras: Any = None, names: Sequence[str] | None = None
    ) -> None:
        """Add images to the map, and triangulate all anew; arguments as for :meth:`from_images`.

        Without ``cameras`` they are by the camera of the map's first image, and must have its shape.
        """
        images = _several(images)
        matrices, named = checked_poses(poses, len(images), least=1), _checked_names(names, images)
        found, descriptors = _features_of(images, self._features, self._described_by, lambda done, total: None)
        if cameras is None:
            more = [scaled(self.posed.cameras[0], each) for each in found]
        else:
            more = cameras_of(cameras, found, matrices, self._features)
        everything, joined = [*self.posed.features, *found], np.concatenate([self.posed.poses, matrices])
        posed = _built(everything, joined, [*self.posed.cameras, *more], self._features)
        self.posed, self.names = posed, [*self.names, *named]
        self._descriptors = np.concatenate([self._descriptors, descriptors])

    def locate(self, photo: AnyImage, camera: Any = None, candidates: int = CANDIDATES) -> LocatedPhoto:
        """Find where a photo was taken.

        Args:
            photo: a file, bytes or a Pillow image.
            camera: ``(fx, fy, cx, cy)`` or a :class:`~sextant.correspondence.Pinhole`: it is known; a
                :class:`~sextant.chapters.localization.given_cameras.CameraPrior`, such as the answer of
                ``PhotoCalibrator``: its focal length is refined; None: the focal length is unknown.
            candidates: number of images of the map that are matched.

        Raises:
            UserError: the photo cannot be read, or the camera is not one of these.
        """
        check_whole("candidates", candidates, 1, "For example candidates=10.")
        pixels = _colour(photo)
        features = detected(self._features, pixels)
        similarity = self._descriptors @ _described(self._described_by, pixels)[0]
        order = np.argsort(-similarity, kind="stable")[:candidates].tolist()
        lens, sigma = prior_of(camera, features, self.posed.cameras[order[0]])
        return _answer(self.posed, features, self.posed.locate(features, order, lens, sigma))

    def save(self, folder: Path | str) -> None:
        """Write the map to a folder; photos are not kept.

        Raises:
            UserError: it is a file, or cannot be created.
            OSError: it cannot be written to.
        """
        described = (self._described_by, self._descriptors)
        saved = SavedPoseMap(self.posed, self.names, *described, self._features, self._local)
        save_pose_map(saved, make_folder("folder", folder))

    @classmethod
    def open(cls, folder: Path | str, local: LocalFeatureExtractor | str | None = None) -> Self:
        """Open a saved map.

        Args:
            folder: that it was saved to.
            local: its local features, where these were an object, or their weights are in another folder now.

        Raises:
            UserError: it is not one, is damaged, or has other local features.
        """
        saved = open_pose_map(Path(folder).expanduser(), local)
        return cls(saved.posed, saved.names, saved.descriptors, saved.described_by, saved.features, saved.local)


def _built(
    found: Sequence[LocalFeatures], poses: ndarray, cameras: Sequence[Pinhole], features: LocalFeatureExtractor
) -> PosedMap:
    """The map, with its variance factor.

    Raises:
        UserError: few points agree with the poses, and many with poses of another convention, or hardly any matches do.
    """
    posed = build_map(found, poses, cameras, features.match)
    few = len(posed.points) < FEW_POINTS * len(found)
    if few:
        other = likely_convention(found, poses, cameras, features.match)
        if other is not None:
            raise UserError(
                f"matches of the map's images contradict their poses, but agree with poses that have {other}",
                "Convert them to world_from_camera with x right, y down, z forward.",
            )
    if len(posed.points) < LEAST_POINTS:
        raise UserError(*without_points(found))
    share = agreement(found, poses, cameras, features.match) if few else 1.0
    if share < LEAST_AGREEMENT:
        raise UserError(
            f"only {share:.0%} of the matches of neighbouring images agree with their poses",
            "Check that each pose belongs to its image, and its axes: world_from_camera, x right, y down, z forward.",
        )
    return calibrated(posed)


def _answer(posed: PosedMap, query: LocalFeatures, found: Located) -> LocatedPhoto:
    pose = found.pose
    if pose is None or found.log10_false_alarms > LOG10_FALSE_ALARMS or found.seen < LEAST_SEEN:
        return LocatedPhoto(
            "not in the map",
            matches=len(found.points),
            log10_false_alarms=found.log10_false_alarms,
            seen=found.seen,
        )
    images, rows, points = (each[pose.inliers] for each in (found.images, found.features, found.points))
    nearest = int(np.bincount(images).argmax())
    theirs = {int(point): row for row, point in enumerate(posed.point_of[nearest].tolist()) if point >= 0}
    shown = np.array([k for k, point in enumerate(points.tolist()) if point in theirs], np.int64)
    there = [theirs[point] for point in points[shown].tolist()]
    return LocatedPhoto(
        "located", pose.world_from_camera, pose.covariance, len(points), len(found.points), found.log10_false_alarms,
        found.seen, pose.camera, pose.residual_px, nearest, query.points[rows], query.points[rows[shown]],
        posed.features[nearest].points[there],
    )  # fmt: skip


def _described(described_by: SavedDescriptor, pixels: ndarray) -> Float32[ndarray, "1 d"]:
    """The global descriptor of an image, scaled to the network's size."""
    network: Any = described_by.describer
    size = (network.size.height, network.size.width, network.size.channels)
    rows = np.asarray(network.describe(_resized(pixels, size)[None]), np.float32)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True).clip(min=1e-12))


def _resized(pixels: ndarray, size: tuple[int, int, int]) -> ndarray:
    import cv2

    return np.asarray(cv2.resize(pixels, (size[1], size[0]), interpolation=cv2.INTER_AREA))


def _features_of(
    images: Sequence[AnyImage],
    features: LocalFeatureExtractor,
    described_by: SavedDescriptor,
    progress: Callable[[int, int], None],
) -> tuple[list[LocalFeatures], Float32[ndarray, "n d"]]:
    """Local features and global descriptors; one image is held at a time."""
    found, descriptors = list[LocalFeatures](), []
    for number, image in enumerate(images):
        try:
            pixels = _colour(image)
        except UserError as error:
            raise UserError(f"image {number}: {error.problem}", error.fix) from None
        found.append(detected(features, pixels))
        descriptors.append(_described(described_by, pixels))
        progress(number + 1, len(images))
    return found, np.concatenate(descriptors)


def _colour(image: AnyImage) -> ndarray:
    pixels = as_pixels(image)
    return np.repeat(pixels, 3, 2) if pixels.shape[2] == 1 else pixels


def _several(images: Sequence[AnyImage]) -> Sequence[AnyImage]:
    check_several("images", images)
    return images if hasattr(images, "__len__") else list(images)


def _checked_names(names: Sequence[str] | None, images: Sequence[AnyImage]) -> list[str]:
    if names is None:
        return [Path(each).name if isinstance(each, str | Path) else str(k) for k, each in enumerate(images)]
    given = [str(name) for name in names]
    if len(given) != len(images):
        raise ArgumentError(
            f"{counted(len(given), 'name')} for {counted(len(images), 'image')}", "One name for each image, or none."
        )
    return given
