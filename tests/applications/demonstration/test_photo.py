import base64
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from sextant.applications import PhotoCalibrator
from sextant.errors import UserError
from sextant.pages.demo.answers import sample_photo
from sextant.tools.demonstration.photo import _quantities, photo_answer
from sextant.tools.demonstration.pictures import LONGEST, data_address, page_picture


def picture_of(address):
    kind, _, content = address.partition(";base64,")
    return kind, Image.open(io.BytesIO(base64.b64decode(content)))


@pytest.fixture(scope="module")
def calibrator():
    return PhotoCalibrator.load()


@pytest.fixture(scope="module")
def china(tmp_path_factory):
    path = tmp_path_factory.mktemp("photos") / "china.jpg"
    path.write_bytes(sample_photo("china.jpg"))
    return path


@pytest.fixture(scope="module")
def answer(calibrator, china):
    return photo_answer(calibrator, china)


def test_the_numbers_are_those_of_the_calibrator(answer, calibrator, china):
    camera = calibrator.calibrate(china)
    values = {each["name"]: each for each in answer["quantities"]}
    assert values["tilt"]["value"] == pytest.approx(camera.tilt_deg)
    assert values["focal length"]["value"] == pytest.approx(camera.focal_px)
    assert values["focal length"]["95"] == pytest.approx(list(camera.interval_95.focal_px))
    assert values["35 mm equivalent"]["value"] == pytest.approx(camera.focal_px * 36 / 640)
    assert (answer["verdict"], answer["reasons"]) == (camera.verdict, list(camera.reasons))


def test_lines_lie_where_the_camera_has_them(answer, calibrator, china):
    camera = calibrator.calibrate(china)
    (horizon,) = answer["horizon"]
    u, v = np.array(horizon).T
    middle = camera.focal_px / camera.height * np.tan(np.radians(camera.tilt_deg))
    assert np.interp(0, u, v) == pytest.approx(middle, abs=0.01)  # looks up: the horizon is below the middle
    assert answer["horizon_is"] == "in the picture"
    assert all(dv > 0.9 for *_, dv in answer["gravity"])
    assert len(answer["grid"]) > 10


def test_pictures_are_small_and_of_one_size(answer):
    kinds = [picture_of(answer[name]) for name in ("picture", "levelled")]
    assert [kind for kind, _ in kinds] == ["data:image/jpeg", "data:image/webp"]
    assert {picture.size for _, picture in kinds} == {(640, 427)}


def test_an_interval_without_an_end_is_json(calibrator, china):
    camera = calibrator.calibrate(china)
    unbounded = replace(camera, interval_95=replace(camera.interval_95, focal_px=(0.0, math.inf)))
    values = {each["name"]: each for each in json.loads(json.dumps(_quantities(unbounded), allow_nan=False))}
    assert values["focal length"]["95"] == values["35 mm equivalent"]["95"] == [0, None]
    assert None not in values["focal length"]["68"]


def test_a_large_photo_is_shown_small_and_upright(tmp_path):
    image = Image.fromarray(np.random.default_rng(0).integers(0, 256, (300, 2000, 3), np.uint8))
    exif = Image.Exif()
    exif[0x0112] = 6
    image.save(tmp_path / "turned.jpg", exif=exif)
    shown = page_picture(tmp_path / "turned.jpg")
    assert (shown["width"], shown["height"]) == (300, 2000)
    assert picture_of(shown["picture"])[1].size == (LONGEST * 300 // 2000, LONGEST)


def test_a_picture_is_what_it_was(tmp_path):
    grey = np.arange(64, dtype=np.uint8).reshape(8, 8)
    kind, picture = picture_of(data_address(grey))
    assert kind == "data:image/png"
    np.testing.assert_array_equal(np.asarray(picture), grey)


def test_a_strip_is_not_trusted(calibrator, tmp_path):
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (60, 1200, 3), np.uint8)).save(tmp_path / "strip.png")
    found = photo_answer(calibrator, tmp_path / "strip.png")
    assert found["verdict"] == "not trustworthy"
    assert any("a strip of 20:1" in reason for reason in found["reasons"])


def test_what_is_no_photo_is_refused(calibrator, tmp_path):
    (tmp_path / "video.jpg").write_bytes(b"\x00\x00\x00\x18ftypmp42" + bytes(500))
    with pytest.raises(UserError, match="is a video, not a photo"):
        photo_answer(calibrator, tmp_path / "video.jpg")
