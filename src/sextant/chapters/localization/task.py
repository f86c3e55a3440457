"""Localization in a map of images at known poses (chapters 4 and 5): train a kernel and calibrate a likelihood."""

from collections.abc import Callable
from dataclasses import asdict, astuple, dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
import pytorch_lightning as pl
import torch
from jaxtyping import Float32, Float64
from numpy import ndarray
from torch import Tensor

from sextant.chapters.localization.along_drives import best_share, nll_along, scale_along
from sextant.chapters.localization.data.datamodule import LocalizationDataModule
from sextant.chapters.localization.data.drive import Drive
from sextant.chapters.localization.metric_map import MetricMap
from sextant.chapters.localization.sensor_measures import descriptor_nll, looked_at, sensor_cost, timed
from sextant.chapters.localization.testing import TestSettings
from sextant.chapters.localization.validation import (
    Queries,
    nearest_errors,
    protocol_of,
    same_place,
    scores_over_map,
    validation_queries,
)
from sextant.evaluation.pose_posterior import pose_errors
from sextant.evaluation.posterior import PlacePosterior
from sextant.localization.calibration import appearance_noise, error_whitening, posterior, tempered
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.hyperparameters import (
    Conditioning,
    TrainableKernel,
    joint_log_likelihood,
    random_order,
    vecchia_log_likelihood,
)
from sextant.localization.likelihood import Likelihood
from sextant.localization.metric_pose import DrivePoses, MetricErrors, pose_volume
from sextant.localization.observation import ObservationModel
from sextant.localization.observers import Camera, Observer
from sextant.localization.pose_kernel import PoseKernel, Spatial
from sextant.reporter import SILENT, Progress
from sextant.training.schedules import OptimizerFactory, Schedule, optimizers
from sextant.training.steps import StepLosses

#: a fit that took less time than this is timed again, without the imports and compilation of the first one
QUICK_FIT_S = 30.0


@dataclass(frozen=True)
class Calibration:
    """What is fitted to the validation traverse, and what is given.

    Attributes:
        likelihood: likelihood with the given values.
        fit_tempering, fit_noise, whitening: which steps of :mod:`sextant.localization.calibration` are done.
        images: number of images of the validation drives that are used.
        settings: settings of the filter that runs along them for :mod:`sextant.chapters.localization.along_drives`, for
            which the tempering is fitted; None keeps the tempering of single images.
        regions: settings of the filter whose confidence regions :mod:`sextant.chapters.localization.along_drives`
            widens; the scale is fitted for this filter. None leaves the filter's regions unchanged.
        show: shows the filter's progress along the validation drives.
    """

    likelihood: Likelihood
    fit_tempering: bool
    fit_noise: bool
    whitening: bool
    images: int
    settings: Callable[[LocalizationDataModule], TestSettings] | None = None
    regions: Callable[[LocalizationDataModule], TestSettings] | None = None
    show: Progress = SILENT.progress


