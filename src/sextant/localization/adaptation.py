"""What a filter learns along a drive, and how it judges itself, for many runs at once.

A likelihood that was not fitted to another drive fits poorly, and odometry may be wrong or missing. So each step

1. corrects odometry by the learned :mod:`~sextant.localization.odometry_scale`, and treats it as unknown where
   :mod:`~sextant.localization.odometry_check` contradicts it;
2. weighs an image by how new it is, removes the :mod:`~sextant.localization.appearance_change` and tempers its
   likelihood by its :mod:`~sextant.localization.evidence_scale`;
3. compares it with what the belief predicted (:mod:`~sextant.localization.innovation_test`), or without odometry with
   the map (:mod:`~sextant.localization.recognition`);
4. continues unknown motion at the pace of the drive (:mod:`~sextant.localization.constant_velocity`), unless an image
   repeats the last.

Only the third applies to a filter that does not learn. The state of all r runs is in :class:`Learned`.
"""

import math
from dataclasses import KW_ONLY, dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.evaluation.protocols import MODE_MASS
from sextant.geometry.planar import se2_compose
from sextant.localization.appearance_change import AppearanceChange
from sextant.localization.belief import Belief, picked
from sextant.localization.constant_velocity import ConstantVelocity
from sextant.localization.constants import ALIKE, FEW, ONE_IN, RECOGNISED
from sextant.localization.estimate import Estimate
from sextant.localization.evidence_scale import EvidenceScale, ScaledEvidence
from sextant.localization.innovation_test import InnovationTest, drawn_evenly, foreseen
from sextant.localization.likelihood import Likelihood
from sextant.localization.map_support import MapSupport, images_near, map_spacing
from sextant.localization.motion import MotionModel, PacedMotion
from sextant.localization.observation.evidence import Evidence, EvidenceOfSome
from sextant.localization.observation.model import ObservationModel
from sextant.localization.observation.neighbourhoods import Neighbourhoods
from sextant.localization.odometry_check import OdometryCheck
from sextant.localization.odometry_scale import OdometryScale
from sextant.localization.particle_filter import way_moved
from sextant.localization.recognition import MapRecognition

#: number of evenly spaced images of a map whose descriptors are compared with each other
COMPARED = 600

State = TypeVar("State")


@dataclass(frozen=True)
class Place:
    """Where a belief says that each run is: the pose of the heaviest mode, its mass, and the share off the map."""

    pose: Float64[Tensor, "r 3"]
    mass: Float64[Tensor, " r"]
    off_map: Float64[Tensor, " r"]


@dataclass(frozen=True)
class Learned:
    """The state of r runs.

    Attributes:
        counted: descriptor of the last image that was new enough.
        way: distance since then, in steps between neighbouring images of the map.
        change: change of appearance, to which the likelihood is adapted.
        scale: scale of the evidence; None if it is that of the likelihood.
        innovation: whether images matched the places predicted.
        recognition: how well images without odometry were recognised.
        drive: change of appearance in these images.
        odometry: scale of odometry.
        standstill: images taken while odometry reports no motion.
        velocity: displacements between images.
        last: the place after the last step.
        sighted: the place after the last image.
        steps: number of steps since then in which the robot may have moved.
        still: probability that it has not moved in the last step, where its motion is unknown and its image repeats the
            last that counted.
        recognised: mean recognition of recent images; nan where the motion is known.
        disbelieved: whether images contradicted the odometry of the last step.
    """

    counted: Float32[Tensor, "r d"]
    way: Float64[Tensor, " r"]
    change: AppearanceChange
    scale: EvidenceScale | None
    innovation: InnovationTest
    recognition: InnovationTest
    drive: AppearanceChange
    odometry: OdometryScale
    standstill: OdometryCheck
    velocity: ConstantVelocity
    last: Place
    sighted: Place
    steps: Float64[Tensor, " r"]
    still: Float64[Tensor, " r"]
    recognised: Float64[Tensor, " r"]
    disbelieved: Bool[Tensor, " r"]

    @property
    def unrecognised(self) -> Bool[Tensor, " r"]:
        """Whether images without odometry resemble the map too little; the first four of a drive must beat chance."""
        few = torch.maximum(self.change.images, self.drive.images) < FEW
        return self.recognised < torch.full_like(self.recognised, RECOGNISED).masked_fill(few, 0.5)


