import json
import re
from pathlib import Path

import numpy as np
import pytest
from cli.photo_calibration.fakes import Fake, calibrate, photo
from PIL import Image

from sextant.applications import PhotoCalibrator
from sextant.errors import UserError


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


@pytest.mark.slow
def test_portrait_and_landscape_photos_of_one_camera_agree(tmp_path):
    # the portrait photo is cut to 60 x 60: its focal length of 42 px is 0.7 of that part's height too
    paths = [photo(tmp_path / "a.png", (80, 60)), photo(tmp_path / "b.png", (60, 80)), photo(tmp_path / "c.png")]
    rows = calibrate(paths, tmp_path / "out", camera="one")
    assert [row["focal_px"] for row in rows] == pytest.approx([42, 42, 42], rel=1e-4)
    summary = json.loads((tmp_path / "out" / "calibrations.json").read_text())["camera"]
    assert summary["chi_square"] == pytest.approx(0, abs=1e-4)


@pytest.mark.slow
def test_copies_of_a_photo_count_once(tmp_path, capsys):
    paths = [photo(tmp_path / f"{g}.png", grey=g) for g in (69, 71)]
    once = calibrate(paths, tmp_path / "once", camera="one")
    copies = [photo(tmp_path / f"copy {i}.png", grey=71) for i in range(4)]
    rows = calibrate([*paths, *copies], tmp_path / "out", camera="one")
    assert [row["intervals"]["95"]["focal_px"] for row in rows] == [once[0]["intervals"]["95"]["focal_px"]] * 6
    summary = json.loads((tmp_path / "out" / "calibrations.json").read_text())["camera"]
    assert summary["kept"] == [str(path) for path in paths]
    assert "copy 3.png: a copy of" in capsys.readouterr().out


@pytest.mark.slow
def test_one_photo_of_another_camera_is_left_out_and_named(tmp_path, capsys):
    paths = [photo(tmp_path / f"{i}.png", grey=g) for i, g in enumerate((69, 70, 130, 71))]
    rows = calibrate(paths, tmp_path / "out", camera="one")
    summary = json.loads((tmp_path / "out" / "calibrations.json").read_text())["camera"]
    assert summary["left_out"] == [str(paths[2])]
    assert rows[2]["focal_px"] == pytest.approx(78, rel=0.01)
    assert any("left out of the fusion" in reason for reason in rows[2]["confidence"]["reasons"])
    assert "from 3 of 4 photos" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
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


@pytest.mark.parametrize(
    ("first", "second", "alike"),
    [
        (("Apple", "iPhone 7", "", ""), ("Apple", "iPhone 7", "", ""), True),
        (("Apple", "iPhone 7", "", ""), (" Apple\0", "iPhone  7 ", "", ""), True),
        (("Apple", "iPhone 7", "", ""), ("Apple", "iPhone 13", "", ""), False),
        (("Canon", "EOS 5D", "1", ""), ("Canon", "EOS 5D", "2", ""), False),
        (("Canon", "EOS 5D", "1", "EF 50"), ("Canon", "EOS 5D", "1", "EF 85"), False),
        (("", "EOS 5D", "", ""), ("", "EOS 5D", "", ""), True),
    ],
)
def test_cameras_by_exif(tmp_path, first, second, alike):
    from sextant.chapters.calibration.one_camera import _camera_of

    found = []
    for number, (make, model, serial, lens) in enumerate((first, second)):
        exif = Image.Exif()
        exif[0x010F], exif[0x0110] = make, model
        exif.get_ifd(0x8769).update({0xA431: serial, 0xA434: lens})
        Image.new("RGB", (40, 30)).save(tmp_path / f"{number}.jpg", exif=exif)
        found.append(_camera_of(str(tmp_path / f"{number}.jpg")))
    assert all(found)
    assert (found[0] == found[1]) is alike
    assert _camera_of("array 3") == ""


def taken(focal=None, model=None, serial=None):
    """EXIF of a photo by a camera, with a focal length in 35 mm equivalents."""
    block = Image.Exif()
    if model:
        block[0x010F], block[0x0110] = "Maker", model
    inner = {0xA405: focal, 0xA431: serial}
    block.get_ifd(0x8769).update({tag: value for tag, value in inner.items() if value})
    return block


