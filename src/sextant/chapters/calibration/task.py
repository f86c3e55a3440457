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

from sextant.chapters.calibration.data.batches import CropBatch
from sextant.chapters.calibration.metrics.errors import GRID, bearing_error
from sextant.chapters.calibration.network import CalibrationPrediction, CalibrationSpec, CameraNetwork, reported
from sextant.corruptions import Condition, CorruptionSuite
from sextant.evaluation.protocols import calibration_converged
from sextant.geometry import CameraParameters, Parameterization
from sextant.geometry.canvas import on_canvas
from sextant.geometry.perspective_field import perspective_field
from sextant.losses import CameraLoss
from sextant.losses.camera_losses import bearing_grid, field_loss
from sextant.models import CalibrationNet, CalibrationOutput
from sextant.training.schedules import OptimizerFactory, Schedule, log_training_loss, optimizers
from sextant.training.steps import StepLosses

#: quantities validated in addition to bearings
QUANTITIES = ("tilt_deg", "roll_deg", "vfov_deg", "k1_hat", "k1")
#: weight of the heads' own loss beside that of the camera fitted to the field
START_WEIGHT = 0.5


@dataclass(frozen=True)
class CalibrationResult:
    """Predictions on the test split.

    Attributes:
        truth: the true cameras.
        aspect: width over height of each image.
        panoramas: which panorama each image was cut from; crops of the same panorama are not independent.
        predictions: by condition key.
    """

    truth: CameraParameters
    aspect: Float[Tensor, "n"]
    panoramas: Int64[ndarray, "n"]
    predictions: dict[str, CalibrationPrediction]


