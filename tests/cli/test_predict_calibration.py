import csv
import json
import math

import numpy as np
import pytest
import torch
from PIL import Image

from sextant.cli import predict_calibration
from sextant.cli.predict_calibration import (
    CalibrationModel,
    CalibrationOptions,
    TrainedModel,
    find_photos,
    options_from,
    predict_calibrations,
)
from sextant.corruptions import CorruptionSuite
from sextant.errors import UserError
from sextant.geometry import (
    CameraParameters,
    Parameterization,
    ParameterSpace,
    PerspectiveCamera,
    k2_of_k1,
    rho_from_tilt,
    undistort_radius,
)
from sextant.geometry.conversions import colmap_from_perspective, opencv_from_perspective
from sextant.losses import ParameterLoss
from sextant.models import CalibrationNet
from sextant.tasks.calibration import Calibration, CalibrationPrediction, CalibrationSpec, reported

SCALE = (0.02, 0.01, 0.03, 0.05)
SPREAD = (0.2, 0.1, 0.3, 0.4)


class Fake:
    """A network that says what is written into the photo: grey value g is focal length g / 100 of the part it sees."""

    input_width, input_height, k2_of_k1 = 24, 18, "lopez"
    aspects, spread = (1.0, 4 / 3), SPREAD

    def __init__(self, tilt=0.1, roll=-0.05, k1_hat=-0.3, scale=SCALE, scores=100, place=0.5):
        self.tilt, self.roll, self.k1_hat, self.scale, self.place = tilt, roll, k1_hat, scale, place
        self.scores = torch.linspace(0.02, 2, scores)[:, None].expand(-1, 4)
        self.seen = []

    def predict(self, images, aspect):
        assert images.dtype == torch.uint8
        assert images.shape[1:] == (3, 18, 24)
        self.seen += aspect.tolist()
        focal = images.float().mean((1, 2, 3)) / 100
        camera = CameraParameters(
            torch.full_like(focal, self.tilt), torch.full_like(focal, self.roll), focal, self.k1_hat * focal**2
        )
        return CalibrationPrediction(camera, torch.tensor(self.scale).expand(len(focal), 4), self.scores)

    def position(self, camera):
        return torch.full((len(camera.focal), 4), self.place)


def photo(path, size=(80, 60), grey=70, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, (grey,) * 3).save(path, **options)
    return path


def exif(focal_35mm):
    block = Image.Exif()
    block.get_ifd(0x8769)[0xA405] = focal_35mm
    return block


def calibrate(paths, output, model=None, **options):
    return predict_calibrations(model or Fake(), paths, output, CalibrationOptions(**options))


def camera_of(row):
    return PerspectiveCamera(
        torch.tensor(row["focal_px"] / row["height"], dtype=torch.float64),
        torch.tensor(row["k1"], dtype=torch.float64),
        torch.tensor(row["k2"], dtype=torch.float64),
        row["width"],
        row["height"],
    )


@pytest.fixture(autouse=True)
def drawn(request, monkeypatch):
    """Figures take most of the time: only tests that take ``figures`` draw them."""
    if "figures" in request.fixturenames:
        return
    monkeypatch.setattr(
        "sextant.figures.style.save_figure", lambda figure, folder, name: (folder / f"{name}.png").touch()
    )


@pytest.fixture
def figures():
    """Ask for real figures."""


# -- one photo ---------------------------------------------------------------------------------------------------------


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


def test_other_programs_conventions_are_those_of_the_conversions(tmp_path):
    (row,) = calibrate([photo(tmp_path / "a.png", (161, 120))], tmp_path / "out")
    matrix, distortion = opencv_from_perspective(camera_of(row))
    np.testing.assert_allclose(row["opencv"]["matrix"], matrix)
    np.testing.assert_allclose(row["opencv"]["distortion"], distortion)
    np.testing.assert_allclose(row["colmap"]["parameters"], colmap_from_perspective(camera_of(row)))


