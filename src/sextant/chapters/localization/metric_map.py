"""Poses of the frames of drives by correspondences with the images of a map, computed once and kept on disk.

Candidates are the images of the map with the nearest descriptors. Poses are kept by a hash of everything that they
depend on, so that all runs of a sweep with one descriptor share them.
"""

import hashlib
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
import torch
from jaxtyping import Float32, Float64
from numpy import ndarray

from sextant.chapters.localization.data.described import Showing
from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.localization.pose_map import CANDIDATES
from sextant.correspondence import LocalFeatureExtractor, LocalFeatures, Pinhole, PosedMap, build_map, calibrated
from sextant.errors import UserError
from sextant.geometry import level_camera_pose
from sextant.kept_array import keep_array, open_kept
from sextant.localization.metric_pose import planar_pose
from sextant.reporter import Advance
from sextant.retrieval import nearest_neighbours

#: images whose features are detected at a time
BATCH = 32
#: numbers kept of a frame: the logarithm of its false alarms, its pose and covariance in the plane
COLUMNS = 1 + 3 + 9
#: changes with what is kept
VERSION = 2

Described = tuple[Drive, Float32[ndarray, "n d"]]


class MetricMap:
    """Locates the frames of drives in maps of level cameras.

    Args:
        features: the local features.
        camera: of all images.
        cache: folder to keep poses in.
        show: makes the progress display of one drive.
    """

    def __init__(self, features: LocalFeatureExtractor, camera: Pinhole, cache: Path, show: Showing):
        self.features, self.camera, self.cache, self.show = features, camera, cache, show
        self._built: tuple[str, PosedMap] | None = None

    def locate(
        self, mapped: Described, driven: Described
    ) -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, "n 3 3"], Float64[ndarray, "n"]]:
        """Poses in the plane of the frames of a drive, covariances, and decimal logarithms of their false alarms.

        The last is infinite, and the others are meaningless, where no pose agrees with the matches.

        Args:
            mapped: the map's images at their poses, and their descriptors.
            driven: the drive, whose poses are not read, and its descriptors.

        Raises:
            UserError: the cache cannot be written to.
        """
        key = self._key(mapped, driven)
        path, shape = self.cache / f"located-{key}.npy", (len(driven[0]), COLUMNS)
        found = open_kept(path, shape, np.float64)
        if found is None:
            try:
                with self.show(f"locating {driven[0].name}") as progress:
                    keep_array(path, partial(self._write, mapped, driven, progress))
            except OSError as error:
                raise UserError(
                    f"{path.parent}: poses cannot be stored there: {error}", "paths.cache=<folder>"
                ) from None
            found = open_kept(path, shape, np.float64)
            assert found is not None
        rows = np.array(found)
        return rows[:, 1:4], rows[:, 4:].reshape(-1, 3, 3), rows[:, 0]

    def _write(self, mapped: Described, driven: Described, progress: Advance, file: BinaryIO) -> None:
        (drive, descriptors), (there, theirs) = driven, mapped
        rows = np.zeros((len(drive), COLUMNS))
        rows[:, 0], rows[:, 4:] = np.inf, np.eye(3).ravel()
        posed, count = self._map(mapped), min(CANDIDATES, len(there))
        nearest = nearest_neighbours(theirs, descriptors, count, "euclidean")
        assert drive.images is not None
        for start in range(0, len(drive), BATCH):
            for frame, query in enumerate(self._detected(drive, start, start + BATCH), start):
                found = posed.locate(query, nearest[frame].tolist(), self.camera)
                if found.pose is not None:
                    pose, covariance = planar_pose(found.pose.world_from_camera, found.pose.covariance)
                    if np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance)[0] > 0:
                        rows[frame] = [found.log10_false_alarms, *pose, *covariance.ravel()]
                progress(frame + 1, len(drive))
        np.save(file, rows, allow_pickle=False)

    def _map(self, mapped: Described) -> PosedMap:
        """The map's features and points; that of the last call is kept."""
        key, drive = self._key(mapped), mapped[0]
        if self._built is None or self._built[0] != key:
            detected = [each for k in range(0, len(drive), BATCH) for each in self._detected(drive, k, k + BATCH)]
            x, y, heading = torch.from_numpy(np.ascontiguousarray(drive.poses.T))
            poses = level_camera_pose(x, y, torch.zeros_like(x), heading).numpy()  # the height is not used
            cameras = [self.camera] * len(drive)
            self._built = key, calibrated(build_map(detected, poses, cameras, self.features.match))
        return self._built[1]

    def _detected(self, drive: Drive, start: int, stop: int) -> Sequence[LocalFeatures]:
        assert drive.images is not None
        images = np.asarray(drive.images[start : min(stop, len(drive))])
        return self.features.detect(list(np.repeat(images, 3, axis=3) if images.shape[3] == 1 else images))

    def _key(self, *drives: Described) -> str:
        hashed = hashlib.sha256(f"{VERSION} {self.features.model} {self.camera}".encode())
        for number, (drive, descriptors) in enumerate(drives):
            assert drive.images is not None
            if number == 0:
                hashed.update(np.ascontiguousarray(drive.poses).tobytes())
            hashed.update(np.ascontiguousarray(descriptors).tobytes())
            for start in range(0, len(drive), 256):
                hashed.update(np.ascontiguousarray(drive.images[start : start + 256]).tobytes())
        return hashed.hexdigest()[:16]
