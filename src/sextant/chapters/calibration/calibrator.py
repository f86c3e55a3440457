"""Camera calibration from photos, by a trained network and the lines in the photos."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sized
from pathlib import Path
from typing import Any, Literal, Self, overload

from sextant.applications.failures import Errors, FailedPhoto, attempted, raise_failed, several
from sextant.chapters.calibration.confidence import photo_camera
from sextant.chapters.calibration.finding import Finding
from sextant.chapters.calibration.inference import AnyPhoto, See, find_cameras
from sextant.chapters.calibration.jointly import Method, by_method
from sextant.chapters.calibration.matched_focal import PhotoMatches
from sextant.chapters.calibration.network import CameraNetwork, trained_camera_network
from sextant.chapters.calibration.one_camera import OneCamera, fuse_as_one_camera
from sextant.chapters.calibration.other_networks import OtherNetwork, PhotoNetwork
from sextant.chapters.calibration.photo_camera import PhotoCamera
from sextant.chapters.calibration.priors import (
    FocalPrior,
    GravityPrior,
    check_priors,
    with_gravity,
    with_priors,
)
from sextant.errors import ArgumentError
from sextant.kit.trained import read_trained
from sextant.ranges import Positive, checked
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run

#: the default model
SHIPPED = "zoo:calibration"


class PhotoCalibrator:
    """Calibrates photos by combining a calibration run's network, the photo's lines, and a prior on typical cameras.

    The network gets the largest centred part of a photo with an aspect ratio that it was trained on. Results are in
    pixels of the whole upright original. Photos are image files of any format and size or Pillow images, rotated
    upright by EXIF, or upright arrays of RGB values in [0, 255]. They are decoded one at a time and only the network's
    small input is kept, so memory stays bounded and any iterable will do.

    A known focal length, or the other photos of one camera, refine the focal length and the apparent distortion
    ``k1 / f²``. Tilt and roll are then estimated again with that lens; with ``network`` alone, roll and the position of
    the horizon in the image are kept.

    >>> calibrator = PhotoCalibrator.load("outputs/runs/calibration/1a2b3c4d-s0")  # doctest: +SKIP
    >>> camera = calibrator.calibrate("photo.jpg")  # doctest: +SKIP
    >>> print(camera.focal_px, camera.interval_95.focal_px, camera.verdict)  # doctest: +SKIP

    Args:
        network: the trained network, or one of others: any object whose ``predict(image)`` returns a camera, a field or
            rays with spreads (:class:`~sextant.chapters.calibration.other_networks.PhotoNetwork`).
        method: ``joint`` combines all evidence in one robust least-squares problem; ``lines`` leaves the network out,
            and ``network`` uses the network only.
        scale: factors on the spreads of tilt, roll, field of view and k1/f² of a network of others, as
            ``sextant benchmark calibration network=`` fits them.

    Raises:
        UserError: there is no such method, the network has no method ``predict``, or the scale does not go with it.
    """

    network: CameraNetwork | OtherNetwork

    @checked
    def __init__(
        self,
        network: CameraNetwork | PhotoNetwork,
        method: Method = "joint",
        *,
        scale: tuple[Positive, Positive, Positive, Positive] | None = None,
    ):
        self.method = method
        if not isinstance(network, CameraNetwork):
            self.network = OtherNetwork(network) if scale is None else OtherNetwork(network, scale)
        elif scale is not None:
            raise ArgumentError("scale= is for networks of others: the intervals of this one are conformal")
        else:
            self.network = network.eval()

    @classmethod
    def load(
        cls,
        run: Path | str = SHIPPED,
        outputs: Path | str | None = None,
        *,
        trust: bool = False,
        method: Method = "joint",
    ) -> Self:
        """The calibrator of a run, or the one that comes with the package.

        Args:
            run: an MLflow run id, a run directory or its name, or a checkpoint; by default the package's model.
            outputs: folder of runs; the folder that runs are written to by default.
            trust: build user-defined parts that the checkpoint names.
            method: as for the class.

        Raises:
            UserError: there is no such run, its file is damaged, or it is of another task.
        """
        found = resolve_run(str(run), default_outputs() if outputs is None else Path(outputs).expanduser())
        return cls.of(read_trained(found.checkpoint), found.checkpoint, trust=trust, method=method)

    @classmethod
    def of(cls, content: Mapping[str, Any], checkpoint: Path, *, trust: bool = False, method: Method = "joint") -> Self:
        """The calibrator of a checkpoint that has been read already.

        Raises:
            UserError: as for :meth:`load`.
        """
        return cls(trained_camera_network(content, checkpoint, trust=trust), method)

    def calibrate(
        self, photo: AnyPhoto, *, focal_prior: FocalPrior = None, gravity_prior: GravityPrior = None
    ) -> PhotoCamera:
        """The camera of a photo.

        Args:
            photo: a file, an array of RGB values from 0 to 255, or a Pillow image.
            focal_prior: a known focal length in pixels; ``exif`` for the one in the file.
            gravity_prior: ``exif`` for the reading of the phone's accelerometer, if the file has it.

        Raises:
            UserError: the photo cannot be read, or the network's prediction is not a valid camera.
        """
        name = _name(photo, "the photo")
        (found,) = self._each([(name, photo)], focal_prior, gravity_prior)
        if isinstance(found, FailedPhoto):
            raise found.error
        return found

    @overload
    def calibrate_many(
        self,
        photos: Iterable[AnyPhoto],
        *,
        focal_prior: FocalPrior = None,
        gravity_prior: GravityPrior = None,
        errors: Literal["raise"] = "raise",
    ) -> list[PhotoCamera]: ...
    @overload
    def calibrate_many(
        self,
        photos: Iterable[AnyPhoto],
        *,
        focal_prior: FocalPrior = None,
        gravity_prior: GravityPrior = None,
        errors: Literal["return"],
    ) -> list[PhotoCamera | FailedPhoto]: ...
    def calibrate_many(
        self,
        photos: Iterable[AnyPhoto],
        *,
        focal_prior: FocalPrior = None,
        gravity_prior: GravityPrior = None,
        errors: Errors = "raise",
    ) -> list[PhotoCamera] | list[PhotoCamera | FailedPhoto]:
        """The cameras of photos, each calibrated by itself, in their order.

        Args:
            photos: files, arrays of RGB values from 0 to 255, or Pillow images.
            focal_prior, gravity_prior: as for :meth:`calibrate`, for all photos.
            errors: ``raise`` tries all photos, then raises if some failed; ``return`` puts a :class:`FailedPhoto` in
                the place of each that did.

        Raises:
            FailedPhotosError: photos failed; it names all of them.
        """
        found = list(self._each(_named(several(photos, errors)), focal_prior, gravity_prior))
        raise_failed(found, len(found), "calibrated", errors)
        return found

    def one_camera(
        self,
        photos: Iterable[AnyPhoto],
        *,
        focal_prior: FocalPrior = None,
        gravity_prior: GravityPrior = None,
        errors: Errors = "raise",
    ) -> OneCamera:
        """The camera of photos that were all taken with one camera and lens setting.

        The extra ``local`` adds matches between photos of one scene as evidence; without it, the result says so.

        Args:
            photos: as for :meth:`calibrate_many`, in any orientation, of one shape; they may be scaled.
            focal_prior: as for :meth:`calibrate`; in pixels only for photos of one size.
            gravity_prior: as for :meth:`calibrate`, for each photo.
            errors: ``raise`` tries all photos, then raises if some failed; ``return`` fuses the others.

        Raises:
            FailedPhotosError: photos failed; with ``errors="return"``, all of them.
            UserError: they cannot be of one camera, or the network gives no intervals.
        """
        check_priors(focal_prior, gravity_prior)
        photos = several(photos, errors)
        matches = PhotoMatches(len(photos) if isinstance(photos, Sized) else None)
        found = list(self._found(_named(photos), matches.see))
        findings = [with_gravity(each, gravity_prior) for each in found if isinstance(each, Finding)]
        raise_failed(found, len(found), "calibrated", errors if findings else "raise")
        if not found:
            raise ArgumentError("photos=[]: there is no photo of the camera", "Give at least one.")
        fused, fusion, doubts, told = fuse_as_one_camera(findings, focal_prior, matches)
        cameras = (photo_camera(finding, self.network) for finding in fused)
        all_photos = tuple(each if isinstance(each, FailedPhoto) else next(cameras) for each in found)
        return OneCamera(all_photos, fusion, doubts, told)

    def _each(
        self, photos: Iterable[tuple[str, AnyPhoto]], focal_prior: FocalPrior, gravity_prior: GravityPrior
    ) -> Iterator[PhotoCamera | FailedPhoto]:
        check_priors(focal_prior, gravity_prior)
        for found in self._found(photos):
            if isinstance(found, Finding):
                yield attempted(found.name, self._camera, found, focal_prior, gravity_prior)
            else:
                yield found

    def _camera(self, found: Finding, focal_prior: FocalPrior, gravity_prior: GravityPrior) -> PhotoCamera:
        return photo_camera(with_priors(found, focal_prior, gravity_prior), self.network)

    def _found(self, photos: Iterable[tuple[str, AnyPhoto]], see: See | None = None) -> Iterator[Finding | FailedPhoto]:
        for found in find_cameras(self.network, photos, look_at_lines=self.method != "network", see=see):
            yield found if isinstance(found, FailedPhoto) else attempted(found.name, by_method, found, self.method)


def _named(photos: Iterable[AnyPhoto]) -> Iterator[tuple[str, AnyPhoto]]:
    for i, photo in enumerate(photos):
        yield _name(photo, f"photos[{i}]"), photo


def _name(photo: AnyPhoto, otherwise: str) -> str:
    return os.path.expanduser(str(photo)) if isinstance(photo, Path | str) else otherwise