@pytest.mark.parametrize("size", [(80, 60), (60, 80), (200, 60), (64, 64), (97, 41)])
def test_parameters_are_mapped_back_to_the_whole_photo(tmp_path, size):
    model = Fake()
    (row,) = calibrate([photo(tmp_path / "a.png", size)], tmp_path / "out", model)
    width, height = size
    part = min(height, width / model.seen[0])
    assert row["focal_px"] == pytest.approx(0.7 * part, rel=1e-5)
    assert row["seen"]["height"] == pytest.approx(part)
    assert row["seen"]["left"] == pytest.approx((width - row["seen"]["width"]) / 2)
    assert row["vfov_deg"] == pytest.approx(math.degrees(2 * math.atan(height / 2 / row["focal_px"])))
    # the field of view with distortion is the angle between the rays at the middles of the edges
    edges = torch.tensor([[0, height / 2], [width, height / 2], [width / 2, 0], [width / 2, height]]).double()
    left, right, top, bottom = camera_of(row).bearings(edges)
    assert row["true_hfov_deg"] == pytest.approx(math.degrees(math.acos(left @ right)))
    assert row["true_vfov_deg"] == pytest.approx(math.degrees(math.acos(top @ bottom)))


def test_a_photo_turned_by_exif_is_that_of_the_upright_one(tmp_path):
    turned = Image.Exif()
    turned[0x0112] = 6
    upright = calibrate([photo(tmp_path / "a.png", (60, 80))], tmp_path / "1")[0]
    rotated = calibrate([photo(tmp_path / "b.png", (80, 60), exif=turned)], tmp_path / "2")[0]
    assert rotated["exif_orientation"] == 6
    for key in ("focal_px", "width", "height", "opencv", "seen", "intervals"):
        assert rotated[key] == upright[key]


def test_intervals_are_scale_times_the_conformal_multiplier(tmp_path):
    model = Fake()
    (row,) = calibrate([photo(tmp_path / "a.png")], tmp_path / "out", model)
    for name, level in (("68", 0.68), ("95", 0.95)):
        half = np.array(SCALE) * float(model.scores[math.ceil(101 * level) - 1, 0])
        said = row["intervals"][name]
        np.testing.assert_allclose(np.radians(said["tilt_deg"]), [0.1 - half[0], 0.1 + half[0]], rtol=1e-5)
        np.testing.assert_allclose(np.radians(said["roll_deg"]), [-0.05 - half[1], -0.05 + half[1]], rtol=1e-5)
        vfov = 2 * math.atan(0.5 / 0.7)
        np.testing.assert_allclose(np.radians(said["vfov_deg"]), [vfov - half[2], vfov + half[2]], rtol=1e-5)
        focal = 60 / 2 / np.tan(np.radians(said["vfov_deg"]) / 2)
        np.testing.assert_allclose(said["focal_px"], focal[::-1], rtol=1e-5)
        np.testing.assert_allclose(np.array(said["k1"]) / 0.49, [-0.3 - half[3], -0.3 + half[3]], rtol=1e-5)


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


# -- trust -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "size", "verdict", "says"),
    [
        (Fake(), (80, 60), "good", None),
        (Fake(scale=(0.12, 0.01, 0.03, 0.05)), (80, 60), "weak", "tilt: 68 % interval"),
        (Fake(scale=(0.02, 0.01, 0.03, 0.5)), (80, 60), "not trustworthy", "apparent distortion: 68 % interval"),
        (Fake(scores=1), (80, 60), "not trustworthy", "field of view: 68 % interval ±inf"),
        (Fake(scale=(float("nan"), 0.01, 0.03, 0.05)), (80, 60), "not trustworthy", "tilt"),
        (Fake(), (400, 60), "weak", "saw only 20% of the photo"),
        (Fake(), (32, 32), "good", None),
        (Fake(place=0.995), (80, 60), "weak", "at the end of what the network was trained on"),
        (Fake(place=float("nan")), (80, 60), "weak", "at the end"),
    ],
)
def test_low_confidence_is_said(tmp_path, capsys, model, size, verdict, says):
    (row,) = calibrate([photo(tmp_path / "a.png", size)], tmp_path / "out", model)
    assert row["confidence"]["verdict"] == verdict
    text = " ".join(row["confidence"]["reasons"])
    assert (says in text) if says else text == ""
    json.loads((tmp_path / "out" / "a.json").read_text(), parse_constant=pytest.fail)  # no NaN or Infinity


