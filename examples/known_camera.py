"""The focal lengths of calibrated photos by EXIF and as estimated from the photos alone.

    python predict.py input=examples/photos/berlin.jpg output=outputs/photo
    python examples/known_camera.py outputs/photo

``berlin.jpg`` was taken with an iPhone 4S. Its EXIF block gives a 35-mm equivalent, in whole millimetres. The
accelerometer of the phone measured a tilt of 24.3 degrees and a roll of 0.5 degrees. The photo was chosen because its
estimate is accurate, so it is no measure of typical accuracy: see results/photos.md.
"""

import json
import sys
from pathlib import Path


def compared(photo: dict) -> str:
    """One line for a photo of ``calibrations.json``."""
    focal, (low, high) = photo["exif_focal_px"], photo["intervals"]["95"]["focal_px"]
    name = Path(photo["file"]).name
    if focal is None:
        return f"{name}: EXIF gives no focal length"
    holds = "contains" if low <= focal <= high else "does not contain"
    return (
        f"{name}: EXIF gives {focal:,.0f} px; the photo alone gives {photo['focal_px']:,.0f} px, "
        f"and its 95 % interval, {low:,.0f} to {high:,.0f} px, {holds} it (trust: {photo['confidence']['verdict']})"
    )


if __name__ == "__main__":
    for each in json.loads((Path(sys.argv[1]) / "calibrations.json").read_text("utf-8"))["photos"]:
        print(compared(each))