def test_a_photo_in_the_home_folder_is_named_by_its_path(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    path = photo(tmp_path / "a.png")
    (found,) = PhotoCalibrator(Fake(), "network").calibrate_many(["~/a.png"], errors="return")
    assert found.name == str(path)


@pytest.mark.parametrize("known", [False, True])
def test_exif_without_a_focal_length_is_told_of_one_camera_too(tmp_path, known):
    paths = [photo(tmp_path / f"{k}.jpg", grey=70 + k, exif=taken(28 if known and k else None)) for k in range(2)]
    found = PhotoCalibrator(Fake(), "network").one_camera(paths, focal_prior="exif")
    said = "EXIF contains no focal length: none was used"
    assert (said in found.doubts) is not known
    assert all((said in camera.reasons) is not known for camera in found.cameras)
    if not known:
        assert {camera.verdict for camera in found.cameras} == {"good"}


#: photos as (size, grey value, EXIF), and what is said: "" for nothing; "refused: ..." or a doubt
TOGETHER = {
    "one photo": ([((80, 60), 70, None)], ""),
    "of one size": ([((80, 60), 70, None)] * 1 + [((80, 60), 71, None)], ""),
    "upright and lying": ([((80, 60), 70, None), ((60, 80), 70, None)], ""),
    "of one model": ([((80, 60), g, taken(28, "X")) for g in (70, 71)], ""),
    "of one model, told by one": ([((80, 60), 70, taken(28, "X")), ((80, 60), 71, None)], ""),
    "of one model and number": ([((80, 60), g, taken(28, "X", "1")) for g in (70, 71)], ""),
    "of two models": ([((80, 60), 70, taken(28, m)) for m in ("X", "Y")], "refused: 0.jpg was taken with Maker, X"),
    "of two models, far apart": (
        [((80, 60), 70, taken(28, m)) for m in ("X", "X", "X", "Y")], "refused: 3.jpg with Maker, Y, so not"
    ),
    "of two models and sizes": (
        [((80, 60), 70, taken(28, "X")), ((160, 120), 70, taken(28, "Y"))], "refused: not with one camera"
    ),
    "of two of one model": ([((80, 60), 70, taken(28, "X", s)) for s in ("1", "2")], "refused: with Maker, X, 1 and"),
    "one of them smaller": ([((80, 60), 70, None), ((48, 36), 70, None)], "the photos are of 2 sizes (80x60, 48x36)"),
    "one smaller and upright": ([((80, 60), 70, None), ((36, 48), 70, None)], "the photos are of 2 sizes"),
    "three sizes": ([((s * 4, s * 3), 70, None) for s in (12, 20, 30)], "of 3 sizes (120x90, 80x60, 48x36)"),
    "two sizes of one model": ([((s * 4, s * 3), 70, taken(28, "X")) for s in (12, 20)], "the photos are of 2 sizes"),
    "of two sizes that disagree": ([((80, 60), 40, None), ((160, 120), 150, None)], "refused: from several cameras"),
    "of one size that disagree": ([((80, 60), 40, None), ((80, 60), 150, None)], "disagree more than their intervals"),
    "of two sizes and zooms": (
        [((80, 60), 70, taken(28)), ((160, 120), 70, taken(50))], "refused: focal lengths of 0.81 and 1.44 longer"
    ),
    "two sizes, zooms just alike": ([((80, 60), 70, taken(40)), ((160, 120), 70, taken(42))], "are of 2 sizes"),
    "two sizes, zooms just apart": ([((80, 60), 70, taken(40)), ((160, 120), 70, taken(43))], "refused: and lens"),
    "two sizes, one with EXIF": ([((80, 60), 70, taken(28)), ((160, 120), 70, None)], "the photos are of 2 sizes"),
    "of one size, two zooms": ([((80, 60), 70, taken(28)), ((80, 60), 71, taken(50))], "a zoom lens is a different"),
    "shapes just alike": ([((120, 90), 70, None), ((120, 91), 70, None)], "are of 2 sizes (120x91, 120x90)"),
    "shapes just apart": ([((120, 90), 70, None), ((120, 87), 70, None)], "refused: 1:1.333 and 1:1.379"),
    "one cropped": ([((80, 60), 70, taken(28, "X")), ((80, 80), 70, taken(28, "X"))], "refused: or one was cropped"),
}  # fmt: skip


@pytest.mark.parametrize("name", TOGETHER)
def test_photos_are_of_one_camera_or_it_is_said(name, tmp_path, monkeypatch):
    """Boundaries: sizes, shapes within 2 %, models and serial numbers, zooms within 5 %, agreement, EXIF of some."""
    monkeypatch.chdir(tmp_path)
    photos, said = TOGETHER[name]
    paths = [
        photo(Path(f"{k}.jpg"), size, grey, quality=95, **({"exif": exif} if exif is not None else {}))
        for k, (size, grey, exif) in enumerate(photos)
    ]
    calibrator = PhotoCalibrator(Fake(), "network")
    prior = "exif" if "zoom" in said else None
    if said.startswith("refused: "):
        with pytest.raises(UserError, match=re.escape(said.removeprefix("refused: "))) as raised:
            calibrator.one_camera(paths, focal_prior=prior)
        assert raised.value.fix
        return
    found = calibrator.one_camera(paths, focal_prior=prior)
    doubts = "; ".join(found.doubts)
    assert said in doubts
    assert bool(said) is bool(doubts)
    assert len(found.cameras) == len(photos)
    assert len({round(camera.focal_px / max(camera.width, camera.height), 9) for camera in found.cameras}) == 1
