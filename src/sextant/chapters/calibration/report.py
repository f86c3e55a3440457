"""The trained network compared with image-independent and line-based baselines: errors, table, figures."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64, UInt8
from numpy import ndarray

from sextant.chapters.calibration.data.datamodule import CalibrationData
from sextant.chapters.calibration.metrics.errors import calibration_errors
from sextant.chapters.calibration.metrics.sparsification import sparsification
from sextant.chapters.calibration.metrics.summary import KIND, failures, methods_table, summary
from sextant.chapters.calibration.network import CalibrationPrediction, reported
from sextant.chapters.calibration.task import Calibration
from sextant.evaluation.conformal import TABLE_LEVELS, coverage
from sextant.evaluation.shares import median_error
from sextant.geometry import CameraParameters
from sextant.reporter import Advance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sextant.baselines.calibration import CameraBelief

#: errors kept as metrics of a run
KEPT = ("tilt_deg", "roll_deg", "vfov_deg", "k1", "k1_hat", "bearing_deg", "undistortion_px")
#: columns of the printed table
COLUMNS = ("method", "tilt (°)", "roll (°)", "vfov (°)", "k1", "k1/f²", "bearing (°)", "undistortion (px @480)")
REPORTED = ("tilt", "roll", "vfov", "k1_hat")
BATCH, SHEET = 64, 16
#: images with fewer long segments than this quantile of the validation images count as poor in lines; the limits of
#: dark, cluttered and curved images are the same quantile
KIND_SHARE = 0.25
FEW_LINES = "few lines"


@dataclass(frozen=True)
class CalibrationReport:
    """Errors of every method on the test crops.

    Attributes:
        cameras: predicted cameras by method, in the order of the table.
        errors: by method, then by name.
        kinds: which crops are poor in lines, cluttered, dark or curved, by name; empty without geometric methods.
        few_lines_below: crops with fewer long segments count as poor in lines; fixed on validation, as are the others.
    """

    cameras: dict[str, CameraParameters]
    errors: dict[str, dict[str, Float[ndarray, "n"]]]
    kinds: Mapping[str, Bool[ndarray, "n"]] = field(default_factory=dict)
    few_lines_below: int = 0


def compare(module: Calibration, data: CalibrationData, *, geometric: bool, progress: Advance) -> CalibrationReport:
    """Compare the network's test predictions with baselines on the same crops; geometric ones get them enlarged."""
    from sextant.baselines.calibration import ConstantCamera, PriorCamera

    assert module.result is not None
    result = module.result
    training = data.distribution_sample()
    n = len(result.aspect)
    blank = np.zeros((1, 1, 3), np.uint8)
    cameras = {
        name: _repeated(method.fit(training).calibrate(blank).camera, n)
        for name, method in (("constant", ConstantCamera()), ("prior", PriorCamera()))
    }
    kinds, below = {}, 0
    if geometric:
        cameras |= _geometric(module, data, training, n, progress)
        data.setup("validate")
        usual = _looks(data, "val", data.count("val"), progress)
        limits = {kind: np.quantile(values, KIND_SHARE) for kind, values in usual.items()}
        limits[FEW_LINES] = below = int(limits[FEW_LINES])
        kinds = {kind: values < limits[kind] for kind, values in _looks(data, "test", n, progress).items()}
    ours = result.predictions["clean"].parameters
    refined = cameras.pop("network + lines", None)
    cameras["network"] = ours
    if refined is not None:
        cameras["network + lines"] = refined
    family = module.parameterization.k2_of_k1
    truth = result.truth.to(dtype=torch.float64)
    errors = {
        name: calibration_errors(camera.to(dtype=torch.float64), truth, result.aspect.double(), k2_of_k1=family)
        for name, camera in cameras.items()
    }
    return CalibrationReport(cameras, errors, kinds, below)


