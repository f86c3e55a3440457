"""What the network says of each photo, and what speaks against it there and then."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sextant.applications.calibration.finding import LEVELS, Finding
from sextant.applications.calibration.model import CalibrationModel
from sextant.data.photos import NetworkView, Photo, network_view, read_photo
from sextant.errors import UserError
from sextant.geometry import CameraParameters

BATCH = 64
LITTLE_SEEN = 0.6  # of the photo's area


def find_cameras(model: CalibrationModel, paths: Sequence[Path], rows: dict[Path, dict[str, Any]]) -> Iterable[Finding]:
    """What the network says of each photo; that one failed is put into its row.

    Photos are read one at a time and only the small views are kept.
    """
    for start in range(0, len(paths), BATCH):
        batch: list[tuple[Path, Photo, NetworkView]] = []
        for path in paths[start : start + BATCH]:
            try:
                photo = read_photo(path)
            except UserError as error:
                rows[path]["error"] = error.problem
                continue
            view = network_view(photo, model.aspects, model.input_width, model.input_height)
            batch.append((path, _without_pixels(photo), view))
        if not batch:
            continue
        images = torch.from_numpy(np.stack([view.image for _, _, view in batch]).transpose(0, 3, 1, 2).copy())
        with torch.no_grad():
            said = model.predict(images, torch.tensor([view.aspect for _, _, view in batch]))
        strange = torch.zeros(len(batch)) if said.strangeness is None else said.strangeness.cpu()
        cameras = torch.stack(list(said.parameters), -1).cpu().double()
        half = {name: (said.scale * said.quantile(level)).cpu().double() for name, (level, _) in LEVELS.items()}
        for i, (path, photo, view) in enumerate(batch):
            camera = CameraParameters(*cameras[i].unbind())
            if not (cameras[i].isfinite().all() and camera.focal > 0 and camera.tilt.abs() < math.pi / 2):
                numbers = ", ".join(f"{n}={v:.3g}" for n, v in zip(camera._fields, cameras[i].tolist(), strict=True))
                rows[path]["error"] = f"{path}: what the network predicts is no camera ({numbers})"
                continue
            widths = {name: np.nan_to_num(half[name][i].numpy(), nan=np.inf, posinf=np.inf) for name in LEVELS}
            finding = Finding(path, photo, view, camera, widths, model.k2_of_k1)
            _doubt_view(finding, model, float(strange[i]))
            yield finding


def _without_pixels(photo: Photo) -> Photo:
    return Photo(np.zeros((0, 0, 3), np.uint8), photo.width, photo.height, photo.orientation, photo.exif_focal_px)


def _doubt_view(finding: Finding, model: CalibrationModel, strangeness: float) -> None:
    view, photo = finding.view, finding.photo
    if view.share < LITTLE_SEEN:
        finding.doubts.append((1, f"the network saw only {view.share:.0%} of the photo: it has an unusual shape"))
    if view.width < model.input_width or view.height < model.input_height:
        finding.doubts.append(
            (1, f"{photo.width}x{photo.height} pixels are fewer than the {model.input_width}x{model.input_height} that "
                "the network takes")
        )  # fmt: skip
    if strangeness > 1:
        finding.doubts.append(
            (1, f"it does not look like anything the network was trained on: {strangeness:.1f} times as far from it as "
                "all but a twentieth of its validation images")
        )  # fmt: skip