class Calibration(CameraNetwork, pl.LightningModule):
    """Trains a :class:`~sextant.chapters.calibration.network.CameraNetwork`.

    Args:
        network: predicts the four numbers along their ranges, and the expected errors.
        spec: sizes and ranges.
        parameterization: what the four numbers are.
        loss: between predicted and true numbers.
        suite: test conditions.
        optimizer: builds the optimiser from the parameters; None for a model used only for inference.
        schedule: factor on the learning rate as a function of the share of epochs done.
        clip: largest gradient norm, applied separately to the network and to the heads of expected errors.
        log_every: steps between two logged training losses.
        field_weight: weight of the perspective field's loss, if the network predicts one.
    """

    monitor, monitor_mode = "val/bearing_deg", "min"

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
        field_weight: float = 0.0,
    ):
        super().__init__(network, spec, parameterization)
        self.loss, self.suite = loss, suite
        self.optimizer_factory, self.schedule, self.clip = optimizer, schedule, clip
        self.step_losses, self.field_weight = StepLosses(log_every), field_weight
        self.result: CalibrationResult | None = None
        self._validation: list[tuple[Tensor, ...]] = []
        self._test: dict[Condition, list[tuple[Tensor, Tensor]]] = {}
        self._test_batches: list[CropBatch] = []

    # -- training ------------------------------------------------------------------------------------------------------

    def training_step(self, batch: CropBatch, batch_idx: int) -> Tensor:
        """The loss of the cameras plus the loss of the expected errors given the actual errors."""
        output = self.network(batch.images_in_unit_range(), batch.aspect)
        fitted = self.fitted(output, batch.aspect)
        loss = batch.weight * self._loss(output, fitted, batch).mean()
        with torch.no_grad():
            error = (reported(self.camera(output, fitted, batch.aspect)) - reported(batch.cameras)).abs()
        # negative log-likelihood of a Laplace distribution, smallest if the scale is the mean absolute error
        expected = batch.weight * (output.log_scale + error * torch.exp(-output.log_scale)).mean()
        log_training_loss(self, self.step_losses.add(self.global_step, loss))
        total: Tensor = loss + expected  # the heads of ``expected`` get detached features, so the two do not interact
        return total

    def _loss(self, output: CalibrationOutput, fitted: CameraParameters | None, batch: CropBatch) -> Float[Tensor, "b"]:
        """The loss of the camera; for one fitted to a field, also those of the field and of the heads' own camera."""
        truth, aspect = self.encoded(batch.cameras, batch.aspect), batch.aspect
        shape = torch.ones_like(aspect) if self.spec.canvas else aspect
        said: Tensor = self.loss(self.space.from_unit(output.unit), truth, shape)
        if fitted is None or output.believed is None:
            return said
        points, seen = self.cell_centres(aspect)
        true = perspective_field(on_canvas(batch.cameras, aspect), points, self.parameterization.k2_of_k1)
        field = field_loss(output.believed, true, seen)
        answer: Tensor = self.loss(self.parameterization.encode(fitted), truth, shape)
        return answer + START_WEIGHT * said + self.field_weight * field

    def on_train_epoch_end(self) -> None:
        """Check and log the losses since the last logged one, so that no epoch ends unchecked."""
        log_training_loss(self, self.step_losses.flush())

    def configure_gradient_clipping(self, optimizer: Optimizer, *arguments: Any, **options: Any) -> None:
        """Clip the gradients of the network and of the expected errors separately, so that neither slows the other."""
        expected = set(self.network.scales.parameters())
        clip_grad_norm_([p for p in self.parameters() if p not in expected], self.clip)
        clip_grad_norm_(expected, self.clip)

    def configure_optimizers(self) -> Any:
        """The optimiser, with the schedule stepped once per epoch."""
        return optimizers(self, self.optimizer_factory, self.schedule)

    # -- validation ----------------------------------------------------------------------------------------------------

    def validation_step(self, batch: CropBatch, batch_idx: int) -> None:
        """Keep errors, scores and bearing errors of a batch."""
        camera, scale = self(batch.images_in_unit_range(), batch.aspect)
        error = (reported(camera) - reported(batch.cameras)).abs()
        bearing = self.bearing_error_deg(camera, batch.cameras, batch.aspect)
        constant = CameraParameters(*(torch.full_like(batch.aspect, value) for value in self.spec.median))
        beside = self.bearing_error_deg(constant, batch.cameras, batch.aspect)
        looks = self.looks(batch.images_in_unit_range(), batch.aspect)
        errors = [_errors(found, batch.cameras) for found in (camera, constant)]
        self._validation.append((*errors, error / scale, bearing, beside, looks, batch.panoramas))

    def on_validation_epoch_end(self) -> None:
        """Log median errors beside those of a constant camera; keep scores and appearance for intervals and doubts."""
        columns = (torch.cat(column).cpu() for column in zip(*self._validation, strict=True))
        errors, of_constant, scores, bearing, beside, looks, panoramas = columns
        self._validation = []
        self.keep_validation(scores, looks, panoramas)
        medians = {"val/bearing_deg": bearing.median(), "val/bearing_deg_constant": beside.median()}
        for number, name in enumerate(QUANTITIES):
            medians[f"val/{name}"] = errors[:, number].median()
            medians[f"val/{name}_constant"] = of_constant[:, number].median()
        self.log_dict(medians)

    def converged(self, validation: dict[str, float]) -> bool:
        """Whether the run learnt at all, judged on the validation split by the rule in ``evaluation.protocols``."""
        return calibration_converged(validation["val/bearing_deg"], validation["val/bearing_deg_constant"])

    def bearing_error_deg(
        self, camera: CameraParameters, truth: CameraParameters, aspect: Float[Tensor, "b"]
    ) -> Float[Tensor, "b"]:
        """Mean angle between predicted and true bearings over the image, degrees."""
        return torch.rad2deg(bearing_error(camera, truth, bearing_grid(GRID, aspect), self.parameterization))

    # -- test ----------------------------------------------------------------------------------------------------------

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
        for key, bearing in self.bearing_errors_deg().items():
            self.log(f"test/bearing_deg/{key}", bearing.median())

    def bearing_errors_deg(self) -> dict[str, Float[Tensor, "n"]]:
        """Bearing errors of the test crops by condition key, degrees."""
        assert self.result is not None
        truth, aspect = self.result.truth, self.result.aspect
        return {
            key: self.bearing_error_deg(prediction.parameters, truth, aspect)
            for key, prediction in self.result.predictions.items()
        }


def _errors(found: CameraParameters, truth: CameraParameters) -> Float[Tensor, "b 5"]:
    """Errors in the quantities that are validated, in their order."""
    error, k1 = (reported(found) - reported(truth)).abs(), (found.k1 - truth.k1).abs()
    return torch.cat([torch.rad2deg(error[:, :3]), error[:, 3:], k1[:, None]], -1)
