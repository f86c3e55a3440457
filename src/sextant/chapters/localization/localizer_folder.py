"""Saving a localizer to a folder and opening it; and describing the images that a map is made of."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, UInt8
from numpy import ndarray
from torch import Tensor

from sextant.array_folder import plain_values
from sextant.baselines import PlaceDescriptor, WhitenedPCA
from sextant.chapters.localization.found_map import MAP, find_map
from sextant.chapters.localization.map_pictures import load_pictures, save_pictures
from sextant.chapters.localization.saved_filter import filter_of, filter_values, usual_filter, usual_radius
from sextant.chapters.places.saved_descriptor import (
    Describes,
    SavedDescriptor,
    baseline_names,
    find_baseline,
    kept_baseline,
    kept_network,
    load_descriptor,
)
from sextant.data.positions import FURTHEST
from sextant.errors import ArgumentError, UserError
from sextant.localization.constants import ODDS
from sextant.localization.likelihood import Likelihood
from sextant.localization.map_prior import LEAST_SPACING
from sextant.localization.motion import MotionModel
from sextant.localization.observation import ObservationModel
from sextant.localization.particle_filter import ParticleFilter
from sextant.localization.recovery import Recovery
from sextant.localization.saved_map import HEADER, SavedMap, load_map, save_map
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run
from sextant.tables import counted

DESCRIPTOR, PICTURES = "descriptor", "pictures"
#: images described at a time, by a baseline and by a network
BATCH, NETWORK_BATCH = 512, 64
#: the default descriptor, and the smallest shorter side of its images in pixels
USUAL, ENOUGH = "zoo:places", 48


class Saveable(Protocol):
    """The parts of a :class:`sextant.Localizer` that are saved."""

    model: ObservationModel
    likelihood: Likelihood
    filter: ParticleFilter
    radius: float
    unit: Literal["m", "frames"]
    particles: int
    adapts: bool
    odds: float | None
    region_scale: float
    image_size: tuple[int, int, int] | None
    descriptor: SavedDescriptor
    facts: dict[str, Any]
    pictures: UInt8[ndarray, "n h w c"] | None


def save_localizer(localizer: Saveable, folder: Path) -> None:
    """Write the descriptor, the pictures and then the map, whose header comes last of all.

    Raises:
        ArgumentError: JSON cannot hold one of the localizer's facts; then nothing is written.
    """
    about = plain_values(localizer.facts)
    (folder / HEADER).unlink(missing_ok=True)
    localizer.descriptor.save(folder / DESCRIPTOR)
    save_pictures(localizer.pictures, folder / PICTURES)
    settings = {
        "filter": filter_values(localizer.filter),
        "radius": localizer.radius,
        "unit": localizer.unit,
        "particles": localizer.particles,
        "adapts": localizer.adapts,
        "odds": localizer.odds,
        "region_scale": localizer.region_scale,
        "image_size": localizer.image_size,
        "descriptor": localizer.descriptor.identity,
    }
    save_map(folder, localizer.model, localizer.likelihood, {"localizer": settings, "about": about})


def map_folder(folder: Path) -> Path:
    """The folder itself, or the folder of the map within it."""
    return folder / MAP if not (folder / HEADER).is_file() and (folder / MAP / HEADER).is_file() else folder


def open_localizer(
    folder: Path | str,
    outputs: Path,
    *,
    descriptor: Describes | None = None,
    motion: MotionModel | None = None,
    recovery: Recovery | None = None,
    verify: bool = True,
    trust: bool = False,
) -> dict[str, Any]:
    """The arguments of the saved ``Localizer``; see :meth:`sextant.Localizer.load`."""
    folder = find_map(str(folder), outputs) or map_folder(Path(str(folder)).expanduser())
    saved = load_map(folder, verify=verify, trust=trust)
    settings = saved.facts.get("localizer")
    if settings is None:
        return _without_settings(saved, descriptor, motion, recovery)
    if not isinstance(settings, dict):
        raise UserError(f"the map in {folder} is damaged: it has no valid filter settings", "Save it again.")
    kept = load_descriptor(folder / DESCRIPTOR, trust=trust)
    if kept.identity != settings.get("descriptor"):
        raise UserError(
            f"{folder / DESCRIPTOR} is not the descriptor that the map was made with",
            "Copy the whole folder of the map, or save it again.",
        )
    if descriptor is not None:
        if kept.describer is not None:
            raise UserError(
                f"the map in {folder} has its own descriptor ({kept.facts['kind']}), but another one is given",
                "Leave out descriptor=, or make a map with it: Localizer.from_images",
            )
        kept = replace(kept, describer=descriptor)
    try:
        size = settings["image_size"]
        return {
            "model": saved.model,
            "likelihood": saved.likelihood,
            "filter": filter_of(settings["filter"], saved.model.map.poses, motion=motion, recovery=recovery),
            "radius": float(settings["radius"]),
            "descriptor": kept,
            "image_size": None if size is None else tuple(int(side) for side in size),
            "unit": settings["unit"],
            "particles": int(settings["particles"]),
            "adapts": settings.get("adapts", False) is True,  # older maps do not
            "odds": None if settings.get("odds") is None else float(settings["odds"]),
            "region_scale": float(settings.get("region_scale", 1.0)),
            "facts": saved.facts.get("about", {}),
            "pictures": load_pictures(folder / PICTURES, len(saved.model.map), verify=verify),
        }
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(
            f"the map in {folder} is damaged: its filter settings cannot be used: {error!r}", "Save it again."
        ) from error


def _without_settings(
    saved: SavedMap,
    descriptor: Describes | None,
    motion: MotionModel | None,
    recovery: Recovery | None,
) -> dict[str, Any]:
    """The arguments of a localizer for a map that no localizer saved."""
    filter = usual_filter(saved.model.map.poses, saved.model.kernel, motion=motion, recovery=recovery)
    return {
        "model": saved.model,
        "likelihood": saved.likelihood,
        "filter": filter,
        "radius": usual_radius(filter.prior.poses),
        "adapts": (adapts := saved.likelihood.appearance_variance == 0),  # it was not fitted
        "odds": ODDS if adapts else None,
        "descriptor": SavedDescriptor(descriptor),
        "facts": saved.facts,
    }


def checked_poses(poses: Float[ndarray, "n 3"] | Sequence[Sequence[float]], images: int) -> Float64[Tensor, "n 3"]:
    """Check the poses of the images of a map.

    Raises:
        UserError: there is not one pose per image, there is only one image, headings look like degrees, or positions
            are too far from or too close to each other to be metres.
    """
    try:
        where = np.array(poses, np.float64)
    except (ValueError, TypeError):
        where = np.empty(0)
    if where.shape != (images, 3):
        raise UserError(
            f"poses have shape {where.shape} for {counted(images, 'image')}", "Give x, y and heading of each image."
        )
    if images < 2:
        raise UserError("the map has only one image, but at least two are needed", "Add images.")
    if (turned := np.abs(where[:, 2])).max() > 4 * np.pi:
        raise UserError(
            f"the heading {where[turned.argmax(), 2]:g} of image {turned.argmax()} exceeds two full turns",
            "Poses are x, y and the heading in rad: numpy.radians of degrees.",
        )
    if (furthest := np.abs(where[:, :2]).max()) > FURTHEST:
        raise UserError(f"poses: a position of {furthest:g} m is further than {FURTHEST:g}", "Give x and y in metres.")
    if 0 < (extent := np.ptp(where[:, :2], 0).max()) < LEAST_SPACING:
        raise UserError(
            f"poses: all positions lie within {extent:g} m, less than {LEAST_SPACING:g}", "Give x and y in metres."
        )
    return torch.from_numpy(where)


def check_descriptor(descriptor: Describes | str | Path | None) -> None:
    """Check that a descriptor given by name exists, before any long work.

    Raises:
        UserError: it is neither one of :mod:`sextant.baselines` nor a place-recognition run.
    """
    if not isinstance(descriptor, str | Path) or find_baseline(str(descriptor)) is not None:
        return
    try:
        checkpoint = resolve_run(str(descriptor), default_outputs()).checkpoint
    except UserError as error:
        raise ArgumentError(
            f"descriptor={descriptor} is neither one of {baseline_names()} nor a run: {error.problem}", "descriptor=Hog"
        ) from None
    kept_network(checkpoint)


def described_map(
    images: UInt8[ndarray, "n h w c"], descriptor: Describes | str | Path | None
) -> tuple[SavedDescriptor, Float32[ndarray, "n d"]]:
    """Describe the images of a map; returns the descriptor too, fitted to them if it learns.

    Args:
        images: images of one size.
        descriptor: by default the place-recognition network of the package for colour images that are large enough,
            otherwise whitened principal components.

    Raises:
        UserError: they are not images, are all the same picture, or are too few for the descriptor.
    """
    if images.shape[3] not in (1, 3):
        raise UserError(
            f"images are {images.dtype} {images.shape}; they must be uint8, n x height x width x 1 or 3",
            "For example numpy.stack of photos of one size.",
        )
    if len(images) > 1 and all(np.array_equal(images[0], image) for image in images[1:]):
        raise UserError(
            f"the map's {len(images)} images are all the same picture, so its places cannot be distinguished",
            "Check the images of the map.",
        )
    if isinstance(descriptor, str) and (kind := find_baseline(descriptor)) is not None:
        descriptor = kind()
    if descriptor is None and images.shape[3] == 3 and min(images.shape[1:3]) >= ENOUGH:
        descriptor = USUAL
    if isinstance(descriptor, str | Path):
        kept, size = kept_network(resolve_run(str(descriptor), default_outputs()).checkpoint), NETWORK_BATCH
    else:
        chosen = WhitenedPCA(32, 48, min(128, len(images) // 2)) if descriptor is None else descriptor
        if not hasattr(chosen, "describe"):
            raise ArgumentError(
                f"descriptor={type(chosen).__name__} cannot describe images",
                f"A run, one of {baseline_names()}, or an object with describe(images).",
            )
        try:
            if isinstance(chosen, PlaceDescriptor):
                chosen.fit(images)
        except ValueError as error:
            raise UserError(f"descriptor: {error}", "Fewer dimensions, or a larger map.") from None
        kept, size = kept_baseline(chosen), BATCH
    assert kept.describer is not None
    parts = [kept.describer.describe(images[start : start + size]) for start in range(0, len(images), size)]
    return kept, np.ascontiguousarray(np.concatenate(parts), np.float32)