def _geometric(
    module: Calibration, data: CalibrationData, training: CameraParameters, n: int, progress: Advance
) -> dict[str, CameraParameters]:
    """Cameras of every geometric method for the test crops."""
    from sextant.baselines.calibration import CombinedGeometry, PlumbLine, VanishingPoints
    from sextant.baselines.calibration.by_lines import cameras_by_lines

    assert module.result is not None
    prediction = module.result.predictions["clean"]
    beliefs = network_beliefs(prediction)
    methods = {
        "vanishing points": VanishingPoints().fit(training),
        "plumb lines": PlumbLine().fit(training),
        "both": CombinedGeometry().fit(training),
    }

    look = partial(cameras_by_lines, list(methods.values()))
    found = list(_over_crops(data, "test", n, look, progress, beliefs))
    stacked = [
        CameraParameters(*(torch.stack(values) for values in zip(*column, strict=True)))
        for column in zip(*found, strict=True)
    ]
    return dict(zip([*methods, "network + lines"], stacked, strict=True))


def network_beliefs(prediction: CalibrationPrediction) -> "list[CameraBelief]":
    """The network's prediction for each image as a belief; standard errors are half-widths of the 68 % intervals."""
    from sextant.baselines.calibration import CameraBelief

    sigmas = (prediction.scale * prediction.quantile(0.68).nan_to_num(posinf=3.0)).double().tolist()
    cameras = reported(prediction.parameters).double().tolist()
    return [
        CameraBelief(tilt, roll, 0.5 / math.tan(vfov / 2), k1_hat, tuple(sigma))
        for (tilt, roll, vfov, k1_hat), sigma in zip(cameras, sigmas, strict=True)
    ]


def _looks(data: CalibrationData, split: str, n: int, progress: Advance) -> dict[str, Float[ndarray, "n"]]:
    """Statistics of a split's crops, by the kind of scene that low values indicate.

    Numbers of long segments, their share of the length of all segments, the mean grey, and ``-|k1 / f²|``.
    """
    from sextant.baselines.calibration.by_lines import look_of_lines

    segments, share, grey = np.array(list(_over_crops(data, split, n, look_of_lines, progress)), float).T
    cameras = data.split(split).cameras(n)
    bend = -(cameras.k1 / cameras.focal.square()).abs().numpy()
    return {FEW_LINES: segments, "cluttered": share, "dark": grey, "curved": bend}


def _over_crops(
    data: CalibrationData, split: str, n: int, look: Callable[..., Any], progress: Advance, *beside: Sequence[Any]
) -> Iterator[Any]:
    """``look(image, *beside[i])`` for the first ``n`` crops of a split, unsquashed, in order.

    They are looked at by ``1 + workers`` processes.
    """
    from joblib import Parallel, delayed

    crops = data.larger(split)

    def work() -> Iterator[Any]:
        for start in range(0, n, BATCH):
            numbers = list(range(start, min(start + BATCH, n)))
            batch = crops[numbers]
            images = np.ascontiguousarray(batch.images.numpy().transpose(0, 2, 3, 1))
            for i, image, aspect in zip(numbers, images, batch.aspect.tolist(), strict=True):
                yield delayed(look)(_unsquashed(image, aspect), *(each[i] for each in beside))

    for done, found in enumerate(Parallel(1 + data.workers, return_as="generator")(work()), 1):
        progress(done, n)
        yield found


def _unsquashed(image: UInt8[ndarray, "h w 3"], aspect: float) -> UInt8[ndarray, "h w2 3"]:
    """A crop at its own aspect, since geometric methods take pixels as square; nothing changes where it has it."""
    import cv2

    height, width = image.shape[:2]
    wide = round(height * aspect)
    if wide == width:
        return image
    means = cv2.INTER_AREA if wide < width else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, (wide, height), interpolation=means))


def _repeated(camera: CameraParameters, n: int) -> CameraParameters:
    return CameraParameters(*(value.expand(n) for value in camera))


def table(report: CalibrationReport, panoramas: Int64[ndarray, "n"]) -> list[dict[str, str]]:
    """Rows of the comparison: median errors, and areas under the recall curve.

    With geometric methods, rows for the crops poor in lines follow.
    """
    titles, rows = methods_table({name: summary(of, panoramas) for name, of in report.errors.items()})
    few = report.kinds.get(FEW_LINES)
    if few is not None and few.any():
        poor = f" (< {report.few_lines_below} segments)"
        chosen = {
            name + poor: summary({key: values[few] for key, values in of.items()}, panoramas[few])
            for name, of in report.errors.items()
            if name in ("constant", "vanishing points", "both", "network")
        }
        rows += methods_table(chosen)[1]
    return [{t: cell for t, cell in zip(titles, row, strict=True) if t in COLUMNS} for row in rows]


