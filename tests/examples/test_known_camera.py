"""The photo with which ``make run`` ends: its camera is known, and the network that ships answers it well."""

import json
import runpy
from pathlib import Path

import pytest

from sextant import cli

ROOT = Path(__file__).parents[2]
PHOTO = ROOT / "examples" / "photos" / "berlin.jpg"


@pytest.mark.slow
def test_the_photo_of_the_first_job_is_answered_well(tmp_path):
    assert PHOTO.stat().st_size < 200_000
    assert "mapillary" in (PHOTO.parent / "LICENSE.txt").read_text(encoding="utf-8")
    cli.run("predict", [f"input={PHOTO}", f"output={tmp_path}"])
    (photo,) = json.loads((tmp_path / "calibrations.json").read_text(encoding="utf-8"))["photos"]
    assert photo["confidence"]["verdict"] == "good"
    assert photo["tilt_deg"] == pytest.approx(24.3, abs=2.0)  # of the phone's accelerometer
    line = runpy.run_path(str(ROOT / "examples" / "known_camera.py"))["compared"](photo)
    assert line.startswith("berlin.jpg: EXIF gives 1,035 px; the photo alone gives 96")
    assert "px, contains it (trust: good)" in line
    commands = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert str(PHOTO.relative_to(ROOT)) in commands
