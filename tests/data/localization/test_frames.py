from pathlib import Path

import pytest
from PIL import Image

from sextant.chapters.localization.data.frames import find_frames
from sextant.chapters.localization.data.pose_times import times_of_names


@pytest.fixture
def photos(tmp_path):
    for number in range(3):
        Image.new("RGB", (8, 8)).save(tmp_path / f"cam1.0_{number:04d}.png")
    return tmp_path


def test_one_number_in_all_names_is_no_time(photos, tmp_path):
    assert find_frames(str(photos), tmp_path / "out", 1).times_s is None
    assert times_of_names([Path("1.25.png")]).tolist() == [1.25]
    assert times_of_names([Path("1.25.png"), Path("1.50.png")]).tolist() == [1.25, 1.5]


def test_a_pattern_over_several_folders(photos, tmp_path, monkeypatch):
    for drive in ("a", "b"):
        (tmp_path / drive).mkdir()
        Image.new("RGB", (32, 32), "red").save(tmp_path / drive / "1.png")
    absolute = find_frames(str(tmp_path / "*" / "*.png"), tmp_path / "out", 1)
    assert absolute.names == ("a/1.png", "b/1.png")
    monkeypatch.chdir(tmp_path.parent)
    relative = find_frames(f"{tmp_path.name}/*/*.png", tmp_path / "out", 1)
    assert relative.names == tuple(f"{tmp_path.name}/{name}" for name in absolute.names)
    for frames in (absolute, relative):
        assert [frame.image.shape for frame in frames.read(None)] == [(32, 32, 3)] * 2


def test_the_picture_of_an_earlier_trajectory_is_no_photo(photos, tmp_path):
    Image.new("RGB", (8, 8)).save(photos / "trajectory.png")
    assert "trajectory.png" in find_frames(str(photos), tmp_path / "out", 1).names
    (photos / "poses.csv").write_text("written when this folder was the output")
    assert "trajectory.png" not in find_frames(str(photos), tmp_path / "out", 1).names
