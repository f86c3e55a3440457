"""The map that a localization run saves for ``predict.py`` and ``sextant.Localizer``."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from sextant.chapters.localization.config import LocalizationConfig
from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.map_pictures import map_pictures
from sextant.chapters.localization.validation import protocol_of
from sextant.chapters.places.descriptors import BaselineDescriber, LayerDescriber
from sextant.chapters.places.saved_descriptor import SavedDescriptor, kept_baseline, kept_layer, kept_network
from sextant.errors import UserError
from sextant.runs.resolve import resolve_run

if TYPE_CHECKING:
    from sextant.chapters.localization.data.datamodule import LocalizationDataModule
    from sextant.chapters.localization.task import Localization
    from sextant.chapters.localization.testing import TestSettings

#: number of map images described again to verify that the descriptor matches the map
COMPARED = 4
#: largest difference of their descriptors, relative to the largest value
SAME = 1e-2


def run_localizer(
    module: "Localization",
    data: "LocalizationDataModule",
    settings: "TestSettings",
    config: LocalizationConfig,
    region_scale: float,
) -> Localizer:
    """A localizer of the dataset's map, calibrated likelihood and descriptor, with the filter and regions of the test.

    Raises:
        UserError: the descriptors in the cache differ from those of the descriptor.
    """
    drive, protocol = data.drives.map, protocol_of(data.drives)
    model = module.fit_map(data, drive)
    filter = settings.filter(model.map.poses, module.kernel.frozen())
    kept = _kept(data, config)
    whitener: Tensor = module.whitener
    descriptor = replace(kept, whitener=whitener if len(whitener) else None)
    return Localizer(
        model,
        module.likelihood,
        filter,
        radius=protocol.position * 2,
        descriptor=descriptor,
        image_size=None if drive.images is None else tuple(drive.images.shape[1:]),  # type: ignore[arg-type]
        unit=data.drives.unit,
        particles=settings.particle_counts[-1],
        adapts=settings.adapts,
        odds=settings.odds,
        region_scale=region_scale,
        pictures=None if drive.images is None or len(model.map) != len(drive) else map_pictures(drive.images),
        facts={
            "dataset": data.source.name,
            "fingerprint": data.source.fingerprint(),
            "protocol": {"name": data.drives.protocol, "position": protocol.position, "heading": protocol.heading_deg},
        },
    )


def _kept(data: "LocalizationDataModule", config: LocalizationConfig) -> SavedDescriptor:
    describer, images = data.describer, data.drives.fitted.images
    if (run := config.plain["descriptor"].get("run")) is not None:  # the descriptor is a trained run
        outputs = Path(config.paths.outputs)
        trained = resolve_run(run, outputs)
        return kept_network(trained.checkpoint, trust=trained.is_own(outputs))
    if not isinstance(describer, BaselineDescriber) or images is None:
        return SavedDescriptor()
    describer.fit(images)  # not yet fitted if all descriptors came from the cache
    if isinstance(describer, LayerDescriber):
        kept = kept_layer(describer.layer, describer.nodes)
    else:
        kept = kept_baseline(describer.descriptor)
    known = np.asarray(data.descriptors(data.drives.fitted)[:COMPARED])
    found = describer.describe(images[:COMPARED])
    if np.abs(found - known).max() > SAME * np.abs(known).max():
        raise UserError(
            f"the descriptors of the map in {data.cache} differ from those that the descriptor computes now",
            f"They are from another version: delete {data.cache}/descriptors-*.npy and run again.",
        )
    return kept if kept.facts["kind"] != "none" else SavedDescriptor()  # the user's own descriptors are not stored


def write_map(localizer: Localizer, folder: Path) -> None:
    """Write a run's map."""
    with torch.no_grad():
        localizer.save(folder)
