"""Images of the validation drives, on which the likelihood of a localizer is calibrated."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray
from scipy.spatial import cKDTree
from torch import Tensor

from sextant.chapters.localization.data.datamodule import LocalizationDataModule
from sextant.chapters.localization.data.drive import LocalizationData, ProtocolName
from sextant.errors import UserError
from sextant.evaluation.positives import Positives
from sextant.evaluation.protocols import (
    NORDLAND_LOCALIZATION,
    OFFICE_LOCALIZATION,
    TOWN_LOCALIZATION,
    LocalizationProtocol,
)
from sextant.localization.likelihood import Likelihood
from sextant.localization.observation import ObservationModel

PROTOCOLS: dict[ProtocolName, LocalizationProtocol] = {
    "office": OFFICE_LOCALIZATION,
    "town": TOWN_LOCALIZATION,
    "railway": NORDLAND_LOCALIZATION,
}
#: number of queries whose scores over a whole map are held at a time in float64
BATCH = 16


@dataclass(frozen=True, eq=False)
class Queries:
    """Images at known poses, none of them in the map."""

    poses: Float64[Tensor, "v 3"]
    descriptors: Float32[Tensor, "v d"]


def validation_rows(data: LocalizationDataModule, images: int) -> list[Int64[ndarray, "k"]]:
    """At most about ``images`` evenly spaced frames of the validation drives, by drive.

    Raises:
        UserError: there is no validation drive.
    """
    drives = data.drives.validation
    if not drives:
        raise UserError(
            "the dataset has no validation drive, on which the likelihood is fitted",
            "Give numbers: likelihood.tempering=0.25 likelihood.appearance_noise=0.0 likelihood.whitening=false",
        )
    share = -(-sum(len(drive) for drive in drives) // images)
    return [np.flatnonzero(drive.seen)[::share] for drive in drives]


def validation_queries(data: LocalizationDataModule, images: int) -> Queries:
    """The frames of :func:`validation_rows`."""
    drives, rows = data.drives.validation, validation_rows(data, images)
    poses = np.concatenate([drive.poses[row] for drive, row in zip(drives, rows, strict=True)])
    seen = np.concatenate([data.descriptors(drive)[row] for drive, row in zip(drives, rows, strict=True)])
    return Queries(torch.from_numpy(poses), torch.from_numpy(np.asarray(seen, np.float32)))


def same_place(
    poses: Float64[Tensor, "v 3"], references: Float64[Tensor, "n 3"], protocol: LocalizationProtocol
) -> Positives:
    """The map images within the protocol's limits of each pose.

    Raises:
        UserError: no pose has such an image.
    """
    tree, wanted = cKDTree(references[:, :2].numpy()), poses.numpy()
    headings = references[:, 2].numpy()
    near = tree.query_ball_point(wanted[:, :2], protocol.position)
    lists = []
    for heading, rows in zip(wanted[:, 2], near, strict=True):
        turned = np.abs((headings[rows] - heading + np.pi) % (2 * np.pi) - np.pi)
        limit = np.inf if protocol.heading_deg is None else np.radians(protocol.heading_deg)
        lists.append(np.asarray(rows, np.int64)[turned <= limit])
    if not any(len(rows) for rows in lists):
        turned_at_most = "" if protocol.heading_deg is None else f" and {protocol.heading_deg:g} degrees"
        raise UserError(
            f"no image of the validation drives is within {protocol.position:g} {protocol.unit}{turned_at_most} of a "
            "map image, so no likelihood can be fitted",
            "Check that map and drives are in the same frame, or give numbers: likelihood.tempering=0.25 "
            "likelihood.appearance_noise=0.0",
        )
    return Positives.from_lists(lists, len(references))


def check_validation(data: LocalizationData) -> None:
    """Check that there are validation images to fit the likelihood to.

    Raises:
        UserError: as for :func:`same_place`.
    """
    if data.validation:
        poses = np.concatenate([drive.poses for drive in data.validation])
        same_place(torch.from_numpy(poses), torch.from_numpy(data.map_of_validation.poses), protocol_of(data))


def protocol_of(data: LocalizationData) -> LocalizationProtocol:
    """The protocol of a dataset: what counts as being localized."""
    return PROTOCOLS[data.protocol]


def scores_over_map(model: ObservationModel, queries: Queries, likelihood: Likelihood) -> Float64[Tensor, "v n"]:
    """Log-likelihoods of all queries at the poses of the map."""
    return torch.cat([model.observe(some, likelihood).over_map() for some in queries.descriptors.split(BATCH)])


def nearest_errors(
    queries: Queries, poses: Float64[Tensor, "n 3"], descriptors: Float32[Tensor, "n d"], protocol: LocalizationProtocol
) -> Float32[Tensor, "k d"]:
    """Differences between queries and the nearest map images at their places; queries without such images are left out.

    Distances are in units of the protocol's limits: one ``position`` counts as much as one ``heading_deg``.
    """
    positives = same_place(queries.poses, poses, protocol)
    errors = []
    for row, pose in enumerate(queries.poses):
        rows = torch.from_numpy(positives[row])
        if len(rows):
            apart = (poses[rows, :2] - pose[:2]).norm(dim=1) / protocol.position
            if protocol.heading_deg is not None:
                turned = torch.remainder(poses[rows, 2] - pose[2] + np.pi, 2 * np.pi) - np.pi
                apart = apart.hypot(turned / np.radians(protocol.heading_deg))
            errors.append(queries.descriptors[row] - descriptors[rows[apart.argmin()]])
    return torch.stack(errors)
