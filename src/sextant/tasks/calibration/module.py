"""Calibration of a camera from one image: tilt, roll, focal length and radial distortion (chapter 2)."""

from dataclasses import dataclass
from typing import Any

import pytorch_lightning as pl
import torch
from jaxtyping import Float, Int64
from numpy import ndarray
from torch import Tensor
from torch.nn.utils import clip_grad_norm_
from torch.optim import Optimizer

from sextant.corruptions import Condition, CorruptionSuite
from sextant.data.calibration.crop_batch import CropBatch
from sextant.evaluation.calibration.errors import GRID, bearing_error
from sextant.evaluation.calibration.picture_looks import NUMBERS, LooksSpread, own_distances, picture_looks
from sextant.evaluation.conformal import conformal_quantile
from sextant.evaluation.protocols import calibration_converged
from sextant.geometry import CameraParameters, Parameterization, ParameterSpace, vfov_from_focal
from sextant.losses import CameraLoss
from sextant.losses.bearing import bearing_grid
from sextant.models import CalibrationNet
from sextant.tasks.optimizing import OptimizerFactory, Schedule, optimizers
from sextant.tasks.step_losses import StepLosses

#: share of validation images that look usual
USUAL = 0.95


@dataclass(frozen=True)
class CalibrationSpec:
    """What a trained network expects and may say: with the weights, all that prediction needs.

    Attributes:
        height: of its input in pixels.
        width: of its input in pixels.
        aspects: of the images it was trained on, before they were squashed to the input.
        low: lower ends of the four ranges.
        high: upper ends of the four ranges.
        validation_crops: scores that the intervals rest on.
        per_panorama: of them from each panorama.
        median: tilt, roll, focal and k1 in the middle of the training distribution.
        spread: half the width of the central 68 % of tilt, roll, vfov (radians) and k1_hat in training.
    """

    height: int
    width: int
    aspects: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    validation_crops: int
    per_panorama: int
    median: tuple[float, ...]
    spread: tuple[float, ...]

    def space(self, parameterization: Parameterization) -> ParameterSpace:
        """The numbers that the network predicts, and their ranges."""
        return ParameterSpace(parameterization, torch.tensor(self.low), torch.tensor(self.high))


@dataclass(frozen=True)
class CalibrationPrediction:
    """Cameras that were predicted, with their uncertainty.

    Attributes:
        parameters: the cameras.
        scale: expected absolute error of tilt, roll, vfov (radians) and k1_hat.
        scores: ratios of error to expected error on the validation split, one column each.
        per_panorama: validation crops of each panorama.
        strangeness: how far the looks of each image are from those of the validation split, in units of the distance
            that 95 % of such images stay below; 0 where that is not known. None if nothing was asked.
    """

    parameters: CameraParameters
    scale: Float[Tensor, "b 4"]
    scores: Float[Tensor, "n 4"]
    per_panorama: int = 1
    strangeness: Float[Tensor, "b"] | None = None

    def quantile(self, level: float) -> Float[Tensor, "4"]:
        """Multipliers of ``scale`` that make intervals which hold the truth in a share ``level`` of images."""
        return conformal_quantile(self.scores, level, self.per_panorama)


@dataclass(frozen=True)
class CalibrationResult:
    """Predictions on the test split.

    Attributes:
        truth: the true cameras.
        aspect: of each image.
        panoramas: which panorama each image was cut from: crops of one are not independent.
        predictions: by condition key.
    """

    truth: CameraParameters
    aspect: Float[Tensor, "n"]
    panoramas: Int64[ndarray, "n"]
    predictions: dict[str, CalibrationPrediction]


def reported(camera: CameraParameters) -> Float[Tensor, "*b 4"]:
    """What intervals are given for, whatever is predicted: tilt, roll, vfov (radians) and apparent distortion."""
    return torch.stack([camera.tilt, camera.roll, vfov_from_focal(camera.focal), camera.k1 / camera.focal.square()], -1)


