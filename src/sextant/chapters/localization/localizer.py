"""Live localization of a robot: images and odometry go in step by step, poses with their uncertainty come out.

>>> localizer = Localizer.load("outputs/runs/localization/1a2b3c4d-s0")  # doctest: +SKIP
>>> for motion, image in robot:  # doctest: +SKIP
...     told = localizer.step(motion, image)
...     print(told.pose, told.sigmas, told.lost)

The map may also be built from arrays, with :meth:`Localizer.from_images`, and saved with :meth:`Localizer.save`.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.applications.arguments import check_whole, make_folder
from sextant.applications.pixels import AnyImage, as_pixels, several_pixels
from sextant.chapters.localization.localized_pose import LocalizedPose
from sextant.chapters.localization.localizer_arguments import (
    Start,
    as_motion,
    as_numbers,
    check_parts,
    check_settings,
    check_start,
    start_of,
)
from sextant.chapters.localization.localizer_folder import (
    check_descriptor,
    checked_poses,
    described_map,
    open_localizer,
    save_localizer,
)
from sextant.chapters.localization.map_pictures import map_pictures
from sextant.chapters.localization.saved_filter import (
    LEAST_PARTICLES,
    fitted_kernel,
    usual_filter,
    usual_particles,
    usual_radius,
)
from sextant.chapters.places.saved_descriptor import Describes, SavedDescriptor
from sextant.errors import UserError, shown
from sextant.localization.adaptation import Adaptation
from sextant.localization.belief import Belief
from sextant.localization.constants import NOISE, ODDS, SHARPER, TEMPERING
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.estimate import Estimate, estimate
from sextant.localization.likelihood import Likelihood
from sextant.localization.localize import Localized, Steps
from sextant.localization.motion import MotionModel
from sextant.localization.observation import ObservationModel
from sextant.localization.observers import Camera
from sextant.localization.particle_filter import ParticleFilter
from sextant.localization.pose_kernel import PoseKernel
from sextant.localization.recognition import EvenSample
from sextant.localization.recovery import Recovery
from sextant.localization.smoothing import smoothed
from sextant.reporter import Advance
from sextant.runs.outputs_folder import default_outputs
from sextant.tables import counted


class Localizer:
    """A map, its sensor and a particle filter, for one robot.

    Args:
        model: observation model, fitted to the map's descriptors.
        likelihood: likelihood with its calibration.
        filter: particle filter whose prior is the map's.
        radius: radius of the mode that is reported, in the unit of the map.
        descriptor: descriptor of images; without it, steps take vectors.
        image_size: height, width and channels of the map's images; None if unknown.
        unit: unit of positions.
        particles: number of particles, unless it adapts.
        adapts: learn while driving how appearance has changed since the map was made
            (:class:`~sextant.localization.appearance_change.AppearanceChange`), the systematic error of odometry
            (:class:`~sextant.localization.odometry_scale.OdometryScale`), and the robot's speed where there is no
            odometry (:class:`~sextant.localization.constant_velocity.ConstantVelocity`) or where it reports that a
            moving robot stands still (:class:`~sextant.localization.odometry_check.OdometryCheck`); and weight images
            by how new they are. For a likelihood that was not fitted to another drive.
        odds: with ``adapts``, the scale of one image's evidence, as for
            :class:`~sextant.localization.evidence_scale.EvidenceScale`; None keeps that of the likelihood.
        start: where the particles are before the first image.
        seed: seed of all random numbers.
        facts: other plain values to save with the map.
        pictures: small pictures of the map's images, for display; None for none.
        lag: number of steps that :meth:`past` smooths.
        region_scale: factor by which reported standard deviations are multiplied, as
            :mod:`sextant.chapters.localization.along_drives` learns it for a filter with these settings.

    Raises:
        UserError: the number of particles is zero or above a million, there is no such start, the lag is negative, or
            the radius or scale is not a number above 0.
    """

    def __init__(
        self,
        model: ObservationModel,
        likelihood: Likelihood,
        filter: ParticleFilter,
        *,
        radius: float,
        descriptor: SavedDescriptor | None = None,
        image_size: tuple[int, int, int] | None = None,
        unit: Literal["m", "frames"] = "m",
        particles: int = LEAST_PARTICLES,
        adapts: bool = False,
        odds: float | None = None,
        start: Start = "uniform",
        seed: int = 0,
        facts: dict[str, Any] | None = None,
        pictures: UInt8[ndarray, "n h w c"] | None = None,
        lag: int = 0,
        region_scale: float = 1.0,
    ):
        check_settings(radius, particles, start, lag, region_scale)
        self.model, self.likelihood, self.filter, self.radius = model, likelihood, filter, radius
        self.descriptor, self.image_size, self.unit = descriptor or SavedDescriptor(), image_size, unit
        self.particles, self.adapts, self.seed, self.facts = particles, adapts, seed, dict(facts or {})
        self.lag, self.pictures, self.odds, self.region_scale = lag, pictures, odds, region_scale
        self._start = start_of(start)
        self._adaptation = Adaptation(model, likelihood, learns=adapts, odds=odds)
        self.reset()

    def __repr__(self) -> str:
        whose, found = self.descriptor.facts["kind"], self.model.map
        return (
            f"{type(self).__name__}({counted(len(found), 'image')}, {found.dimension} numbers each by descriptor "
            f"{whose!r}, spacing={self._adaptation.spacing:.2g} {self.unit}, particles={self.particles:,}, "
            f"adapts={self.adapts})"
        )

    # -- live use ------------------------------------------------------------------------------------------------------

    def reset(self, seed: int | None = None, start: Start | None = None) -> None:
        """Discard the belief and all that was learned; the next step is the first. The seed determines the results.

        Args:
            seed: of all random numbers; None keeps it.
            start: where the particles are before the first image, until the next reset; None for the class's.

        Raises:
            UserError: the seed is not a whole number of at least 0, or there is no such start.
        """
        begins = self._start if start is None else start
        check_whole("seed", self.seed if seed is None else seed, 0, "For example seed=1")
        check_start(begins)
        self.seed, self._begins = int(self.seed if seed is None else seed), start_of(begins)
        self._generator = torch.Generator().manual_seed(self.seed)
        self._now: Localized | None = None
        self._past: list[Localized] = []
        self._sample = EvenSample()

    @torch.no_grad()
    def step(
        self,
        motion: Sequence[float] | Float[ndarray, "3"] | None = None,
        image: AnyImage | None = None,
        descriptor: Float[ndarray, " d"] | None = None,
    ) -> LocalizedPose:
        """Move, observe, and return the estimate of the robot's pose.

        Args:
            motion: dx, dy in the unit of the map and dtheta in rad since the previous step, in the robot's frame then.
                None if unknown: particles then continue at the pace of the drive if the localizer adapts, otherwise
                spread according to the motion model. In the first step particles do not move: it only tells whether
                there is odometry.
            image: a file, bytes or a picture, stretched to the size of the map's images; None if there is none.
            descriptor: descriptor to use instead of an image, computed like those of the map, before whitening.

        Raises:
            UserError: the motion is not three finite numbers, the image or descriptor is not like the map's, or the map
                has no descriptor for images.
        """
        row = self._seen(image, descriptor)
        moved, seen = as_motion(motion)[None], torch.tensor([row is not None])
        shown = np.zeros((1, self.model.map.dimension), np.float32) if row is None else row[None].numpy()
        camera, filter = Camera(self.model, self.likelihood, shown), self.filter
        steps = Steps(filter, self._begins, self.particles, self.radius, self._adaptation)
        now = steps.step(self._now, moved, camera, np.zeros(1, np.int64), seen, self._generator)
        before, self._now = self._now, now
        if row is not None and not _repeats(before, now):
            self._sample.add(row)
        self._past = [*self._past[-self.lag :], now] if self.lag else []
        return self._told(now, now.belief, now.found)

    @property
    def odometry_scale(self) -> float:
        """The learned factor of odometry since the last reset; 1 for a localizer that does not adapt."""
        learned = None if self._now is None else self._now.learned
        return 1.0 if learned is None else float(learned.odometry.factor[0])

    @property
    def recognised(self) -> float:
        """The mean recognition of the images since the last reset, whether motion is known or not.

        As :attr:`LocalizedPose.recognised`, but of all images that do not repeat one before: below 0.4 the drive was
        not taken in this map. nan before the fifth of them, and in a map of too few places.
        """
        known, images = self._adaptation.recognition, self._sample.images
        return math.nan if known is None or not images else known.of_drive(torch.stack(images))

    def past(self, progress: Advance = lambda done, total: None) -> list[LocalizedPose]:
        """Smoothed poses of the last ``lag`` steps and the current one, given all images so far; the oldest first.

        Its cost is quadratic in the number of particles, so call it only when it is needed.

        Args:
            progress: called with the number of steps smoothed and the total.
        """
        if not self._past:
            return []
        draws = torch.Generator().manual_seed(self.seed)  # separate: calling this does not affect later steps
        beliefs, later = [each.belief for each in self._past], self._past[1:]
        motions, models = [each.moved for each in later], [each.moves for each in later]
        better = smoothed(beliefs, motions, models, draws, progress=progress)
        return [
            self._told(each, belief, estimate(belief, self.radius))
            for each, belief in zip(self._past, better, strict=True)
        ]

    def _told(self, step: Localized, belief: Belief, found: Estimate) -> LocalizedPose:
        """The report of a step, with its belief or a smoothed one."""
        assert step.learned is not None
        learned, smooth = step.learned, belief is not step.belief
        recognised, support = float(learned.recognised[0]), self.filter.support
        off_map = support.off_map(belief) if smooth and support is not None else learned.last.off_map
        return LocalizedPose(
            found.pose[0].numpy(),
            self.region_scale**2 * found.covariance[0].numpy(),
            float(found.mass[0]),
            int(found.modes[0]),
            bool(replace(step, found=found).lost[0]),
            bool(step.told.degenerate[0]) and not smooth,
            float(off_map[0]),
            float(learned.innovation.told[0]),
            recognised,
            bool(learned.disbelieved[0]) and not smooth,
        )

    @property
    def belief(self) -> Belief:
        """The weighted particles of the one run.

        Raises:
            UserError: no step was made since the last reset.
        """
        if self._now is None:
            raise UserError("there is no belief before the first step", "Call step(motion, image) first.")
        return self._now.belief

    def picture_near(self, pose: Float64[ndarray, "3"]) -> UInt8[ndarray, "h w c"] | None:
        """The small picture of the map's image nearest to a pose; None for a map without pictures.

        Raises:
            UserError: the pose is not three finite numbers.
        """
        if self.pictures is None:
            return None
        if (at := as_numbers(pose)).shape != (3,) or not np.isfinite(at).all():
            raise UserError(
                f"pose={shown(pose)} must be three finite numbers: x, y, heading", "For example step(...).pose."
            )
        return np.asarray(self.pictures[int(self._adaptation.near.nearest(torch.from_numpy(at)[None])[0])])

    def describe(self, image: AnyImage) -> Float32[ndarray, " d"]:
        """The descriptor of an image, before whitening.

        Raises:
            UserError: it is not an image, or the map has no descriptor.
        """
        if self.descriptor.describer is None:
            raise UserError(
                "the map was built from descriptors computed elsewhere, so images cannot be described",
                "Give vectors: step(motion, descriptor=vector); or a descriptor: load(folder, descriptor=...)",
            )
        pixels = as_pixels(image, self.image_size)
        return np.asarray(self.descriptor.describer.describe(pixels[None])[0])

    def _seen(self, image: AnyImage | None, descriptor: ndarray | None) -> Tensor | None:
        if image is not None and descriptor is not None:
            raise UserError("step() was given an image and a descriptor", "Give one of the two.")
        if image is not None:
            descriptor = self.describe(image)
        if descriptor is None:
            return None
        row = torch.from_numpy(as_numbers(descriptor).astype(np.float32))
        if row.ndim != 1 or not bool(row.isfinite().all()):
            raise UserError(f"the descriptor, of shape {tuple(row.shape)}, is not one row of finite numbers")
        self.model.check_dimension(row[None])
        whitener = self.descriptor.whitener
        return row if whitener is None else (row[None] @ whitener.to(row.dtype))[0]

    # -- maps ----------------------------------------------------------------------------------------------------------

    def save(self, folder: Path | str) -> None:
        """Write the map, with its descriptor and the filter's settings, into a folder; without pickles.

        Raises:
            UserError: it is a file, or cannot be created; or a fact is not a plain value.
            OSError: the disk is full.
        """
        save_localizer(self, make_folder("folder", folder))

    @classmethod
    def load(
        cls,
        folder: Path | str,
        *,
        outputs: Path | str | None = None,
        descriptor: Describes | None = None,
        motion: MotionModel | None = None,
        recovery: Recovery | None = None,
        radius: float | None = None,
        particles: int | None = None,
        start: Start = "uniform",
        seed: int = 0,
        lag: int = 0,
        verify: bool = True,
        trust: bool = False,
    ) -> Self:
        """Open the map of a run, a saved map, or one that was built from a stream.

        A map built by :class:`~sextant.localization.tiled_map.TiledMapBuilder` has no filter settings: it gets the
        filter of :meth:`from_images`, and takes vectors unless a descriptor is given.

        Args:
            folder: an MLflow run id, a run directory or its name, or the folder of a map.
            outputs: folder of runs; the folder that runs are written to by default.
            descriptor: descriptor of images, for a map whose own could not be saved.
            motion, recovery, radius: replace those of the map.
            particles: number of particles; None for the number that the map was tested with.
            start, seed, lag: as for the class.
            verify: check the hashes of all files, which reads them once; their sizes are checked in any case.
            trust: build user-defined parts that the map or a network's config names.

        Raises:
            UserError: there is no map, or it is damaged.
        """
        check_parts(motion=motion, recovery=recovery)
        where = default_outputs() if outputs is None else Path(outputs).expanduser()
        parts = open_localizer(
            folder, where, descriptor=descriptor, motion=motion, recovery=recovery, verify=verify, trust=trust
        )
        given = {"radius": radius, "particles": particles}
        parts |= {name: value for name, value in given.items() if value is not None}
        return cls(**parts, start=start, seed=seed, lag=lag)

    @classmethod
    def from_images(
        cls,
        images: UInt8[ndarray, "n h w c"] | Sequence[AnyImage],
        poses: Float[ndarray, "n 3"] | Sequence[Sequence[float]],
        descriptor: Describes | str | Path | None = None,
        *,
        kernel: PoseKernel | None = None,
        observation: ObservationModel | None = None,
        likelihood: Likelihood | None = None,
        motion: MotionModel | None = None,
        recovery: Recovery | None = None,
        radius: float | None = None,
        steps: int = 60,
        merge_duplicates: bool = False,
        particles: int | None = None,
        start: Start = "uniform",
        seed: int = 0,
        lag: int = 0,
    ) -> Self:
        """Build a map from images at known poses.

        Args:
            images: bytes; or files, arrays or pictures, stretched to the size of the first.
            poses: x, y in metres and heading in rad, counter-clockwise.
            descriptor: a descriptor of :mod:`sextant.baselines` or its name, a place-recognition run, or any object
                with ``describe``. By default ``zoo:places`` for colour images of at least 48 pixels a side, otherwise
                whitened principal components of 32x48 pixels.
            kernel: by default fitted, by the joint likelihood of at most 600 of the images, and sharpened.
            observation: observation model to fit; by default the cached local Gaussian process.
            likelihood: by default, the change of appearance and the weight of images are learned while driving.
            motion, recovery: parts of the filter; by default odometry with an error of three tenths of the map's
                spacing over that distance, and restarts.
            radius: radius of the mode that is reported, in metres; by default 2.5 times the spacing of the map.
            steps: gradient steps of the fit of the kernel.
            merge_duplicates: merge images at one pose into one.
            particles: number of particles; by default one for every two images, at least 2,000 and at most 10,000.
            start, seed, lag: as for the class.

        Raises:
            UserError: the images and poses do not make a map.
        """
        check_whole("steps", steps, 0, "steps=60")
        check_settings(1.0 if radius is None else radius, 1 if particles is None else particles, start, lag)
        check_parts(kernel=kernel, observation=observation, likelihood=likelihood, motion=motion, recovery=recovery)
        check_descriptor(descriptor)
        images = several_pixels(images)
        where = checked_poses(poses, len(images))
        kept, rows = described_map(images, descriptor)
        found = DescriptorMap.of(where, torch.from_numpy(rows), merge_duplicates=merge_duplicates)
        if observation is None:
            from sextant.localization.observation.cached_local_gp import CachedLocalGP

            observation = CachedLocalGP(min(16, len(found)), map_evidence="mean")
        learnt = kernel or fitted_kernel(found, steps)
        model = observation.fit(found, kernel or learnt.sharpened(SHARPER, NOISE))
        filter = usual_filter(found.poses, learnt, motion=motion, recovery=recovery)
        return cls(
            model,
            likelihood or Likelihood(tempering=TEMPERING),
            filter,
            radius=usual_radius(filter.prior.poses) if radius is None else radius,
            adapts=likelihood is None,
            odds=ODDS if likelihood is None else None,
            descriptor=kept,
            image_size=images.shape[1:],
            pictures=map_pictures(images) if len(found) == len(images) else None,  # otherwise some images were merged
            particles=usual_particles(len(found)) if particles is None else particles,
            start=start,
            seed=seed,
            lag=lag,
        )


def _repeats(before: Localized | None, now: Localized) -> bool:
    """Whether the image of a step repeats the last that counted."""
    if before is None:
        return False
    assert before.learned is not None
    assert now.learned is not None
    return torch.equal(before.learned.counted, now.learned.counted)