def test_a_photo_smaller_than_the_input_is_weak(tmp_path, monkeypatch):
    monkeypatch.setattr(Fake, "input_width", 24)
    model = Fake()
    model.input_width, model.input_height = 40, 36
    model.predict = lambda images, aspect: Fake.predict(Fake(), images[:, :, :18, :24], aspect)
    (row,) = calibrate([photo(tmp_path / "a.png", (32, 32))], tmp_path / "out", model)
    assert row["confidence"]["verdict"] == "weak"
    assert "32x32 pixels are fewer than the 40x36" in row["confidence"]["reasons"][0]


def test_a_focal_length_by_exif_that_disagrees_is_told_though_not_used(tmp_path):
    agrees = photo(tmp_path / "a.jpg", exif=exif(24))  # 24 mm of 43.3: 55 px on this diagonal; the network says 42
    (row,) = calibrate([agrees], tmp_path / "out")
    assert row["exif_focal_px"] == pytest.approx(24 * 100 / math.hypot(36, 24))
    assert row["focal_px"] == pytest.approx(42, rel=1e-5)
    assert "EXIF tells a focal length of 55 px, outside the 95 % interval" in row["confidence"]["reasons"]


# -- failures ----------------------------------------------------------------------------------------------------------


def test_a_photo_that_fails_is_named_and_the_rest_go_on(tmp_path, capsys):
    good, bad, small = photo(tmp_path / "a.png"), tmp_path / "b.jpg", photo(tmp_path / "c.png", (1, 1))
    bad.write_bytes(b"nothing")
    rows = calibrate([good, bad, small], tmp_path / "out")
    assert ["error" in row for row in rows] == [False, True, True]
    said = capsys.readouterr().out
    assert "1 photos calibrated, 2 failed" in said
    assert "b.jpg cannot be read" in " ".join(said.split())
    lines = list(csv.DictReader((tmp_path / "out" / "calibrations.csv").open()))
    assert [bool(line["error"]) for line in lines] == [False, True, True]


def test_if_all_fail_the_command_fails_and_the_files_say_why(tmp_path):
    with pytest.raises(UserError, match=r"none of 1 photos.*1x1 pixels"):
        calibrate([photo(tmp_path / "c.png", (1, 1))], tmp_path / "out")
    assert "error" in json.loads((tmp_path / "out" / "calibrations.json").read_text())["photos"][0]


@pytest.mark.parametrize("broken", [{"tilt": float("nan")}, {"tilt": 1.6}, {"k1_hat": float("inf")}])
def test_a_prediction_that_is_no_camera_is_an_error_of_that_photo(tmp_path, broken):
    with pytest.raises(UserError, match="what the network predicts is no camera"):
        calibrate([photo(tmp_path / "a.png")], tmp_path / "out", Fake(**broken))


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


# -- priors and photos of one camera -----------------------------------------------------------------------------------


def offset(row):
    """Where the horizon is seen, in pixels."""
    focal, tilt = torch.tensor(row["focal_px"]).double(), torch.tensor(math.radians(row["tilt_deg"])).double()
    return float(rho_from_tilt(tilt, focal, torch.tensor(row["k1"]).double(), torch.tensor(row["k2"]).double()))


@pytest.mark.parametrize("size", [(80, 60), (60, 80)])
def test_a_prior_moves_the_focal_length_and_keeps_the_picture(tmp_path, size):
    path = photo(tmp_path / "a.png", size)
    (free,) = calibrate([path], tmp_path / "1")
    (held,) = calibrate([path], tmp_path / "2", focal_prior=60.0)
    assert abs(math.log(held["focal_px"] / 60)) < 0.5 * abs(math.log(free["focal_px"] / 60))
    assert held["k1_hat"] == pytest.approx(free["k1_hat"], rel=1e-5)  # seen distortion
    assert offset(held) == pytest.approx(offset(free), rel=1e-5)  # seen horizon
    assert np.ptp(held["intervals"]["68"]["focal_px"]) < np.ptp(free["intervals"]["68"]["focal_px"])
    assert any("disagree" in reason for reason in held["confidence"]["reasons"])


def test_a_prior_that_agrees_changes_little_and_is_not_doubted(tmp_path):
    (held,) = calibrate([photo(tmp_path / "a.png")], tmp_path / "out", focal_prior=42.3)
    assert held["focal_px"] == pytest.approx(42.2, abs=0.2)
    assert held["confidence"] == {**held["confidence"], "verdict": "good", "reasons": []}
    assert held["intervals_by"].startswith("focal_prior=42.3")


