import csv
import json

import pytest
from cli.photo_calibration.fakes import Fake, calibrate, photo

from sextant.errors import UserError


def test_a_photo_that_fails_is_named_and_the_rest_go_on(tmp_path, capsys):
    good, bad, small = photo(tmp_path / "a.png"), tmp_path / "b.jpg", photo(tmp_path / "c.png", (1, 1))
    bad.write_bytes(b"nothing")
    rows = calibrate([good, bad, small], tmp_path / "out")
    assert ["error" in row for row in rows] == [False, True, True]
    said = capsys.readouterr().out
    assert "1 photo calibrated, 2 failed" in said
    assert "Skipped (2)" in said
    assert "cannot be decoded (7 bytes): it is text" in " ".join(said.replace("│", " ").split())
    lines = list(csv.DictReader((tmp_path / "out" / "calibrations.csv").open()))
    assert [bool(line["error"]) for line in lines] == [False, True, True]


def test_a_photo_that_vanishes_meanwhile_has_failed_and_the_rest_is_written(tmp_path, capsys):
    first, gone, last = (photo(tmp_path / f"{name}.png") for name in "abc")

    class Slow(Fake):
        def predict(self, images, aspect):
            gone.unlink(missing_ok=True)
            return super().predict(images, aspect)

    rows = calibrate([first, gone, last], tmp_path / "out", Slow(), exports=("fspy",))
    assert ["error" in row for row in rows] == [False, True, False]
    assert "2 photos calibrated, 1 failed" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "calibrations.json").read_text())["photos"] == rows
    assert {path.name for path in (tmp_path / "out").glob("*.fspy")} == {"a.fspy", "c.fspy"}


def test_if_all_fail_the_command_fails_and_the_files_say_why(tmp_path):
    with pytest.raises(UserError, match=r"(?s)none of 1 photo could.*c.png.*1x1 pixels"):
        calibrate([photo(tmp_path / "c.png", (1, 1))], tmp_path / "out")
    assert "error" in json.loads((tmp_path / "out" / "calibrations.json").read_text())["photos"][0]


@pytest.mark.parametrize("broken", [{"tilt": float("nan")}, {"tilt": 1.6}, {"k1_hat": float("inf")}])
def test_a_prediction_that_is_no_camera_is_an_error_of_that_photo(tmp_path, broken):
    with pytest.raises(UserError, match="the network's prediction is not a valid camera"):
        calibrate([photo(tmp_path / "a.png")], tmp_path / "out", Fake(**broken))


def test_many_photos_go_through_in_batches(tmp_path, monkeypatch):
    monkeypatch.setattr("sextant.chapters.calibration.inference.BATCH", 2)
    paths = [photo(tmp_path / f"{g}.png", grey=g) for g in (50, 60, 70, 80, 90)]
    rows = calibrate(paths, tmp_path / "out", undistort="none")
    assert [row["focal_px"] for row in rows] == pytest.approx([0.6 * g for g in (50, 60, 70, 80, 90)], rel=1e-5)
