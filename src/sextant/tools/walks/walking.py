"""Localization of a folder or video of an unknown camera in a map made with another camera.

The images are calibrated together, straightened through one virtual camera, described, and localized. The parts are
:class:`~sextant.PhotoCalibrator`, :class:`~sextant.data.photos.Pinhole` and :class:`~sextant.Localizer`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from sextant.applications.arguments import check_apart
from sextant.applications.write_errors import telling_write_errors
from sextant.chapters.calibration.calibrator import PhotoCalibrator
from sextant.chapters.calibration.priors import FocalPrior
from sextant.chapters.localization.data.frames import Photos
from sextant.chapters.localization.data.own_drive import OwnDrive, open_drive
from sextant.chapters.localization.found_map import find_map
from sextant.chapters.localization.localized_drive import ReplayKind, localize_drive
from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.localizer_arguments import Start
from sextant.chapters.localization.localizer_folder import check_descriptor
from sextant.chapters.localization.written_poses import refuse_to_replace_poses
from sextant.chapters.places.saved_descriptor import Describes
from sextant.data.photos import Pinhole, read_photo
from sextant.data.videos import Frame
from sextant.errors import ArgumentError, UserError
from sextant.reporter import SILENT, Progress
from sextant.runs.outputs_folder import default_outputs
from sextant.tables import counted
from sextant.tools.walks.posed_images import PosedImages, posed_images
from sextant.tools.walks.shared_camera import Held, SharedCamera, check_held, check_view, shared_view
from sextant.tools.walks.walk import MOST_SHOWN, Walk, write_walk_report

#: key in a localizer's facts: the virtual camera of its images
VIEW = "view"


def localize_walk(
    input: Path | str,
    map: Path | str,
    output: Path | str,
    *,
    calibrator: PhotoCalibrator | None = None,
    descriptor: Describes | str | Path | None = None,
    held: Held = "mounted",
    photos: int = 40,
    rows: int | None = None,
    vfov_deg: float | None = None,
    skip_bad: bool = False,
    focal_prior: FocalPrior = None,
    odometry: Path | None = None,
    every: int = 1,
    image_topic: str | None = None,
    odometry_topic: str | None = None,
    particles: int | None = None,
    start: Start = "uniform",
    seed: int = 0,
    smooth: bool = False,
    replay: ReplayKind = "mp4",
    progress: Progress = SILENT.progress,
) -> Walk:
    """Localize a walk with an unknown camera in a map of another season, and write all results.

    The walk's images are calibrated together, as those of one camera, and so are the map's. Both are straightened to
    the view of one camera without distortion, and the map is built from the straightened images.

    Args:
        input: folder of photos in the order of their names, or a video, or a ROS bag.
        map: folder of images with poses (:func:`~sextant.tools.walks.posed_images.posed_images`), or what
            an earlier walk wrote as ``map``, or another saved map, for which ``vfov_deg`` must be given.
        output: folder for ``report.md``, ``walk.json``, ``poses.csv``, ``trajectory.tum``, ``map`` and pictures.
        calibrator: calibrates both cameras; the package's own by default.
        descriptor: as for :meth:`~sextant.Localizer.from_images`; not for a saved map, which has its own.
        held: how the cameras were held: ``mounted``, ``by_hand`` (each image has its own tilt and roll, and all are
            calibrated), or ``level``.
        photos: number of images of each camera that are calibrated, evenly spaced.
        rows: rows of the straightened images, 120 by default; not for a saved map, which has its own.
        vfov_deg: vertical field of view of the straightened images in degrees; by default the largest that both cameras
            cover. Not for a saved map that has its own.
        skip_bad: leave out images of the map at exactly the pose of another, which are otherwise an error; not for a
            saved map.
        focal_prior: for the walk's camera, as for :meth:`~sextant.PhotoCalibrator.one_camera`.
        odometry: as for ``sextant predict``; without it, motion is unknown.
        every: of a video or bag, use every n-th image.
        image_topic, odometry_topic: topics of a bag that has several.
        particles, start, seed: settings of the filter; by default as many particles as the map was made for.
        smooth: write ``smoothed.tum`` too.
        replay: animation of the particles.
        progress: shows the progress of the work.

    Raises:
        UserError: there are no images or no map, a camera cannot be calibrated, an argument is out of range or
            does not apply to a saved map, or the disk is full.

    Example:
        >>> walk = localize_walk("winter.mp4", "summer", "found", every=10)  # doctest: +SKIP
        >>> walk.camera.focal_px, walk.rows[-1].told.pose  # doctest: +SKIP
    """
    if photos < 1:
        raise ArgumentError(f"photos={photos} must be at least 1", "photos=40")
    check_held(held)
    check_view(120 if rows is None else rows, vfov_deg)
    output = Path(output).expanduser()
    check_apart(output, input=input, map=map)
    refuse_to_replace_poses(output, smooth=smooth, replay=replay, odometry=odometry, input=input)
    calibrator = calibrator or PhotoCalibrator.load()
    saved = find_map(map, default_outputs())
    mapped = posed_images(map, skip_bad=skip_bad) if saved is None else None
    if saved is None:
        check_descriptor(descriptor)
    else:
        _check_saved(map, descriptor=descriptor, rows=rows, skip_bad=skip_bad or None)
    drive = open_drive(
        str(input), odometry, output, image_topic=image_topic, odometry_topic=odometry_topic, every=every
    )
    if drive.endless:
        raise ArgumentError(
            f"input={input}: a walk is calibrated from all its images before the first is localized",
            "Record it as a video. A camera is localized live by sextant localize, in a map of images like its own.",
        )
    lag = len(drive) if smooth else 0
    if mapped is None:
        localizer = Localizer.load(str(map), particles=particles, start=start, seed=seed, lag=lag)
        map_camera, view, images = None, _view_of(localizer, map, vfov_deg), None
    with telling_write_errors(output):
        output.mkdir(parents=True, exist_ok=True)
    with progress("calibrating the walk", "images") as advance:
        advance(0, 1)
        camera = _camera_of_drive(calibrator, drive, held, photos, focal_prior)
    if mapped is not None:
        with progress("calibrating the map", "images") as advance:
            advance(0, 1)
            map_camera = _camera_of(calibrator, mapped.paths, held, photos)
        view = shared_view([camera, map_camera], 120 if rows is None else rows, vfov_deg)
        images, mapped = _straightened_map(mapped, map_camera, view)
        localizer = Localizer.from_images(
            images, mapped.poses, descriptor, particles=particles, start=start, seed=seed, lag=lag
        )
        localizer.facts[VIEW] = view.facts()
        with telling_write_errors(output):
            localizer.save(output / "map")
        drive.remarks.extend(mapped.remarks)
    straight = _Straightened(drive, camera, view, localizer.image_size)
    found = localize_drive(localizer, drive, straight, output, replay=replay, smooth=smooth, progress=progress)
    walk = Walk(
        camera, map_camera, view, found.rows, straight.unseen, tuple(drive.remarks), tuple(found.files),
        found.interrupted,
    )  # fmt: skip
    with telling_write_errors(output):
        report = write_walk_report(walk, straight.shown, localizer, images, output)
    return replace(walk, files=(*report, *walk.files))


def _camera_of(
    calibrator: PhotoCalibrator, paths: Sequence[Path], held: Held, photos: int, focal_prior: FocalPrior = None
) -> SharedCamera:
    chosen = paths if held == "by_hand" else [paths[i] for i in _spread(len(paths), photos)]
    return SharedCamera.of(calibrator.one_camera(chosen, focal_prior=focal_prior, errors="return"), held)


def _camera_of_drive(
    calibrator: PhotoCalibrator, drive: OwnDrive, held: Held, photos: int, focal_prior: FocalPrior
) -> SharedCamera:
    if isinstance(drive.frames, Photos):
        there = [path for name in drive.frames.names if (path := drive.frames.folder / name).is_file()]
        if held != "by_hand" or len(there) == len(drive):
            return _camera_of(calibrator, there, held, photos, focal_prior)
    count = len(drive)
    chosen = set(range(count) if held == "by_hand" else _spread(count, photos))
    seen = (frame for number, frame in enumerate(drive.frames.read(None)) if number in chosen)
    blank = np.zeros((1, 1, 3), np.uint8)  # it is rejected, which keeps the numbers of the others
    images = (blank if frame.image is None else frame.image for frame in seen)
    return SharedCamera.of(calibrator.one_camera(images, focal_prior=focal_prior, errors="return"), held)


def _spread(count: int, wanted: int) -> list[int]:
    return sorted({round(at) for at in np.linspace(0, count - 1, min(count, wanted)).tolist()})


def _straightened_map(
    mapped: PosedImages, camera: SharedCamera, view: Pinhole
) -> tuple[UInt8[ndarray, "n h w 3"], PosedImages]:
    """The images that can be read, straightened, and a map of these only."""
    images, read, problems = [], [], []
    for number, path in enumerate(mapped.paths):
        try:
            image = read_photo(path).image
        except UserError as error:
            problems.append(error.problem)
            continue
        images.append(camera.straighten(image, view, number)[0])
        read.append(number)
    if not problems:
        return np.stack(images), mapped
    told = (
        f"{len(problems)} of {counted(len(mapped.paths), 'image')} of the map cannot be read, hence left out: "
        f"{problems[0]}"
    )
    paths, remarks = [mapped.paths[number] for number in read], (*mapped.remarks, told)
    return np.stack(images), replace(mapped, paths=paths, poses=mapped.poses[read], remarks=remarks)


def _check_saved(map: Path | str, **given: object) -> None:
    """Refuse arguments that a saved map already determines."""
    for name, value in given.items():
        if value is not None:
            raise ArgumentError(
                f"{name}={value} does not apply to map={map}: a saved map has its own",
                f"Leave out {name}, or give the folder of the map's images, with their poses.",
            )


def _view_of(localizer: Localizer, map: Path | str, vfov_deg: float | None) -> Pinhole:
    """The view of a saved map: its own, or a level one with a given field of view."""
    if localizer.descriptor.describer is None or localizer.image_size is None:
        raise UserError(
            f"map={map}: the map was built from descriptors computed elsewhere, so images cannot be described",
            "Give the folder of its images, with their poses.",
        )
    facts = localizer.facts.get(VIEW)
    if facts is not None:
        _check_saved(map, vfov_deg=vfov_deg)
        return Pinhole(**facts)
    if vfov_deg is None:
        raise ArgumentError(
            f"map={map} does not record the camera of its images",
            "Give their vertical field of view in degrees, vfov_deg=55; or the folder of its images, with their poses.",
        )
    height, width = localizer.image_size[:2]
    return Pinhole(width, height, height / 2 / float(np.tan(np.radians(vfov_deg) / 2)))


class _Straightened:
    """The frames of a drive through the view; some of them are kept for display."""

    def __init__(self, drive: OwnDrive, camera: SharedCamera, view: Pinhole, size: tuple[int, int, int] | None):
        self.drive, self.camera, self.view = drive, camera, view
        self.grey = size is not None and size[2] == 1
        self.wanted = set(_spread(len(drive), MOST_SHOWN))
        self.shown: list[tuple[int, ndarray, ndarray]] = []
        self._unseen: list[float] = []

    @property
    def unseen(self) -> float:
        """Mean share of the view that the camera does not cover."""
        return float(np.mean(self._unseen)) if self._unseen else 0.0

    def __iter__(self) -> Iterator[Frame]:
        for number, frame in enumerate(self.drive.frames.read(None)):
            if frame.image is None:
                yield frame
                continue
            straight, unseen = self.camera.straighten(frame.image, self.view, number)
            self._unseen.append(unseen)
            if number in self.wanted:
                self.shown.append((number, frame.image, straight))
            yield Frame(frame.name, straight.mean(-1, keepdims=True).astype(np.uint8) if self.grey else straight)