def test_exif_as_a_prior(tmp_path):
    told, silent = photo(tmp_path / "a.jpg", exif=exif(20)), photo(tmp_path / "b.jpg")
    rows = calibrate([told, silent], tmp_path / "out", focal_prior="exif")
    assert 42.1 < rows[0]["focal_px"] < rows[0]["exif_focal_px"] == pytest.approx(46.2, abs=0.1)
    assert rows[1]["focal_px"] == pytest.approx(42, abs=0.1)
    assert "EXIF tells no focal length: none was used" in rows[1]["confidence"]["reasons"]


def test_photos_of_one_camera_get_one_camera(tmp_path):
    greys = (68, 70, 71, 73)
    paths = [photo(tmp_path / f"{g}.png", grey=g) for g in greys]
    paths.append(photo(tmp_path / "less.png", (64, 48), grey=70))  # the same camera, scaled down
    rows = calibrate(paths, tmp_path / "out", camera="one")
    assert len({round(row["focal_px"] / row["width"], 9) for row in rows}) == 1
    assert len({round(row["k1"], 9) for row in rows}) == 1
    assert rows[0]["focal_px"] == pytest.approx(60 * 0.705, rel=0.01)
    summary = json.loads((tmp_path / "out" / "calibrations.json").read_text())["camera"]
    assert summary["consistent"]
    assert summary["left_out"] == []
    alone = calibrate(paths[:1], tmp_path / "alone")[0]
    assert np.ptp(rows[0]["intervals"]["68"]["focal_px"]) < np.ptp(alone["intervals"]["68"]["focal_px"])


def test_portrait_and_landscape_photos_of_one_camera_agree(tmp_path):
    # the portrait photo is cut to 60 x 60: its focal length of 42 px is 0.7 of that part's height too
    paths = [photo(tmp_path / "a.png", (80, 60)), photo(tmp_path / "b.png", (60, 80)), photo(tmp_path / "c.png")]
    rows = calibrate(paths, tmp_path / "out", camera="one")
    assert [row["focal_px"] for row in rows] == pytest.approx([42, 42, 42], rel=1e-4)
    summary = json.loads((tmp_path / "out" / "calibrations.json").read_text())["camera"]
    assert summary["chi_square"] == pytest.approx(0, abs=1e-4)


def test_one_photo_of_another_camera_is_left_out_and_named(tmp_path, capsys):
    paths = [photo(tmp_path / f"{i}.png", grey=g) for i, g in enumerate((69, 70, 130, 71))]
    rows = calibrate(paths, tmp_path / "out", camera="one")
    summary = json.loads((tmp_path / "out" / "calibrations.json").read_text())["camera"]
    assert summary["left_out"] == [str(paths[2])]
    assert rows[2]["focal_px"] == pytest.approx(78, rel=0.01)
    assert any("left out of the fusion" in reason for reason in rows[2]["confidence"]["reasons"])
    assert "from 3 of 4 photos" in " ".join(capsys.readouterr().out.split())


def test_photos_that_do_not_agree_are_said_to(tmp_path):
    paths = [photo(tmp_path / f"{g}.png", grey=g) for g in (40, 150)]
    rows = calibrate(paths, tmp_path / "out", camera="one")
    assert all(any("disagree more than" in reason for reason in row["confidence"]["reasons"]) for row in rows)


@pytest.mark.parametrize(
    ("sizes", "options", "says"),
    [
        ([(80, 60), (90, 60)], {}, "sides of 1:1.333 and 1:1.500"),
        ([(80, 60), (160, 120)], {"focal_prior": 50.0}, "longer sides of 80 to 160 pixels"),
    ],
)
def test_photos_that_cannot_be_of_one_camera(tmp_path, sizes, options, says):
    paths = [photo(tmp_path / f"{i}.png", size) for i, size in enumerate(sizes)]
    with pytest.raises(UserError, match=says) as raised:
        calibrate(paths, tmp_path / "out", camera="one", **options)
    assert raised.value.fix


def test_nothing_is_fused_without_intervals(tmp_path):
    with pytest.raises(UserError, match="gives no intervals"):
        calibrate([photo(tmp_path / "a.png")], tmp_path / "out", Fake(scores=1), camera="one")


# -- arguments and files -----------------------------------------------------------------------------------------------


