"""A photo as it is drawn with its camera."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sextant.applications.calibration.finding import Finding
from sextant.figures.calibration.overlay import CalibratedPhoto


def calibrated_photo(finding: Finding, image: np.ndarray, row: Mapping[str, Any]) -> CalibratedPhoto:
    """The photo with its camera and a caption; ``image`` may be of any size."""
    camera, photo, view = finding.camera, finding.photo, finding.view
    seen = (view.left / photo.width, view.top / photo.height, view.width / photo.width, view.height / photo.height)
    return CalibratedPhoto(
        image, float(camera.tilt), float(camera.roll), finding.focal_px / photo.height, float(camera.k1),
        float(finding.k2), seen, _caption(row),
    )  # fmt: skip


def _caption(row: Mapping[str, Any]) -> list[str]:
    widths = row["intervals"]["68"]

    def half(key: str, unit: str) -> str:
        width = (widths[key][1] - widths[key][0]) / 2
        return f"±{width:.2g}{unit}" if math.isfinite(width) else "±?"

    return [
        f"{Path(row['file']).name}: {row['confidence']['verdict']}",
        f"tilt {row['tilt_deg']:+.1f}°{half('tilt_deg', '°')}, roll {row['roll_deg']:+.1f}°{half('roll_deg', '°')}",
        f"field of view {row['vfov_deg']:.1f}°{half('vfov_deg', '°')}, k1 {row['k1']:+.3f}{half('k1', '')}",
    ]
