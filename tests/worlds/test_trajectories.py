import json

import numpy as np
import pytest

from sextant.errors import UserError
from sextant.worlds.trajectories import load_cold, load_kitti_poses, plane_positions

IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0"


def sequence(**changes):
    content = {
        "im_paths": ["t10.5_x0.jpeg", "t11.0_x0.jpeg"],
        "poses": [[0, -1, 0, 2, 1, 0, 0, 3, 0, 0, 1, 0], [1, 0, 0, 4, 0, 1, 0, 5, 0, 0, 1, 0]],
        "odom_poses": [[0, 0, 0], [1, 2, 0.5]],
    }
    return {key: value for key, value in (content | changes).items() if value is not None}


def written(tmp_path, content):
    path = tmp_path / "poses"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_kitti_poses_are_read_row_by_row(tmp_path):
    poses = load_kitti_poses(written(tmp_path, f"{IDENTITY}\n1 0 0 3 0 1 0 4 0 0 1 5\n"))
    assert np.array_equal(poses[0], np.eye(4))
    assert plane_positions(poses).tolist() == [[0, 0], [3, 5]]


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("", "empty"),
        (f"{IDENTITY}\n1 2 3\n", "line 2: 12 finite numbers"),
        (IDENTITY.replace("1", "x"), "line 1: 12 finite numbers"),
        (IDENTITY.replace("1", "nan"), "line 1: 12 finite numbers"),
        (IDENTITY.replace("1", "2"), "line 1: its 3x3 part is not a rotation"),
    ],
)
def test_a_damaged_kitti_file_is_told(tmp_path, content, told):
    with pytest.raises(UserError, match=told):
        load_kitti_poses(written(tmp_path, content))


@pytest.mark.parametrize("load", [load_kitti_poses, load_cold])
def test_a_missing_file_is_told_with_what_to_do(tmp_path, load):
    with pytest.raises(UserError, match="SEXTANT_DATA"):
        load(tmp_path / "no_such_file")


def test_a_cold_sequence_has_times_headings_and_odometry(tmp_path):
    cold = load_cold(written(tmp_path, sequence()))
    assert cold.times_s.tolist() == [0, 0.5]
    assert cold.poses == pytest.approx(np.array([[2, 3, np.pi / 2], [4, 5, 0]]))
    assert cold.odometry.tolist() == [[0, 0, 0], [1, 2, 0.5]]


def test_a_cold_map_has_neither_times_nor_odometry(tmp_path):
    cold = load_cold(written(tmp_path, sequence(im_paths=["0.png", "1.png"], odom_poses=None)))
    assert cold.times_s is None
    assert cold.odometry is None


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("{", "not json"),
        ("[1, 2]", "lists"),
        (sequence(poses=None), "lists"),
        (sequence(poses=[[1, 2]]), "2 rows of 12"),
        (sequence(poses=[["a"] * 12] * 2), "2 rows of 12"),
        (sequence(odom_poses=[[0, 0, 0]]), '"odom_poses" needs 2 rows of 3'),
        (sequence(im_paths=[], poses=[]), "0 rows"),
    ],
)
def test_a_damaged_cold_file_is_told(tmp_path, content, told):
    with pytest.raises(UserError, match=told):
        load_cold(written(tmp_path, content))


@pytest.mark.real_data
def test_the_real_sequences_are_read(real_data):
    drive, mapped = (load_cold(real_data / "cold" / f"{name}.json") for name in ("seq1_night1", "map"))
    assert (len(drive.poses), len(mapped.poses)) == (1911, 4111)
    assert 398 < drive.times_s[-1] < 399
    # headings of the poses are those that the names of the images state
    named = [float(name.split("_a")[1].removesuffix(".jpeg")) for name in drive.images]
    assert np.abs(np.angle(np.exp(1j * (drive.poses[:, 2] - named)))).max() < 1e-5
    assert len(load_kitti_poses(real_data / "kitti" / "poses" / "00.txt")) == 4541


@pytest.mark.parametrize("mark", ["", "\ufeff", "# r11 r12 ...\n", "\n\n% made by hand\n"])
@pytest.mark.parametrize("end", ["\n", "\r\n", " \n", "\t\r\n", ",\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_kitti_files_of_other_programs(tmp_path, mark, end, encoding):
    lines = [IDENTITY, IDENTITY.replace(" ", "\t"), "", IDENTITY.replace(" ", "  ")]
    (path := tmp_path / "poses").write_bytes((mark + end.join(lines) + end).encode(encoding))
    assert np.array_equal(load_kitti_poses(path), np.tile(np.eye(4), (3, 1, 1)))


def test_lines_are_counted_with_comments(tmp_path):
    (path := tmp_path / "poses").write_text(f"# a\n\n{IDENTITY}\n{IDENTITY.replace('1', 'inf')}\n")
    with pytest.raises(UserError, match="line 4: 12 finite numbers are expected, got 12 words: inf 0 0"):
        load_kitti_poses(path)