def test_options_are_read(tmp_path):
    assert options_from({}) == CalibrationOptions()
    given = {"undistort": "all", "camera": "one", "focal_prior": "812.5", "input": "x"}
    assert options_from(given) == CalibrationOptions("all", "one", 812.5)


@pytest.mark.parametrize(
    "given",
    [{"undistort": "some"}, {"camera": "two"}, *({"focal_prior": v} for v in ("0", "-3", "nan", "inf", "wide"))],
)
def test_wrong_options_are_told(given):
    (key, value), *_ = given.items()
    with pytest.raises(UserError, match=f"{key}={value} must be"):
        options_from(given)


def test_photos_are_found_by_file_folder_or_pattern_and_outputs_are_not(tmp_path):
    a, b = photo(tmp_path / "a.jpg"), photo(tmp_path / "sub" / "b.PNG")
    (tmp_path / "note.txt").write_text("")
    assert find_photos(str(a), tmp_path / "out") == [a]
    assert find_photos(str(tmp_path), tmp_path / "out") == [a, b]
    assert find_photos(str(tmp_path / "*.jpg"), tmp_path / "out") == [a]
    assert find_photos(str(tmp_path / "**" / "*.PNG"), tmp_path / "out") == [b]
    calibrate([a, b], tmp_path)
    assert find_photos(str(tmp_path), tmp_path) == [a, b]
    for nowhere in ("none.jpg", "*.gif", "empty"):
        (tmp_path / "empty").mkdir(exist_ok=True)
        with pytest.raises(UserError, match="no photo there"):
            find_photos(str(tmp_path / nowhere), tmp_path / "out")


def test_many_photos_go_through_in_batches(tmp_path, monkeypatch):
    monkeypatch.setattr(predict_calibration, "BATCH", 2)
    paths = [photo(tmp_path / f"{g}.png", grey=g) for g in (50, 60, 70, 80, 90)]
    rows = calibrate(paths, tmp_path / "out", undistort="none")
    assert [row["focal_px"] for row in rows] == pytest.approx([0.6 * g for g in (50, 60, 70, 80, 90)], rel=1e-5)


def test_a_calibration_module_is_such_a_model(tmp_path):
    torch.manual_seed(0)
    parameterization = Parameterization()
    draws = CameraParameters(*(torch.linspace(a, b, 9) for a, b in ((-0.3, 0.3), (-0.2, 0.2), (0.5, 1.4), (-0.4, 0.0))))
    space = ParameterSpace.covering(parameterization, draws)
    low, high = tuple(space.low.tolist()), tuple(space.high.tolist())
    spec = CalibrationSpec(
        height=18, width=24, aspects=(1.0, 4 / 3), low=low, high=high, validation_crops=100, per_panorama=1,
        median=(0.0, 0.0, 0.8, -0.2), spread=SPREAD,
    )  # fmt: skip
    backbone = torch.nn.Sequential(torch.nn.AdaptiveAvgPool2d(2), torch.nn.Flatten(), torch.nn.Linear(24, 8))
    module = Calibration(
        CalibrationNet(backbone, 8), spec, parameterization, ParameterLoss(space), CorruptionSuite({}, 0)
    )
    module.scores.copy_(torch.linspace(0.02, 2, 100)[:, None])
    model = TrainedModel(module)
    assert isinstance(model, CalibrationModel)
    paths = [photo(tmp_path / "a.png"), photo(tmp_path / "b.png", (60, 80), 20)]
    first, second = calibrate(paths, tmp_path / "out", model)
    assert 0.4 < first["focal_px"] / first["seen"]["height"] < 1.6
    assert first["tilt_deg"] != second["tilt_deg"]
    position = model.position(draws)
    assert position.min() > 0
    assert position.max() < 1


def test_sextants_own_reports_are_in_the_order_that_is_assumed_here():
    camera = CameraParameters(*torch.tensor([0.1, 0.2, 0.7, -0.2]).double())
    tilt, roll, vfov, k1_hat = reported(camera).tolist()
    assert (tilt, roll) == pytest.approx((0.1, 0.2))
    assert vfov == pytest.approx(2 * math.atan(0.5 / 0.7))
    assert k1_hat == pytest.approx(-0.2 / 0.49)
    assert Parameterization().names[1:] == ("roll", "vfov", "k1_hat")
    assert undistort_radius(torch.tensor(0.0), torch.tensor(-0.2), torch.tensor(0.03)) == 0
