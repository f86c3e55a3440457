"""The files for all photos together: a table, a JSON file with everything, and a contact sheet."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.applications.calibration.finding import LEVELS
from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_csv, write_json

if TYPE_CHECKING:
    from sextant.figures.calibration.overlay import CalibratedPhoto

COLUMNS = (
    "file", "verdict", "tilt_deg", "roll_deg", "focal_px", "vfov_deg", "true_vfov_deg", "true_hfov_deg", "k1", "k2",
    "width", "height", "exif_focal_px", "error",
)  # fmt: skip
BOUNDED = [(name, level) for name in ("tilt_deg", "roll_deg", "focal_px", "vfov_deg", "k1") for level in LEVELS]


def write_collected(
    rows: Sequence[Mapping[str, Any]],
    summary: Mapping[str, Any] | None,
    sheet: "Sequence[CalibratedPhoto]",
    output: Path,
) -> None:
    """Write ``calibrations.json``, ``calibrations.csv`` and ``calibrations.png``.

    Args:
        rows: rows of all photos, including those that failed.
        summary: summary of the one camera, if they are of one.
        sheet: photos on the contact sheet.
        output: folder to write into.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    with telling_write_errors(output):
        write_json(output / "calibrations.json", {"photos": list(rows), "camera": summary})
        names = [f"{q}_{level}_{end}" for q, level in BOUNDED for end in ("low", "high")]
        write_csv(output / "calibrations.csv", [*COLUMNS, *names], map(_flat, rows))
        if sheet:
            from sextant.figures.calibration.overlay import photo_sheet
            from sextant.figures.style import save_figure

            save_figure(photo_sheet(sheet), output, "calibrations")


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    flat = dict(row)
    if "intervals" in row:
        flat["verdict"] = row["confidence"]["verdict"]
        for quantity, level in BOUNDED:
            for end, value in zip(("low", "high"), row["intervals"][level][quantity], strict=True):
                flat[f"{quantity}_{level}_{end}"] = value if math.isfinite(value) else ""
    return flat