def metrics(module: Calibration, report: CalibrationReport) -> dict[str, float]:
    """Median errors and failures of every method, and coverage and sparsification of the network's uncertainty."""
    assert module.result is not None
    result = module.result
    numbers = {
        f"test/{key}/{name.replace(' ', '_').replace('+', 'and')}": median_error(errors[key])
        for name, errors in report.errors.items()
        for key in KEPT
    }
    for name, errors in report.errors.items():
        for kind, failed in failures(errors["bearing_deg"], report.kinds).items():
            numbers[f"test/failure_share/{kind}/{name}".replace(" ", "_").replace("+", "and")] = float(failed.mean())
    prediction = result.predictions["clean"]
    error = (reported(prediction.parameters) - reported(result.truth)).abs()
    for level in TABLE_LEVELS:
        held = coverage(error / prediction.scale, prediction.quantile(level))
        numbers |= {
            f"test/coverage_{round(100 * level)}/{name}": float(v) for name, v in zip(REPORTED, held, strict=True)
        }
    for k, name in enumerate(REPORTED):
        numbers[f"test/ause/{name}"] = sparsification(error[:, k].numpy(), prediction.scale[:, k].numpy()).relative
    return numbers


def arrays(module: Calibration, report: CalibrationReport) -> dict[str, ndarray]:
    """True and predicted cameras and errors by crop."""
    assert module.result is not None
    result = module.result
    kept = {"truth": torch.stack(result.truth, -1).numpy(), "panoramas": result.panoramas}
    kept |= {f"camera/{name}": torch.stack(camera, -1).numpy() for name, camera in report.cameras.items()}
    kept |= {f"{key}/{name}": errors[key] for name, errors in report.errors.items() for key in KEPT}
    kept |= {f"{KIND}{kind}": of for kind, of in report.kinds.items()}
    kept |= {f"scale/{key}": prediction.scale.numpy() for key, prediction in result.predictions.items()}
    kept |= {
        f"camera/network/{key}": torch.stack(prediction.parameters, -1).numpy()
        for key, prediction in result.predictions.items()
    }
    return kept


def figures(module: Calibration, data: CalibrationData, report: CalibrationReport) -> "Iterator[tuple[str, Figure]]":
    """Yield figures: crops with horizons, errors against true parameters, predictions, and uncertainty."""
    from sextant.chapters.calibration.figures.errors import (
        coverage_curves,
        error_by_parameter,
        predicted_against_true,
        sparsification_curves,
    )
    from sextant.chapters.calibration.figures.overlay import calibration_sheet
    from sextant.evaluation.conformal import coverage_curve

    assert module.result is not None
    result, prediction = module.result, module.result.predictions["clean"]
    n = len(result.aspect)
    shown = np.linspace(0, n - 1, min(SHEET, n)).astype(int)
    crops = data.larger("test")[shown.tolist()]
    family = module.parameterization.k2_of_k1
    at = torch.from_numpy(shown)
    yield (
        "crops",
        calibration_sheet(
            crops.images, crops.aspect, crops.cameras, prediction.parameters.at(at), method="network", family=family
        ),
    )
    yield "error_by_parameter", error_by_parameter(result.truth, report.errors)
    yield "predicted_against_true", predicted_against_true(result.truth, prediction.parameters)
    error = (reported(prediction.parameters) - reported(result.truth)).abs()
    curve = coverage_curve(
        prediction.scores, error / prediction.scale, result.panoramas, per_panorama=prediction.per_panorama
    )
    yield "coverage", coverage_curves(curve, REPORTED)
    yield (
        "sparsification",
        sparsification_curves(
            {
                name: sparsification(error[:, k].numpy(), prediction.scale[:, k].numpy())
                for k, name in enumerate(REPORTED)
            }
        ),
    )