class Calibration(pl.LightningModule):
    """Trains a network to predict the camera of an image, with the uncertainty of each parameter.

    Args:
        network: gives the four numbers along their ranges, and the expected errors.
        spec: sizes and ranges.
        parameterization: what the four numbers are.
        loss: between predicted and true numbers.
        suite: test conditions.
        optimizer: builds the optimiser from the parameters; None for a model that is only used.
        schedule: factor on the learning rate as a function of the share of epochs done.
        clip: largest norm of a gradient, of the network and of the heads of expected errors apart.
        log_every: steps between two logged training losses.
    """

    monitor, monitor_mode = "val/bearing_deg", "min"
    scores: Tensor
    looks_mean: Tensor
    looks_whitening: Tensor
    looks_scores: Tensor

    def __init__(
        self,
        network: CalibrationNet,
        spec: CalibrationSpec,
        parameterization: Parameterization,
        loss: CameraLoss,
        suite: CorruptionSuite,
        *,
        optimizer: OptimizerFactory | None = None,
        schedule: Schedule | None = None,
        clip: float = 1.0,
        log_every: int = 50,
    ):
        super().__init__()
        self.network, self.spec, self.loss, self.suite = network, spec, loss, suite
        self.parameterization, self.space = parameterization, spec.space(parameterization)
        self.optimizer_factory, self.schedule, self.clip = optimizer, schedule, clip
        self.step_losses = StepLosses(log_every)
        self.register_buffer("scores", torch.full((spec.validation_crops, 4), torch.inf))
        self.register_buffer("looks_mean", torch.zeros(NUMBERS))
        self.register_buffer("looks_whitening", torch.zeros(NUMBERS, NUMBERS))
        self.register_buffer("looks_scores", torch.full((spec.validation_crops,), torch.inf))
        self.result: CalibrationResult | None = None
        self._validation: list[tuple[Tensor, ...]] = []
        self._test: dict[Condition, list[tuple[Tensor, Tensor]]] = {}
        self._test_batches: list[CropBatch] = []

    # -- training ------------------------------------------------------------------------------------------------------

    def training_step(self, batch: CropBatch, batch_idx: int) -> Tensor:
        """The loss of the cameras, and of the expected errors given the errors made."""
        output = self.network(batch.images_in_unit_range(), batch.aspect)
        values = self.space.from_unit(output.unit)
        truth = self.parameterization.encode(batch.cameras)
        loss = self.loss(values, truth, batch.aspect).mean()
        with torch.no_grad():
            error = (reported(self.parameterization.decode(values)) - reported(batch.cameras)).abs()
        # the likelihood of Laplace's distribution: smallest where the scale is the mean absolute error
        expected = (output.log_scale + error * torch.exp(-output.log_scale)).mean()
        self._log_training_loss(self.step_losses.add(self.global_step, loss))
        total: Tensor = (
            loss + expected
        )  # the heads of ``expected`` are fed features without gradient: the sum couples nothing
        return total

    def on_train_epoch_end(self) -> None:
        """Look at the losses since the last logged one, so that no epoch ends unseen."""
        self._log_training_loss(self.step_losses.flush())

    def configure_gradient_clipping(self, optimizer: Optimizer, *arguments: Any, **options: Any) -> None:
        """Clip the gradients of the network and of the expected errors apart, so that neither slows the other."""
        expected = set(self.network.scales.parameters())
        clip_grad_norm_([p for p in self.parameters() if p not in expected], self.clip)
        clip_grad_norm_(expected, self.clip)

    def _log_training_loss(self, loss: float | None) -> None:
        if loss is not None and self.logger is not None:
            rate = self.trainer.optimizers[0].param_groups[0]["lr"]
            self.logger.log_metrics({"train/loss": loss, "train/learning_rate": rate}, step=self.global_step)

    def configure_optimizers(self) -> Any:
        """The optimiser, with the schedule stepped once an epoch."""
        return optimizers(self, self.optimizer_factory, self.schedule)

    # -- validation ----------------------------------------------------------------------------------------------------

    def validation_step(self, batch: CropBatch, batch_idx: int) -> None:
        """Keep errors, scores and bearing errors of a batch."""
        camera, scale = self(batch.images_in_unit_range(), batch.aspect)
        error = (reported(camera) - reported(batch.cameras)).abs()
        bearing = self.bearing_error_deg(camera, batch.cameras, batch.aspect)
        constant = CameraParameters(*(torch.full_like(batch.aspect, value) for value in self.spec.median))
        beside = self.bearing_error_deg(constant, batch.cameras, batch.aspect)
        looks = picture_looks(batch.images_in_unit_range())
        self._validation.append((error, error / scale, bearing, beside, looks, batch.panoramas))

    def on_validation_epoch_end(self) -> None:
        """Log median errors, and keep the scores that the intervals rest on, and what the images look like."""
        columns = (torch.cat(column) for column in zip(*self._validation, strict=True))
        error, scores, bearing, beside, looks, panoramas = columns
        self._validation = []
        self.scores.copy_(scores)
        self._keep_looks(looks.cpu(), panoramas.cpu())
        tilt, roll, vfov, k1_hat = error.median(0).values
        self.log_dict(
            {
                "val/bearing_deg": bearing.median(),
                "val/bearing_deg_constant": beside.median(),
                "val/tilt_deg": torch.rad2deg(tilt),
                "val/roll_deg": torch.rad2deg(roll),
                "val/vfov_deg": torch.rad2deg(vfov),
                "val/k1_hat": k1_hat,
            }
        )

    def _keep_looks(self, looks: Tensor, panoramas: Tensor) -> None:
        spread = LooksSpread.fit(looks)
        self.looks_mean.copy_(spread.mean)
        self.looks_whitening.copy_(spread.whitening)
        self.looks_scores.copy_(own_distances(looks, panoramas))

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *arguments: Any) -> None:
        for name in ("looks_mean", "looks_whitening", "looks_scores"):  # which runs of before do not have
            state_dict.setdefault(prefix + name, getattr(self, name))
        super()._load_from_state_dict(state_dict, prefix, *arguments)

    def converged(self, validation: dict[str, float]) -> bool:
        """Whether the run learnt at all, judged on the validation split by the rule in ``evaluation.protocols``."""
        return calibration_converged(validation["val/bearing_deg"], validation["val/bearing_deg_constant"])

    def bearing_error_deg(
        self, camera: CameraParameters, truth: CameraParameters, aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Mean angle between predicted and true bearings over the image, degrees."""
        return torch.rad2deg(bearing_error(camera, truth, bearing_grid(GRID, aspect), self.parameterization))

    # -- test and prediction -------------------------------------------------------------------------------------------

    def forward(
        self, images: Float[Tensor, "b 3 h w"], aspect: Float[Tensor, "b"]
    ) -> tuple[CameraParameters, Float[Tensor, "b 4"]]:
        """Cameras of images in [0, 1], and the expected absolute errors of what :func:`reported` gives."""
        output = self.network(images, aspect)
        return self.parameterization.decode(self.space.from_unit(output.unit)), output.log_scale.exp()

    @torch.no_grad()
    def predict(self, images: Tensor, aspect: Float[Tensor, "b"]) -> CalibrationPrediction:
        """Cameras and their uncertainty for images of bytes, ``(b, 3, h, w)``, and how strange these look."""
        images = images.float() / 255
        camera, scale = self(images, aspect)
        usual = conformal_quantile(self.looks_scores, USUAL, self.spec.per_panorama)
        distance = LooksSpread(self.looks_mean, self.looks_whitening).distance(picture_looks(images))
        return CalibrationPrediction(camera, scale, self.scores, self.spec.per_panorama, distance / usual)

    def test_step(self, batch: CropBatch, batch_idx: int) -> None:
        """Predict a batch under every condition."""
        images = batch.images_in_unit_range()
        for condition in self.suite.conditions():
            camera, scale = self(self.suite.corrupt(images, batch.indices, condition), batch.aspect)
            self._test.setdefault(condition, []).append((torch.stack(camera, -1).cpu(), scale.cpu()))
        self._test_batches.append(batch.to(torch.device("cpu")))

    def on_test_epoch_end(self) -> None:
        """Keep the predictions as :attr:`result`."""
        batches, scores = self._test_batches, self.scores.cpu()
        predictions = {}
        for condition, parts in self._test.items():
            cameras, scales = (torch.cat(column) for column in zip(*parts, strict=True))
            found = CameraParameters(*cameras.unbind(-1))
            predictions[condition.key] = CalibrationPrediction(found, scales, scores, self.spec.per_panorama)
        truth = CameraParameters(*(torch.cat(column) for column in zip(*(b.cameras for b in batches), strict=True)))
        self.result = CalibrationResult(
            truth,
            torch.cat([b.aspect for b in batches]),
            torch.cat([b.panoramas for b in batches]).numpy(),
            predictions,
        )
        self._test, self._test_batches = {}, []
        for key, prediction in predictions.items():
            bearing = self.bearing_error_deg(prediction.parameters, truth, self.result.aspect)
            self.log(f"test/bearing_deg/{key}", bearing.median())
