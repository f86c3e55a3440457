"""Trained camera networks for other programs: as a function of tensors, and as a predictor for photo files."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from sextant.errors import UserError
from sextant.kit.chapter import Content
from sextant.kit.offers import Exportable, Kind, PhotoPredictor, Row, example_images, failed_row, image_meaning
from sextant.runs.checkpoint import KEY

if TYPE_CHECKING:
    from sextant.chapters.calibration.network import CameraNetwork


class CameraHead(nn.Module):
    """A camera network with two output tensors: the camera, and the half-widths of its 95 % intervals."""

    widths: Tensor

    def __init__(self, network: "CameraNetwork"):
        super().__init__()
        from sextant.evaluation.conformal import conformal_quantile

        self.network = network
        quantile = conformal_quantile(network.scores, 0.95, network.spec.per_panorama)
        self.register_buffer("widths", quantile)

    def forward(self, images: Tensor, aspect: Tensor) -> tuple[Tensor, Tensor]:
        """Tilt, roll, focal length and k1; the half-widths are those of tilt, roll, field of view and k1/f²."""
        camera, scale = self.network(images, aspect)
        return torch.stack([camera.tilt, camera.roll, camera.focal, camera.k1], -1), scale * self.widths


def exportable(content: Content, checkpoint: Path, *, trust: bool) -> Exportable:
    """Images and their aspect ratios to cameras, with 95 % intervals."""
    from sextant.chapters.calibration.network import trained_camera_network

    spec = content[KEY]["spec"]
    if spec.get("canvas"):
        raise UserError(
            "this network takes photos on a square canvas and filters each within its borders: it cannot be exported",
            "Use it from Python: sextant.PhotoCalibrator.load(<run>).",
        )
    network = CameraHead(trained_camera_network(content, checkpoint, trust=trust))
    meanings = {
        "images": f"{image_meaning(spec, 3)}, the whole photo squashed to this size",
        "aspect": "(b): width over height of the photo",
        "camera": "(b, 4): tilt and roll in radians, focal length in heights of the photo, k1",
        "half_width_95": "(b, 4): half the 95 % intervals of tilt, roll, vertical field of view (radians) and k1/f²",
    }
    return Exportable(network, {"images": example_images(spec, 3), "aspect": torch.tensor([4 / 3, 1.0])}, meanings)


def photo_predictor(content: Content, checkpoint: Path, *, trust: bool) -> PhotoPredictor:
    """The camera of each photo."""
    from sextant.applications import FailedPhoto, PhotoCalibrator

    calibrator = PhotoCalibrator.of(content, checkpoint, trust=trust)
    numbers = ("tilt_deg", "roll_deg", "focal_px", "vfov_deg", "k1")

    def answer(photos: Sequence[Path]) -> list[Row]:
        rows = []
        for camera in calibrator.calibrate_many(photos, errors="return"):
            if isinstance(camera, FailedPhoto):
                rows.append(failed_row(camera.error))
                continue
            row = {name: getattr(camera, name) for name in numbers}
            for name in numbers:
                row[f"{name}_low_95"], row[f"{name}_high_95"] = getattr(camera.interval_95, name)
            rows.append(row | {"verdict": camera.verdict})
        return rows

    ends = [f"{name}_{end}_95" for name in numbers for end in ("low", "high")]
    columns: dict[str, Kind] = {"verdict": "string", **dict.fromkeys([*numbers, *ends], "double")}
    return PhotoPredictor(columns, answer)
