"""Localization by a laser in an occupancy grid: the baseline of chapter 4, in the same filter. Nothing is trained."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import pytorch_lightning as pl
import torch
from torch import Tensor

from sextant.chapters.localization.data.datamodule import LocalizationDataModule
from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.localization.sensor_measures import sensor_cost
from sextant.chapters.localization.validation import protocol_of, same_place, validation_rows
from sextant.errors import UserError
from sextant.evaluation.posterior import PlacePosterior
from sextant.localization.calibration import posterior, tempered
from sextant.localization.laser import BeamModel, LikelihoodField
from sextant.localization.likelihood import Likelihood
from sextant.localization.observers import Laser, Observer
from sextant.training.schedules import nothing_to_optimize
from sextant.worlds.laser import LaserScanner
from sextant.worlds.occupancy import OccupancyGrid, occupancy_from_scans

#: makes a scan model from a grid, a scanner and a tempering
MakeScanModel = Callable[[OccupancyGrid, LaserScanner, float], LikelihoodField | BeamModel]
#: number of scans whose scores over a whole map are held at a time
BATCH = 16


class LaserLocalization(pl.LightningModule):
    """Fits the tempering of a laser's likelihood to the validation drives.

    Args:
        scan_model: see :data:`MakeScanModel`.
        tempering: a given value, or None to fit it.
        images: number of frames of the validation drives that are used.
        resolution_m: resolution of the occupancy grid, which is made from the map drive's scans.
    """

    monitor, monitor_mode = "val/place_nll", "min"
    fitted: Tensor

    def __init__(
        self,
        scan_model: MakeScanModel,
        tempering: float | None,
        images: int,
        resolution_m: float,
    ):
        super().__init__()
        self.automatic_optimization = False
        self.scan_model, self.tempering = scan_model, tempering
        self.images, self.resolution_m = images, resolution_m
        self.register_buffer("fitted", torch.tensor([1.0 if tempering is None else tempering], dtype=torch.float64))

    def training_step(self, rows: Tensor, batch_idx: int) -> None:
        """There is nothing to optimize."""
        self.optimizers().step()  # type: ignore[union-attr]

    def on_train_epoch_end(self) -> None:
        """Fit the tempering when the last epoch is done."""
        if self.trainer.current_epoch + 1 == self.trainer.max_epochs and self.tempering is None:
            self.calibrate(self._data)

    def calibrate(self, data: LocalizationDataModule) -> None:
        """Fit the tempering to the validation drives."""
        scores, poses, references = self._scores(data)
        positives = same_place(poses, references, protocol_of(data.drives))
        self.fitted.copy_(self.fitted.new_tensor([tempered(Likelihood(), scores, positives).tempering]))

    def place_posterior(self, data: LocalizationDataModule) -> PlacePosterior:
        """Evaluate the posterior over the map's poses on the validation drives."""
        scores, poses, references = self._scores(data)
        return posterior(scores, same_place(poses, references, protocol_of(data.drives)), self.fitted.item())

    def _scores(self, data: LocalizationDataModule) -> tuple[Tensor, Tensor, Tensor]:
        drives = data.drives
        where = drives.map_of_validation
        model, references = self._model(data, where, 1.0), torch.from_numpy(where.poses)
        rows, poses, scores = validation_rows(data, self.images), [], []
        for drive, row in zip(drives.validation, rows, strict=True):
            scans = torch.from_numpy(np.asarray(_scans(drive)[row], np.float64))
            poses.append(torch.from_numpy(drive.poses[row]))
            scores += [model.observe(some, references).over_map() for some in scans.split(BATCH)]
        return torch.cat(scores), torch.cat(poses), references

    def _model(self, data: LocalizationDataModule, drive: Drive, tempering: float) -> LikelihoodField | BeamModel:
        scanner = data.drives.scanner
        if scanner is None:
            raise UserError(
                f"observation: dataset={data.source.name} has no laser scans, which a laser model needs",
                "Choose dataset=office_walk or cold, or an image model: observation=cached_local",
            )
        grid = occupancy_from_scans(scanner, drive.poses, np.asarray(_scans(drive), np.float64), self.resolution_m)
        return self.scan_model(grid, scanner, tempering)

    def observers(self, data: LocalizationDataModule, drive: Drive, as_it_is: Drive) -> Callable[[Drive], Observer]:
        """Make the grid, and return a function that makes the laser of a drive in it."""
        model, references = self._model(data, as_it_is, self.fitted.item()), torch.from_numpy(as_it_is.poses)
        return lambda driven: Laser(model, _scans(driven), references)

    def sensor_measures(self, data: LocalizationDataModule) -> dict[str, float]:
        """The cost of a scan, as for images; its likelihood is not a density of a descriptor."""
        drives = data.drives
        observer = self.observers(data, drives.map, drives.map)(drives.test[0])
        return asdict(sensor_cost(observer, drives.test[0], protocol_of(drives)))

    def validation_step(self, batch: Tensor, batch_idx: int) -> None:
        """Log the NLL of the true places under the posterior over the map's poses, and the tempering."""
        found = self.place_posterior(self._data)
        values = {"place_nll": found.nll, "place_nll_uniform": found.chance, "tempering": self.fitted.item()}
        self.log_dict({f"val/{name}": value for name, value in values.items()})

    def test_step(self, batch: Tensor, batch_idx: int) -> None:
        """Do nothing: drives are localized, with progress, when the test is recorded."""

    def configure_optimizers(self) -> Any:
        """An optimizer without parameters."""
        return nothing_to_optimize()

    def converged(self, validation: dict[str, float]) -> bool:
        """Whether the calibrated posterior is better than a uniform one, as for images."""
        if self.tempering is not None:
            return True
        return validation["val/place_nll"] < validation["val/place_nll_uniform"]

    @property
    def _data(self) -> LocalizationDataModule:
        return self.trainer.datamodule  # type: ignore[attr-defined,no-any-return]


def _scans(drive: Drive) -> np.ndarray:
    if drive.laser is None:
        raise UserError(f"the drive {drive.name} has no laser scans", "observation=cached_local")
    return drive.laser
