import csv
import json
import math
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
import torch
from cli.photo_calibration.fakes import Fake, calibrate, photo
from PIL import Image

from sextant.geometry import k2_of_k1


def test_what_is_written_of_a_photo(tmp_path, figures):
    out = tmp_path / "out"
    (row,) = calibrate([photo(tmp_path / "a.jpg", (160, 120))], out)
    names = {"a.json", "a_overlay.png", "a_undistorted.jpg"} | {f"calibrations.{k}" for k in ("json", "csv", "png")}
    assert {p.name for p in out.iterdir()} == names
    assert json.loads((out / "a.json").read_text()) == row
    assert json.loads((out / "calibrations.json").read_text())["photos"] == [row]
    assert row["focal_px"] == pytest.approx(0.7 * 120)
    assert row["tilt_deg"] == pytest.approx(math.degrees(0.1))
    assert row["roll_deg"] == pytest.approx(math.degrees(-0.05))
    assert row["k1"] == pytest.approx(-0.3 * 0.7**2)
    assert row["k1_hat"] == pytest.approx(-0.3)
    assert row["k2"] == pytest.approx(float(k2_of_k1(torch.tensor(row["k1"]).double())))
    assert row["vfov_deg"] == pytest.approx(math.degrees(2 * math.atan(1 / 1.4)))
    assert row["confidence"]["verdict"] == "good"
    (line,) = csv.DictReader((out / "calibrations.csv").open())
    assert float(line["focal_px_95_low"]) == pytest.approx(row["intervals"]["95"]["focal_px"][0])
    assert Image.open(out / "a_undistorted.jpg").size == (160, 120)


def test_no_straightened_photo_of_an_earlier_run_is_left(tmp_path):
    path, out = photo(tmp_path / "a.jpg"), tmp_path / "out"
    calibrate([path], out)
    own = photo(out / "b_undistorted.jpg")
    calibrate([path], out, undistort="none")
    assert sorted(each.name for each in out.glob("*_undistorted.*")) == [own.name]


@pytest.mark.parametrize("undistort", ["crop", "all", "none"])
def test_the_straightened_photo_is_described(tmp_path, undistort):
    (row,) = calibrate([photo(tmp_path / "a.png", (160, 120), grey=200)], tmp_path / "out", undistort=undistort)
    assert ("undistorted" in row) == (undistort != "none")
    if undistort == "none":
        assert not (tmp_path / "out" / "a_undistorted.png").exists()
        return
    pixels = np.asarray(Image.open(tmp_path / "out" / row["undistorted"]["file"]))
    assert (pixels == 200).all() == (undistort == "crop")
    assert (row["undistorted"]["focal_px"] < row["focal_px"]) == (undistort in ("all", "crop"))


@pytest.mark.parametrize("wild", [{"k1_hat": -5.0}, {"k1_hat": 3.0}, {"tilt": 1.5, "roll": 3.0}, {"k1_hat": -0.08}])
@pytest.mark.parametrize("grey", [1, 20, 255])
def test_cameras_far_outside_training_are_written_and_drawn(tmp_path, wild, grey, figures):
    (row,) = calibrate([photo(tmp_path / "a.png", (160, 40), grey)], tmp_path / "out", Fake(**wild), undistort="all")
    assert row["focal_px"] > 0
    assert Image.open(tmp_path / "out" / "a_overlay.png").width > 100


def test_photos_of_one_name_do_not_overwrite_each_other(tmp_path):
    paths = [photo(tmp_path / name) for name in ("a.png", "a.jpg", "x/a.png", "y/A.png", "y/a.jpg")]
    calibrate(paths, tmp_path / "out", undistort="none")
    assert len(list((tmp_path / "out").glob("*_overlay.png"))) == 5


AS_ROOT = os.getuid() == 0  # who may read all, unless that is given up


@pytest.mark.skipif(AS_ROOT and shutil.which("setpriv") is None, reason="root may read all, and there is no setpriv")
def test_a_folder_that_may_not_be_read_is_named(tmp_path):
    photo(tmp_path / "a.png")
    (tmp_path / "shut").mkdir()
    photo(tmp_path / "shut" / "b.png")
    (tmp_path / "shut").chmod(0)
    unprivileged = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search", "--inh-caps", "-all"] * AS_ROOT
    looks = "from sextant.data.photo_files import find_photos; import sys; print(find_photos(sys.argv[1], None))"
    done = subprocess.run(
        [*unprivileged, sys.executable, "-c", looks, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert "a.png" in done.stdout
    assert "b.png" not in done.stdout
    assert "left out, as it cannot be read: shut" in done.stderr
