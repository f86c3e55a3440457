import json
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from cli.photo_calibration.fakes import Fake, photo

from sextant.applications import PhotoCalibrator
from sextant.chapters.calibration.clip import MOST
from sextant.chapters.calibration.commands import Calibration
from sextant.data.photo_files import find_photos
from sextant.errors import UserError


@pytest.fixture
def predict(monkeypatch):
    """Calibrate by a network that says what is written into a picture."""
    monkeypatch.setattr(PhotoCalibrator, "of", lambda *args, **options: PhotoCalibrator(Fake(), "network"))
    trained = SimpleNamespace(content={}, found=SimpleNamespace(checkpoint=None), trust=False)

    def run(path, output, **given):
        Calibration().predict_photos({"input": str(path), **given}, trained, [path], output)
        return json.loads((output / "calibrations.json").read_text())

    return run


def clip(path, greys):
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 5.0, (80, 60))
    for grey in greys:
        video.write(np.full((60, 80, 3), grey, np.uint8))
    video.release()
    return path


def test_the_frames_of_a_video_are_of_one_camera(predict, tmp_path, capsys):
    found = predict(clip(tmp_path / "clip.avi", [70, 71, 70, 71]), tmp_path)
    assert [row["file"] for row in found["photos"]] == [
        str(tmp_path / "frames" / f"clip_frame_{number:06d}.jpg") for number in range(4)
    ]
    assert len({round(row["focal_px"], 6) for row in found["photos"]}) == 1
    assert found["camera"]["photos"] == 4
    assert "clip.avi: 4 of 4 frames\n" in capsys.readouterr().out


def test_one_frame_is_not_said_to_agree(predict, tmp_path, capsys):
    predict(clip(tmp_path / "clip.avi", [70]), tmp_path, undistort="none")
    told = " ".join(capsys.readouterr().out.split())
    assert "One camera from 1 of 1 photo: no other photo confirms it" in told
    assert "p = " not in told


def test_frames_that_were_written_are_photos_only_if_their_folder_is_given(predict, tmp_path, caplog):
    (photos := tmp_path / "photos").mkdir()
    photo(photos / "a.png")
    output = photos / "found"
    output.mkdir()
    predict(clip(photos / "clip.avi", [70, 70]), output, undistort="none")
    frames = [output / "frames" / f"clip_frame_{number:06d}.jpg" for number in range(2)]
    assert find_photos(str(photos), output) == [photos / "a.png"]
    assert "left out 1 video, such as clip.avi: to calibrate its camera, give it by itself" in caplog.text
    assert find_photos(str(output / "frames"), output) == frames
    (moved := tmp_path / "frames").mkdir()
    photos = photos.rename(moved / "trip")
    assert find_photos(str(photos), photos / "found") == [photos / "a.png"]


@pytest.mark.parametrize("given", ["clips", "clips/*", "clips/*.avi"])
def test_a_folder_of_videos_says_to_give_one(tmp_path, given):
    (tmp_path / "clips").mkdir()
    clip(tmp_path / "clips" / "clip.avi", [70])
    with pytest.raises(UserError, match=r"no photo there, but 1 video, such as clip\.avi: to calibrate its"):
        find_photos(str(tmp_path / given), None)


def test_every_nth_frame_by_itself(predict, tmp_path):
    path = clip(tmp_path / "clip.avi", [60, 10, 80, 10, 60])
    found = predict(path, tmp_path, camera="each", every="2", undistort="none")
    assert [row["focal_px"] for row in found["photos"]] == pytest.approx([36, 48, 36], rel=0.04)
    assert found["camera"] is None


def test_a_long_video_is_thinned(predict, tmp_path, capsys):
    long = clip(tmp_path / "long.avi", [70] * (2 * MOST + 1))
    found = predict(long, tmp_path, camera="each", undistort="none")
    assert len(found["photos"]) == len(range(0, 2 * MOST + 1, 3))
    assert f"of {2 * MOST + 1} frames, one of every 3\n" in capsys.readouterr().out


def test_frames_that_a_video_left_before_are_removed_and_those_of_others_stay(predict, tmp_path):
    options = {"camera": "each", "undistort": "none"}
    predict(clip(tmp_path / "other.avi", [70]), tmp_path, **options)
    predict(clip(tmp_path / "clip.avi", [70, 70, 70]), tmp_path, **options)
    predict(clip(tmp_path / "clip.avi", [70, 70]), tmp_path, **options)
    assert sorted(path.name for path in (tmp_path / "frames").iterdir()) == [
        "clip_frame_000000.jpg", "clip_frame_000001.jpg", "other_frame_000000.jpg",
    ]  # fmt: skip


def test_a_zoom_within_a_video_is_told(predict, tmp_path):
    found = predict(clip(tmp_path / "clip.avi", [50, 51, 52, 50, 51, 90, 91, 92]), tmp_path, undistort="none")
    told = " ".join([*found["camera"]["doubts"], *(r for row in found["photos"] for r in row["confidence"]["reasons"])])
    assert "disagree" in told


def test_every_is_for_videos(predict, tmp_path):
    with pytest.raises(UserError, match="every=2 applies to a video"):
        predict(photo(tmp_path / "a.png"), tmp_path, every="2")
