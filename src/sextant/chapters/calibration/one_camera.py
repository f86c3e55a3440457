"""Fusing the estimates of several photos of one camera and lens setting."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from sextant.applications.failures import FailedPhoto
from sextant.baselines.calibration import FocalBelief
from sextant.chapters.calibration.finding import Finding
from sextant.chapters.calibration.fusing import adopt, estimate, shared
from sextant.chapters.calibration.jointly import jointly
from sextant.chapters.calibration.matched_focal import MatchedFocal, PhotoMatches
from sextant.chapters.calibration.metrics.fusion import CORRELATION, Fusion, Prior, fuse, with_prior
from sextant.chapters.calibration.photo_camera import PhotoCamera
from sextant.chapters.calibration.priors import NONE_IN_EXIF, PRIOR_DISAGREES, FocalPrior, disagreement, prior_of
from sextant.data.metadata import EXIF_BLOCK, as_text, directory, exif_of, tag_of
from sextant.data.photos.header import MAKE, MODEL
from sextant.data.picture_files import open_picture
from sextant.errors import UserError
from sextant.tables import counted

SAME_SHAPE = 0.02  # largest relative difference of aspect among photos of one camera
SAME_FOCAL = 1.05  # largest ratio of their focal lengths by EXIF, in longer sides
SERIAL, LENS = 0xA431, 0xA434  # tags of EXIF


@dataclass(frozen=True, eq=False)
class OneCamera:
    """One camera and lens setting, estimated from several of its photos.

    Attributes:
        photos: each photo with the fused camera, or why it failed; in the given order.
        fusion: fusion of the log of the focal length and of k1 / f², f in longer sides of a photo; it states which
            photos were kept and whether they agree.
        doubts: reasons against the result.
        matches: what the photos' matches say about the focal length, in words.
    """

    photos: tuple[PhotoCamera | FailedPhoto, ...]
    fusion: Fusion
    doubts: tuple[str, ...]
    matches: str = ""

    @property
    def cameras(self) -> tuple[PhotoCamera, ...]:
        """The cameras of the photos that did not fail."""
        return tuple(photo for photo in self.photos if isinstance(photo, PhotoCamera))

    @property
    def focal_of_longer_side(self) -> float:
        """Focal length over the longer side of a photo; multiply by that side in pixels to get pixels."""
        return math.exp(self.fusion.values[0])

    def row(self) -> dict[str, Any]:
        """The fusion as plain values."""
        kept = [(camera.name, bool(kept)) for camera, kept in zip(self.cameras, self.fusion.kept, strict=True)]
        return {
            "photos": len(kept),
            "kept": [name for name, used in kept if used],
            "left_out": [name for name, used in kept if not used],
            "focal_of_longer_side": self.focal_of_longer_side,
            "focal_log_sigma": float(self.fusion.sigmas[0]),
            "k1_hat_of_longer_side": float(self.fusion.values[1]),
            "k1_hat_sigma": float(self.fusion.sigmas[1]),
            "chi_square": self.fusion.chi_square,
            "degrees_of_freedom": self.fusion.degrees,
            "p_value": self.fusion.p_value,
            "consistent": self.fusion.consistent,
            "prior_z": self.fusion.prior_z,
            "doubts": list(self.doubts),
            "matches": self.matches,
        }


def fuse_as_one_camera(
    findings: Sequence[Finding], focal_prior: FocalPrior, matches: PhotoMatches | None = None
) -> tuple[list[Finding], Fusion, tuple[str, ...], str]:
    """The findings with the focal length and distortion fused where they agree; the fusion, doubts about it, and what
    matches tell.

    Copies of one photo count once. The focal length by matches is one more belief about each photo that is kept.

    Raises:
        UserError: the photos cannot be of one camera, or the network gives no intervals.
    """
    resized = _check_one_camera(findings, focal_prior)
    firsts = _firsts(findings)
    distinct = {i: findings[i] for i in firsts}
    values, sigmas = (np.stack(column) for column in zip(*map(estimate, distinct.values()), strict=True))
    if not np.isfinite(sigmas).any(0).all():
        raise UserError(
            "the network gives no intervals, without which photos of one camera cannot be fused",
            "Calibrate each photo by itself.",
        )
    correlation = max(CORRELATION, float(np.mean([shared(finding) for finding in distinct.values()])))
    fusion, matched = fuse(values, sigmas, correlation=correlation), MatchedFocal("")
    doubts: list[str] = []
    if matches is not None:
        matched = matches.focal([finding.name for finding in distinct.values()])
        fusion, doubts = _with_matches(fusion, [*distinct.values()], matched, correlation)
    fusion, others = _with_priors(fusion, [*distinct.values()], focal_prior)
    doubts += others
    if resized and not fusion.consistent:
        raise UserError(
            f"{resized}, and they disagree more than their intervals allow (p = {fusion.p_value:.2g}): they are from "
            "several cameras",
            "Calibrate the photos of each size separately, each in a folder of its own.",
        )
    if not fusion.consistent:
        doubts.append(
            f"the photos disagree more than their intervals allow (p = {fusion.p_value:.2g}): are they from one camera?"
        )
    basis = f"fused over {counted(int(fusion.kept.sum()), 'photo')}, normal"
    kept = dict(zip(distinct, fusion.kept, strict=True))
    fused = [
        adopt(finding, fusion, basis).doubted(1, *doubts)
        if kept[first]
        else finding.doubted(1, "left out of the fusion: it disagrees with the other photos")
        for finding, first in zip(findings, firsts, strict=True)
    ]
    for i, first in enumerate(firsts):
        if i != first:
            fused[i] = fused[i].doubted(0, f"a copy of {findings[first].name}: the two count as one photo")
    if focal_prior == "exif" and not any(finding.photo.exif_focal_px for finding in distinct.values()):
        doubts.append(NONE_IN_EXIF)
        fused = [finding.doubted(0, NONE_IN_EXIF) for finding in fused]
    if resized:
        doubts.append(f"{resized}: they are treated as resized photos of one camera")
        fused = [finding.doubted(0, doubts[-1]) for finding in fused]
    used = np.array([i == first and kept[first] for i, first in enumerate(firsts)])
    return fused, replace(fusion, kept=used), tuple(doubts), matched.summary


def _with_matches(
    fusion: Fusion, findings: Sequence[Finding], matched: MatchedFocal, correlation: float
) -> tuple[Fusion, list[str]]:
    """The fusion with the focal length by matches, and doubts about it; it is not used if the pictures contradict it.

    It is a belief about each photo, so that their distortion fits it. The interval of the focal length is that of the
    product, and the test of whether the photos agree that without it, since all photos share it.
    """
    if matched.zoomed:
        return fusion, [matched.summary]
    if not math.isfinite(matched.focal):
        return fusion, []
    prior = Prior(math.log(matched.focal), matched.sigma)
    known = with_prior(fusion, 0, prior)
    if abs(known.prior_z) > PRIOR_DISAGREES:
        z = abs(known.prior_z)
        return fusion, [f"{matched.summary}; the pictures disagree by {z:.1f} standard errors: it was not used"]
    if any(finding.network is None for finding in findings):
        return replace(known, prior_z=fusion.prior_z), []
    joint = []
    for finding, kept in zip(findings, fusion.kept, strict=True):
        if kept:
            focal = matched.focal * finding.side / finding.photo.height
            joint.append(jointly(finding, [FocalBelief(focal, matched.sigma)]))
    values, sigmas = (np.stack(column) for column in zip(*map(estimate, joint), strict=True))
    found = fuse(values, sigmas, correlation=correlation)
    return replace(fusion, values=found.values, sigmas=np.array([known.sigmas[0], found.sigmas[1]])), []


def _firsts(findings: Sequence[Finding]) -> list[int]:
    """For each photo, the number of the first photo with the same picture: its own, unless it is a copy."""
    numbers: dict[tuple[int, int, bytes], int] = {}
    pictures = ((each.photo.width, each.photo.height, each.view.image.tobytes()) for each in findings)
    return [numbers.setdefault(picture, i) for i, picture in enumerate(pictures)]


def _with_priors(fusion: Fusion, findings: Sequence[Finding], focal_prior: FocalPrior) -> tuple[Fusion, list[str]]:
    """The fusion with the median of the known focal lengths, and doubts about it."""
    priors = [prior for finding in findings if (prior := prior_of(finding, focal_prior))]
    doubts: list[str] = []
    if priors:
        means = np.array([prior.mean for prior in priors])
        if np.ptp(means) > 2 * priors[0].sigma:
            doubts.append("EXIF gives different focal lengths: each setting of a zoom lens is a different camera")
        known = with_prior(fusion, 0, Prior(float(np.median(means)), priors[0].sigma))
        against = disagreement(known.prior_z, focal_prior)
        if against and focal_prior == "exif":
            return fusion, [*doubts, f"{against[0]}: it was not used"]
        fusion, doubts = known, [*doubts, *against]
    return fusion, doubts


def _check_one_camera(findings: Sequence[Finding], focal_prior: FocalPrior) -> str:
    """Refuse photos that cannot be from one camera; return a note if they have several sizes, else an empty string."""
    shapes = {f.name: f.side / min(f.photo.width, f.photo.height) for f in findings}
    first, last = min(shapes, key=lambda p: shapes[p]), max(shapes, key=lambda p: shapes[p])
    if shapes[last] / shapes[first] - 1 > SAME_SHAPE:
        raise UserError(
            f"{first} and {last} have sides of 1:{shapes[first]:.3f} and 1:{shapes[last]:.3f}, so they are not from "
            "one camera, or one was cropped",
            "Remove it, or calibrate each photo by itself.",
        )
    sides = {finding.side for finding in findings}
    if isinstance(focal_prior, Real) and len(sides) > 1:
        raise UserError(
            f"focal_prior={focal_prior:g}: the photos have longer sides of {min(sides)} to {max(sides)} pixels, so "
            "their focal lengths in pixels differ",
            "Give photos of one size, or focal_prior=exif",
        )
    named: dict[str, str] = {}
    for finding in findings:
        if camera := _camera_of(finding.name):
            named.setdefault(camera, finding.name)
    if len(named) > 1:
        (one, first), (other, second) = list(named.items())[:2]
        raise UserError(
            f"according to EXIF, {first} was taken with {one} and {second} with {other}, so not with one camera",
            "Calibrate the photos of each camera separately, each in a folder of its own.",
        )
    sizes = {tuple(sorted((finding.photo.width, finding.photo.height))): finding for finding in findings}
    if len(sizes) == 1:
        return ""
    known = {f.name: f.photo.exif_focal_px / f.side for f in findings if f.photo.exif_focal_px}
    if known and max(known.values()) > SAME_FOCAL * min(known.values()):
        wide, long = min(known, key=lambda name: known[name]), max(known, key=lambda name: known[name])
        raise UserError(
            f"{wide} and {long} differ in size and, according to EXIF, have focal lengths of {known[wide]:.2f} and "
            f"{known[long]:.2f} longer sides, so they are not from one camera and lens setting",
            "Calibrate the photos of each size separately, each in a folder of its own.",
        )
    told = ", ".join(f"{long}x{short}" for short, long in sorted(sizes, reverse=True)[:4])
    return f"the photos are of {len(sizes)} sizes ({told})"


def _camera_of(name: str) -> str:
    """Make, model, serial number and lens from the EXIF of a file; "" if it names no model, or is no file."""
    try:
        with open_picture(Path(name)) as image:
            exif = exif_of(image)
    except Exception:  # decoders may raise anything on a damaged file; an array has no file
        return ""
    block = directory(exif, EXIF_BLOCK)
    tags = [tag_of(exif, MAKE), tag_of(exif, MODEL), block.get(SERIAL), block.get(LENS)]
    words = [" ".join(as_text(tag).split()) for tag in tags]
    return ", ".join(filter(None, words)) if words[1] else ""
