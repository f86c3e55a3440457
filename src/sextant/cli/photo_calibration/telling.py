"""Terminal output of calibrated photos."""

from collections.abc import Mapping
from pathlib import Path

from rich.markup import escape

from sextant.applications.calibration.written_cameras import WrittenCameras
from sextant.cli.console import console, rows_table
from sextant.cli.output_folder import tell_written
from sextant.cli.skipped_files import tell_skipped


def tell(written: WrittenCameras, skipped: Mapping[str, str]) -> None:
    """Print the cameras, doubts about them, which photos failed, and where the files are."""
    table = [
        {"photo": Path(row["file"]).name, "tilt °": f"{row['tilt_deg']:+.1f}", "roll °": f"{row['roll_deg']:+.1f}",
         "focal px": f"{row['focal_px']:.0f}", "vfov °": f"{row['vfov_deg']:.1f}", "k1": f"{row['k1']:+.3f}",
         "trust": row["confidence"]["verdict"]}
        for row in written.rows if row["file"] not in skipped
    ]  # fmt: skip
    console.print(rows_table("Cameras", table))
    for row in written.rows:
        for reason in row.get("confidence", {}).get("reasons", ()):
            console.print(f"[dim]{escape(Path(row['file']).name)}: {escape(reason)}[/]")
    tell_skipped(skipped)
    if summary := written.summary:
        console.print(
            f"One camera from {len(summary['kept'])} of {summary['photos']} photos: "
            f"chi-square {summary['chi_square']:.1f} with {summary['degrees_of_freedom']} degrees of freedom, "
            f"p = {summary['p_value']:.2g}"
        )
    tell_written(f"{len(table)} photos calibrated", len(skipped), written.files)