class Localization(pl.LightningModule):
    """Trains the kernel on the map, then calibrates the likelihood on a traverse under other conditions.

    Args:
        dimension: dimension of the descriptors.
        spatial: form of the kernel in position.
        ard: whether x and y have separate length scales.
        sharper: arguments of :meth:`PoseKernel.sharpened` for the trained kernel; None uses it as it is.
        observation: makes the observation model, which is then fitted.
        calibration: what is fitted after training.
        objective: what training maximizes: the likelihood of all images, or Vecchia's.
        neighbours: number of neighbours of each image, for ``vecchia``.
        metric: locates frames by correspondences; None for descriptors alone. How located poses err is fitted to the
            validation drives.
        weighs: whether located poses weigh, besides proposing.
        optimizer, schedule, log_every: as for every task.
    """

    monitor, monitor_mode = "val/place_nll", "min"
    whitener: Tensor
    fitted: Tensor
    region_scale: Tensor
    metric_errors: Tensor

    def __init__(
        self,
        dimension: int,
        spatial: Spatial,
        ard: bool,
        observation: Callable[[], ObservationModel],
        calibration: Calibration,
        *,
        sharper: tuple[float, float, float] | None = None,
        objective: Literal["joint", "vecchia"] = "joint",
        neighbours: int = 20,
        metric: Callable[[LocalizationDataModule], MetricMap] | None = None,
        weighs: bool = False,
        optimizer: OptimizerFactory | None = None,
        schedule: Schedule | None = None,
        log_every: int = 50,
    ):
        super().__init__()
        self.kernel = TrainableKernel(PoseKernel(spatial, (1.0, 1.0), 1.0, 1.0, 1.0), ard=ard)
        self.spatial, self.ard, self.sharper = spatial, ard, sharper
        self.observation, self.calibration = observation, calibration
        self.objective, self.neighbours = objective, neighbours
        self.metric, self.weighs = metric, weighs
        self._metric_map: MetricMap | None = None
        if metric is not None:
            self.register_buffer("metric_errors", torch.zeros(5, dtype=torch.float64))  # of MetricErrors
        self.optimizer_factory, self.schedule = optimizer, schedule
        self.step_losses = StepLosses(log_every)
        self.register_buffer("whitener", torch.eye(dimension if calibration.whitening else 0, dtype=torch.float64))
        self.register_buffer("region_scale", torch.tensor(1.0, dtype=torch.float64))
        self.register_buffer("fitted", torch.tensor([1.0, 0.0], dtype=torch.float64))  # tempering, appearance noise
        self._conditioning: tuple[DescriptorMap, Conditioning] | None = None
        self._fitted_map: tuple[Drive, PoseKernel, ObservationModel] | None = None
        self._fit_s = 0.0
        self._begun = False
        self.register_load_state_dict_post_hook(_with_weights)

    # -- training ------------------------------------------------------------------------------------------------------

    def on_fit_start(self) -> None:
        """Whiten if requested and take starting values from the map, unless there are weights to resume from."""
        if not self._begun:  # weights are loaded before this, the step number only after it
            if self.calibration.whitening:
                self.whitener.copy_(error_whitening(self._validation_errors(self._data)))
            rows = torch.from_numpy(self._data.choices(0)[0])
            seen = self._map_of(self._data.drives.fitted, rows)
            start = TrainableKernel.from_map(seen.poses, seen.descriptors, spatial=self.spatial, ard=self.ard)
            self.kernel.load_state_dict(start.state_dict())

    def training_step(self, rows: Tensor, batch_idx: int) -> Tensor:
        """The negative log-likelihood per value of a descriptor, in nats."""
        if self.objective == "joint":
            seen = self._map_of(self._data.drives.fitted, rows)
            value = joint_log_likelihood(self.kernel, seen.poses, seen.descriptors, seen.mean)
            count = seen.descriptors.numel()
        else:
            seen, conditioning = self._conditioned()
            value = vecchia_log_likelihood(self.kernel, seen.poses, seen.descriptors, seen.mean, conditioning, rows)
            count = seen.descriptors.numel()
        loss = -value / count
        self._log_training_loss(self.step_losses.add(self.global_step, loss))
        return loss

    def _conditioned(self) -> tuple[DescriptorMap, Conditioning]:
        """The whole map, and the images on which each is conditioned, by the kernel at the start of training."""
        if self._conditioning is None:
            seen = self._map_of(self._data.drives.fitted)
            features = self.kernel.frozen().features(seen.poses).numpy()
            order = random_order(len(seen), torch.Generator().manual_seed(0))
            self._conditioning = seen, Conditioning.of(features, order, self.neighbours)
        return self._conditioning

    def on_train_epoch_end(self) -> None:
        """Log the remaining losses, and calibrate after the last epoch."""
        self._log_training_loss(self.step_losses.flush())
        if self.trainer.current_epoch + 1 == self.trainer.max_epochs:
            self.calibrate(self._data)

    def _log_training_loss(self, loss: float | None) -> None:
        if loss is None or self.logger is None:
            return
        kernel = self.kernel.frozen()
        metrics = {
            "train/loss": loss,
            "train/length_x": kernel.length[0],
            "train/length_y": kernel.length[1],
            "train/heading_length_rad": kernel.heading_length,
            "train/signal_variance": kernel.signal_variance,
            "train/noise_variance": kernel.noise_variance,
        }
        for logger in self.loggers:
            logger.log_metrics(metrics, step=self.global_step)

    # -- calibration ---------------------------------------------------------------------------------------------------

    def calibrate(self, data: LocalizationDataModule) -> None:
        """Fit appearance noise and tempering to validation images, then tempering and regions along those drives."""
        wanted = self.calibration
        self.region_scale.fill_(1.0)  # discards the scale of a resumed run
        model, queries = self._validation(data)
        likelihood = replace(wanted.likelihood, tempering=1.0)
        if wanted.fit_noise:
            found = model.residuals(queries.descriptors, queries.poses[:, None])
            noise = appearance_noise(found.squared[:, 0], found.variance[:, 0], model.map.dimension)
            likelihood = replace(likelihood, appearance_variance=noise)
        if wanted.fit_tempering:
            positives = same_place(queries.poses, model.map.poses, protocol_of(data.drives))
            likelihood = tempered(likelihood, scores_over_map(model, queries, likelihood), positives)
        else:
            likelihood = replace(likelihood, tempering=wanted.likelihood.tempering)
        self.fitted.copy_(self.fitted.new_tensor([likelihood.tempering, likelihood.appearance_variance]))
        if self.metric is not None:
            self._fit_metric_errors(data)
        make = partial(self.observers, data)
        if wanted.fit_tempering and wanted.settings is not None:
            settings, of_one = wanted.settings(data), likelihood.tempering

            def scores(share: float) -> Float64[ndarray, " b"]:
                self.fitted[0] = share * of_one
                with wanted.show(f"trying {share:g} times single-image tempering,", "validation drives") as advance:
                    return nll_along(data.drives, settings, make, self.kernel.frozen(), advance)

            self.fitted[0] = best_share(scores) * of_one
        if wanted.regions is not None:
            with wanted.show("fitting the width of regions,", "validation drives") as advance:
                scale = scale_along(data.drives, wanted.regions(data), make, self.kernel.frozen(), advance)
            self.region_scale.fill_(scale)

    @property
    def likelihood(self) -> Likelihood:
        """The calibrated likelihood."""
        tempering, noise = self.fitted.tolist()
        return replace(self.calibration.likelihood, tempering=tempering, appearance_variance=noise)

    def place_posterior(self, data: LocalizationDataModule) -> PlacePosterior:
        """Evaluate the calibrated posterior over map images on the validation drives."""
        model, queries = self._validation(data)
        likelihood = replace(self.likelihood, tempering=1.0)
        positives = same_place(queries.poses, model.map.poses, protocol_of(data.drives))
        return posterior(scores_over_map(model, queries, likelihood), positives, self.likelihood.tempering)

    def _validation(self, data: LocalizationDataModule) -> tuple[ObservationModel, Queries]:
        queries, where = validation_queries(data, self.calibration.images), data.drives.map_of_validation
        return self.fit_map(data, where), replace(queries, descriptors=self.whiten(queries.descriptors))

    def _validation_errors(self, data: LocalizationDataModule) -> Tensor:
        where, queries = data.drives.map_of_validation, validation_queries(data, self.calibration.images)
        descriptors = as_tensor(data.descriptors(where))
        return nearest_errors(queries, torch.from_numpy(where.poses), descriptors, protocol_of(data.drives))

    # -- maps ----------------------------------------------------------------------------------------------------------

    @property
    def used_kernel(self) -> PoseKernel:
        """The trained kernel, sharpened if requested."""
        trained = self.kernel.frozen()
        return trained if self.sharper is None else trained.sharpened(*self.sharper)

    def whiten(self, descriptors: Float32[Tensor, "n d"]) -> Float32[Tensor, "n d"]:
        """Whiten descriptors by the errors of the validation drives, if requested."""
        if not len(self.whitener):
            return descriptors
        return descriptors @ self.whitener.to(descriptors.dtype)

    def fit_map(self, data: LocalizationDataModule, drive: Drive, as_it_is: Drive | None = None) -> ObservationModel:
        """Fit the observation model to a drive's images at their poses.

        Args:
            data: data that holds the descriptors.
            drive: drive with the images.
            as_it_is: the drive after a fault, with the remaining images and their poses.
        """
        shown, kernel = as_it_is or drive, self.used_kernel
        if self._fitted_map is not None and self._fitted_map[:2] == (shown, kernel):  # the same drive, not an equal one
            return self._fitted_map[2]
        descriptors = as_tensor(data.descriptors(drive))
        if shown is not drive:
            descriptors = descriptors[torch.from_numpy(np.searchsorted(drive.frames, shown.frames))]
        poses = torch.from_numpy(shown.poses)
        found = DescriptorMap.of(poses, self.whiten(descriptors), merge_duplicates=data.merge_duplicates)
        model, self._fit_s = timed(lambda: self.observation().fit(found, kernel))
        self._fitted_map = shown, kernel, model
        return model

    def observers(self, data: LocalizationDataModule, drive: Drive, as_it_is: Drive) -> Callable[[Drive], Observer]:
        """Fit a map, and return a function that makes the camera of a drive in it."""
        model = self.fit_map(data, drive, as_it_is)
        return partial(self._camera, data, model, mapped=None if self.metric is None else (drive, as_it_is))

    def _camera(
        self,
        data: LocalizationDataModule,
        model: ObservationModel,
        driven: Drive,
        mapped: tuple[Drive, Drive] | None = None,
    ) -> Camera:
        located = None
        if mapped is not None:
            errors = replace(self._metric_errors, volume=pose_volume(mapped[1].poses))
            poses, covariances, alarms = self._located(data, *mapped, driven)
            located = DrivePoses(poses, covariances, alarms <= errors.limit, errors, self.weighs)
        return Camera(model, self.likelihood, self.whiten(as_tensor(data.descriptors(driven))).numpy(), located)

    def _located(
        self, data: LocalizationDataModule, drive: Drive, as_it_is: Drive, driven: Drive
    ) -> tuple[ndarray, ndarray, ndarray]:
        """The frames of a drive, located in a map after a fault."""
        assert self.metric is not None
        if self._metric_map is None:
            self._metric_map = self.metric(data)
        descriptors = data.descriptors(drive)
        if as_it_is is not drive:
            descriptors = descriptors[np.searchsorted(drive.frames, as_it_is.frames)]
        return self._metric_map.locate((as_it_is, descriptors), (driven, data.descriptors(driven)))

    @property
    def _metric_errors(self) -> MetricErrors:
        return MetricErrors(*self.metric_errors.tolist())

    def _fit_metric_errors(self, data: LocalizationDataModule) -> None:
        """Fit how located poses err to all frames of the validation drives."""
        where, errors, covariances, alarms = data.drives.map_of_validation, [], [], []
        for driven in data.drives.validation:
            poses, stated, chance = self._located(data, where, where, driven)
            errors.append(pose_errors(driven.poses, poses))
            covariances.append(stated)
            alarms.append(chance)
        found = MetricErrors.fitted(
            np.concatenate(errors), np.concatenate(covariances), pose_volume(where.poses), np.concatenate(alarms)
        )
        self.metric_errors.copy_(self.metric_errors.new_tensor(astuple(found)))

    def sensor_measures(self, data: LocalizationDataModule) -> dict[str, float]:
        """Quality and cost of the observation model in the original map.

        Returns:
            ``descriptor_nll``: nats per value of the test drives' descriptors, over all and by drive. With whitening,
            the density is that of the descriptors before whitening, so that values are comparable.
            ``us_per_particle``, ``ms_per_image``: :class:`~sextant.chapters.localization.sensor_measures.SensorCost`.
            ``fit_map_s``: seconds to fit the model to the map; ``model_mb``: its size without the descriptors.
        """
        drives, protocol = data.drives, protocol_of(data.drives)
        model = self.fit_map(data, drives.map)
        seconds = self._fit_s
        if seconds < QUICK_FIT_S:
            seconds = min(seconds, timed(lambda: self.observation().fit(model.map, model.kernel))[1])
        cost = sensor_cost(self._camera(data, model, drives.test[0]), drives.test[0], protocol)
        single = len({drive.condition for drive in drives.test}) == len(drives.test)
        labels = [drive.condition if single else drive.name for drive in drives.test]
        nll = [self._descriptor_nll(data, model, drive) for drive in drives.test]
        kept = sum(tensor.numel() * tensor.element_size() for tensor in model.state().values())
        return {
            "descriptor_nll": float(np.mean(nll)),
            **{f"descriptor_nll/{label}": value for label, value in zip(labels, nll, strict=True)},
            "us_per_particle": cost.us_per_particle,
            "ms_per_image": cost.ms_per_image,
            "fit_map_s": seconds,
            "model_mb": kept / 1e6,
        }

    def _descriptor_nll(self, data: LocalizationDataModule, model: ObservationModel, drive: Drive) -> float:
        rows = looked_at(drive)
        seen = self.whiten(torch.from_numpy(np.asarray(data.descriptors(drive)[rows], np.float32)))
        stretched = float(torch.linalg.slogdet(self.whitener)[1]) if len(self.whitener) else 0.0
        poses = torch.from_numpy(drive.poses[rows])
        return descriptor_nll(model, self.likelihood, seen, poses) - stretched / model.map.dimension

    def _map_of(self, drive: Drive, rows: Tensor | None = None) -> DescriptorMap:
        poses, descriptors = torch.from_numpy(drive.poses), as_tensor(self._data.descriptors(drive))
        if rows is not None:
            poses, descriptors = poses[rows], descriptors[rows]
        return DescriptorMap.of(poses, self.whiten(descriptors), merge_duplicates=self._data.merge_duplicates)

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *arguments: Any) -> None:
        state_dict.setdefault(prefix + "region_scale", self.region_scale)  # absent from older runs
        super()._load_from_state_dict(state_dict, prefix, *arguments)

    # -- the life cycle ------------------------------------------------------------------------------------------------

    def validation_step(self, batch: Tensor, batch_idx: int) -> None:
        """Log the NLL of the true places under the posterior over map images, and the fitted values."""
        found = self.place_posterior(self._data)
        values = {"place_nll": found.nll, "place_nll_uniform": found.chance, "tempering": self.likelihood.tempering}
        values |= {"appearance_variance": float(self.fitted[1]), "region_scale": float(self.region_scale)}
        if self.metric is not None:
            values |= {f"metric_{name}": value for name, value in asdict(self._metric_errors).items()}
        self.log_dict({f"val/{name}": value for name, value in values.items()})

    def test_step(self, batch: Tensor, batch_idx: int) -> None:
        """Do nothing: drives are localized, with progress, when the test is recorded."""

    def configure_optimizers(self) -> Any:
        """The optimizer, with the schedule stepped once an epoch."""
        return optimizers(self, self.optimizer_factory, self.schedule)

    def converged(self, validation: dict[str, float]) -> bool:
        """Whether the calibrated posterior has a lower NLL on the validation drives than a uniform one over the map.

        A given tempering is not judged: a likelihood that is too sharp may still localize.
        """
        if not self.calibration.fit_tempering:
            return True
        return validation["val/place_nll"] < validation["val/place_nll_uniform"]

    @property
    def _data(self) -> LocalizationDataModule:
        return self.trainer.datamodule  # type: ignore[attr-defined,no-any-return]


def _with_weights(module: Any, keys: object) -> None:
    """Record that a localizer has loaded the weights of a checkpoint."""
    module._begun = True


def as_tensor(rows: Float32[ndarray, "n d"]) -> Float32[Tensor, "n d"]:
    """A tensor of rows that may be a read-only mapped file; it is neither copied nor written to."""
    return torch.from_numpy(rows) if rows.flags.writeable else torch.utils.dlpack.from_dlpack(rows)