@dataclass(frozen=True, eq=False)
class Adaptation:
    """The rules by which :class:`Learned` changes from step to step. They hold no state themselves.

    Args:
        model: observation model of the map.
        likelihood: its calibrated likelihood.
        learns: adapt to the drive; otherwise only judge the belief.
        odds: scale of one image's evidence, as for :class:`~sextant.localization.evidence_scale.EvidenceScale`; None
            keeps that of the likelihood.
    """

    model: ObservationModel
    likelihood: Likelihood
    _: KW_ONLY
    learns: bool = True
    odds: float | None = None

    def start(self, runs: int) -> Learned:
        """The state before the first step."""
        found, device = self.model.map, self.model.map.poses.device
        nothing = torch.zeros(runs, 5, dtype=torch.float64, device=device)
        nowhere = Place(nothing[:, :3], nothing[:, 3], nothing[:, 4])  # without mass: nothing is learned from it
        return Learned(
            counted=torch.zeros(runs, found.dimension, dtype=torch.float32, device=device),
            way=torch.full((runs,), math.inf, dtype=torch.float64, device=device),
            change=AppearanceChange.none(runs, found.dimension, device),
            scale=None if self.odds is None else EvidenceScale.none(runs, self.odds, device),
            innovation=InnovationTest.none(runs, device=device),
            # counts one image of no evidence, so that the first alone does not decide
            recognition=InnovationTest.none(runs, images=1.0, device=device),
            drive=AppearanceChange.none(runs, found.dimension, device),
            odometry=OdometryScale.none(runs, device),
            standstill=OdometryCheck.none(runs, found.dimension, device),
            velocity=ConstantVelocity.none(runs, device),
            last=nowhere,
            sighted=nowhere,
            steps=torch.zeros(runs, dtype=torch.float64, device=device),
            still=torch.zeros(runs, dtype=torch.float64, device=device),
            recognised=torch.full((runs,), torch.nan, dtype=torch.float64, device=device),
            disbelieved=torch.zeros(runs, dtype=torch.bool, device=device),
        )

    def believed(
        self,
        learned: Learned,
        motion: Float64[Tensor, "r 3"],
        images: Float32[Tensor, "r d"],
        seen: Bool[Tensor, " r"],
    ) -> tuple[Learned, Float64[Tensor, "r 3"]]:
        """The motion by which particles move, unknown (nan) where images contradict what odometry reports.

        Args:
            learned: the state.
            motion: what odometry reports; nan where it is missing.
            images: descriptors.
            seen: in which runs there is an image.
        """
        moved = learned.odometry.applied(motion)
        if not self.learns:
            return learned, moved
        standstill = learned.standstill.moved(moved, self.spacing).updated(images, seen)
        contradicted = standstill.contradicted(self._anywhere)
        moved = moved.masked_fill(contradicted[:, None], torch.nan)
        return replace(learned, standstill=standstill, disbelieved=contradicted), moved

    def observed(
        self,
        learned: Learned,
        moved: Float64[Tensor, "r 3"],
        images: Float32[Tensor, "r d"],
        looked: Bool[Tensor, " r"],
        belief: Belief | None,
        support: MapSupport | None,
    ) -> tuple[Learned, Evidence | None, Bool[Tensor, " r"]]:
        """The state with what images show; the evidence of those that count, None without one; and in which runs.

        Args:
            learned: the state.
            moved: the motion since the previous step, as by :meth:`believed`.
            images: descriptors.
            looked: in which runs there is an image that the filter may use.
            belief: the belief before the motion; None in the first step.
            support: where the map is informative.
        """
        known = moved.isfinite().all(1)
        unseen = torch.where(looked, 0.0, math.inf).to(learned.way)  # a motion that neither odometry nor an image shows
        way = learned.way + self._steps_of_map(moved, support).where(known, unseen)
        new = self._newness(images, learned.counted, way, known).where(looked, 0.0)
        counts = new >= ALIKE
        counted = torch.where(counts[:, None], images, learned.counted)
        still = torch.full_like(way, self._still).where(looked & ~known & ~counts, 0.0)
        learned = replace(learned, counted=counted, way=way.masked_fill(counts, 0.0), still=still)
        used, found = looked & counts if self.learns else looked, None
        if bool(used.any()):
            learned, found = self._weighed(learned, images, new, used, known & way.isfinite())
            if belief is not None:
                learned = self._compared(learned, belief, moved, found, new, used, support)
        learned = self._recognised(learned, images, new.where(counts, 0.0), ~known)
        recognised = learned.recognition.mean.where(~known & (learned.drive.images > 0), torch.nan)
        evidence = found if found is None or bool(used.all()) else EvidenceOfSome(found, used)
        return replace(learned, recognised=recognised), evidence, used

    def motion(self, learned: Learned, measured: MotionModel) -> MotionModel:
        """The filter's motion model; without odometry most particles keep the pace of the drive."""
        if not self.learns:
            return measured
        pace = learned.velocity
        return PacedMotion(measured, pace.along(self.spacing), pace.departure(self.spacing), learned.still)

    def after(
        self,
        learned: Learned,
        moved: Float64[Tensor, "r 3"],
        found: Estimate,
        off_map: Float64[Tensor, " r"],
        weighed: Bool[Tensor, " r"],
    ) -> Learned:
        """The state after a step of the filter.

        Args:
            learned: the state before it.
            moved: the motion, as by :meth:`believed`.
            found: the estimate.
            off_map: probability of being off the map.
            weighed: in which runs an image weighted the particles.
        """
        now, last, sighted = Place(found.pose, found.mass, off_map), learned.last, learned.sighted
        if not self.learns:
            return replace(learned, last=now)
        sure, steps = torch.minimum(last.mass, now.mass) >= MODE_MASS, learned.steps + 1 - learned.still
        odometry = learned.odometry.updated(moved, last.pose, now.pose, self.spacing)
        # in between images, the belief follows the motion model, so that the pace is that from image to image
        weight = (sighted.mass * now.mass * (1 - off_map)).where(weighed, 0.0)
        return replace(
            learned,
            odometry=chosen(sure, odometry, learned.odometry),
            velocity=learned.velocity.updated(sighted.pose, now.pose, weight, steps),
            last=now,
            sighted=chosen(weighed, now, sighted),
            steps=steps.masked_fill(weighed, 0.0),
        )

    def _weighed(
        self, learned: Learned, images: Tensor, new: Tensor, used: Tensor, follows: Tensor
    ) -> tuple[Learned, ScaledEvidence]:
        """The evidence of the runs in ``used``, weighted by how new their images are if the filter learns.

        Errors of consecutive images add up in particles that follow odometry. Where motion is unknown, particles spread
        between images, less adds up, and evidence tempered as much would not concentrate them again: it is tempered by
        the root of the scale. Nothing adds up in the first image.
        """
        images, new, mean = images[used], new[used], self.model.map.mean
        if not self.learns:
            evidence = self.model.observe(images, self.likelihood)
            return learned, ScaledEvidence(evidence, evidence.over_map(), torch.ones_like(new))
        before = some_of(learned.change, used)
        change = before.updated(images, new)
        residuals = self.model.residuals_over_map(change.centred(images, mean))
        finite = residuals.squared.isfinite().all(1)  # nothing can be learned from values that overflow
        change = chosen(finite, change.exceeded(residuals, self.model.map.dimension, new), before)
        evidence = self.model.observe(change.centred(images, mean), change.likelihood(self.likelihood))
        over_map = evidence.over_map()
        learned = replace(learned, change=with_some(learned.change, used, change))
        tempering = torch.ones_like(new)
        if learned.scale is not None:
            scale = some_of(learned.scale, used).updated(over_map, new)
            learned, tempering = replace(learned, scale=with_some(learned.scale, used, scale)), scale.tempering
        tempering = torch.where(follows[used], tempering, tempering.sqrt()).where(before.images > 0, 1.0)
        return learned, ScaledEvidence(evidence, over_map, tempering * new)

    def _compared(
        self,
        learned: Learned,
        belief: Belief,
        moved: Tensor,
        evidence: Evidence,
        new: Tensor,
        used: Tensor,
        support: MapSupport | None,
    ) -> Learned:
        """The innovation test, with how well beliefs before their images predicted them, where motion is known."""
        asked = used & moved.isfinite().all(1)
        if not bool(asked.any()):
            return learned
        rows = drawn_evenly(belief.weights[asked])
        poses = se2_compose(picked(belief.poses[asked], rows), moved[asked, None])
        on_map = 1.0 if support is None else support.share(poses).mean(1)
        near = self.near.nearest(poses.reshape(-1, 3)).view(rows.shape)
        innovation = some_of(learned.innovation, asked)
        innovation = innovation.updated(foreseen(evidence.over_map()[asked[used]], near), new[asked] * on_map)
        return replace(learned, innovation=with_some(learned.innovation, asked, innovation))

    def _recognised(self, learned: Learned, images: Tensor, new: Tensor, unknown: Tensor) -> Learned:
        """The recognition of recent images, including these, in runs without odometry."""
        asked = unknown & (new > 0)
        if not bool(asked.any()) or self.recognition is None:
            return learned
        images, new = images[asked], new[asked]
        drive = some_of(learned.drive, asked).updated(images, new)
        share = self.recognition.share(images, drive.centred(images, self.model.map.mean))
        found = some_of(learned.recognition, asked).updated(share, new)
        return replace(
            learned,
            drive=with_some(learned.drive, asked, drive),
            recognition=with_some(learned.recognition, asked, found),
        )

    def _newness(self, images: Tensor, counted: Tensor, way: Tensor, known: Tensor) -> Float64[Tensor, " r"]:
        """How new images are relative to the last that counted, in [0, 1], by the distance since or the change in them.

        Both are in units of the step between neighbouring map images. At a standstill every image repeats the same
        error, which must not accumulate; after a kidnapping only the image changes. Where motion is unknown, an image
        that counts does so in full.
        """
        changed = (images - counted).double().square().sum(1)
        changed = changed / self._beside if self._beside > 0 else (~known).to(way)
        new = torch.where(way.isfinite(), torch.maximum(way, changed), 1.0).clamp(max=1.0)
        return new.where(known | (new < ALIKE), 1.0)

    def _steps_of_map(self, moved: Tensor, support: MapSupport | None) -> Float64[Tensor, " r"]:
        """The motion in steps between neighbouring map images; infinite if it is unknown."""
        if support is None:
            return torch.full_like(moved[:, 0], math.inf)
        return way_moved(moved, self.spacing, 2 * support.heading_reach)

    # -- the map -------------------------------------------------------------------------------------------------------

    @cached_property
    def spacing(self) -> float:
        """The spacing of the map."""
        return map_spacing(self.model.map.poses)

    @cached_property
    def near(self) -> Neighbourhoods:
        """Search for the images nearest to a pose."""
        return images_near(self.model.map.poses)

    @cached_property
    def recognition(self) -> MapRecognition | None:
        """What images of unknown places look like in the map; None if its images are of too few places."""
        return MapRecognition.of(self.model.map)

    @cached_property
    def _beside(self) -> float:
        """The median squared distance between descriptors of neighbouring images of the map."""
        return float(self._pairs(*self._neighbours).median())

    @cached_property
    def _neighbours(self) -> tuple[np.ndarray, np.ndarray]:
        features, rows = self.near.features, self._rows
        return rows, cKDTree(features).query(features[rows], k=min(2, len(features)))[1].reshape(len(rows), -1)[:, -1]

    @cached_property
    def _still(self) -> float:
        """The probability of a standstill where an image repeats the last, by how many neighbours repeat in the map."""
        beside = self._pairs(*self._neighbours)
        repeats = (1 + float((beside < ALIKE * self._beside).sum())) / (1 + len(beside))
        return 1 / (1 + (ONE_IN - 1) * repeats)

    @cached_property
    def _anywhere(self) -> float:
        """The median squared distance between descriptors of any two images of the map."""
        return float(self._pairs(self._rows, np.roll(self._rows, len(self._rows) // 2)).median())

    @property
    def _rows(self) -> np.ndarray:
        images = len(self.model.map)
        return np.unique(np.linspace(0, images - 1, min(COMPARED, images)).astype(np.int64))

    def _pairs(self, rows: np.ndarray, others: np.ndarray) -> Tensor:
        descriptors = self.model.map.descriptors
        apart = descriptors[torch.from_numpy(rows)] - descriptors[torch.from_numpy(others)]
        return apart.double().square().sum(1)


def some_of(state: State, runs: Bool[Tensor, " r"]) -> State:
    """The state of some runs.

    >>> some_of(OdometryScale.none(3), torch.tensor([True, False, True])).factor
    tensor([1., 1.], dtype=torch.float64)
    """
    return replace(state, **{name: value[runs] for name, value in _tensors(state)})  # type: ignore[type-var]


def with_some(state: State, runs: Bool[Tensor, " r"], some: State) -> State:
    """The state with that of some runs replaced.

    >>> two = OdometryScale(torch.tensor([2.0, 3.0]).double())
    >>> with_some(OdometryScale.none(3), torch.tensor([True, False, True]), two).factor
    tensor([2., 1., 3.], dtype=torch.float64)
    """
    return replace(  # type: ignore[type-var]
        state, **{name: value.index_put((runs,), getattr(some, name)) for name, value in _tensors(state)}
    )


def chosen(runs: Bool[Tensor, " r"], new: State, old: State) -> State:
    """The new state in some runs, and the old one in the others.

    >>> two = OdometryScale(torch.tensor([2.0, 3.0]).double())
    >>> chosen(torch.tensor([True, False]), two, OdometryScale.none(2)).factor
    tensor([2., 1.], dtype=torch.float64)
    """
    return replace(  # type: ignore[type-var]
        old,
        **{
            name: torch.where(runs.view(-1, *[1] * (value.ndim - 1)), getattr(new, name), value)
            for name, value in _tensors(old)
        },
    )


def _tensors(state: Any) -> list[tuple[str, Tensor]]:
    values = ((each.name, getattr(state, each.name)) for each in fields(state))
    return [(name, value) for name, value in values if isinstance(value, Tensor)]
