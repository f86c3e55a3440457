import cv2
import numpy as np
import pytest

from sextant.data.videos import Video, is_video
from sextant.errors import UserError


def clip(path, greys, size=(48, 32)):
    """A video of grey frames."""
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 5.0, size)
    for grey in greys:
        video.write(np.full((size[1], size[0], 3), grey, np.uint8))
    video.release()
    return path


def test_every_nth_frame_is_read_with_its_time(tmp_path):
    video = Video.open(clip(tmp_path / "clip.avi", range(40, 180, 20)), 3)
    assert (video.names, len(video)) == (("frame 0", "frame 3", "frame 6"), 3)
    assert video.times_s == pytest.approx([0, 0.6, 1.2])
    assert [frame.image.mean() for frame in video.read(None)] == pytest.approx([40, 100, 160], abs=2)
    assert [frame.image.shape for frame in video.read((16, 24, 1))] == [(16, 24, 1)] * 3


def test_what_is_no_video_is_refused(tmp_path):
    (tmp_path / "clip.mp4").write_bytes(b"nothing")
    assert is_video(tmp_path / "clip.mp4")
    with pytest.raises(UserError, match=r"cannot be read as a video \(7 bytes\)"):
        Video.open(tmp_path / "clip.mp4", 1)
    assert not is_video(tmp_path)
    assert not is_video(tmp_path / "photo.jpg")
