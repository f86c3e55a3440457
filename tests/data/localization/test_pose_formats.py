"""Files of poses, and poses in space in a plane."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from sextant.chapters.localization.data.pose_formats import (
    STEEPEST_DEG,
    read_tum,
    read_tum_matrices,
    to_plane,
    write_tum,
)
from sextant.chapters.localization.data.pose_times import check_gaps, check_rising, poses_at, times_of_names
from sextant.errors import UserError
from sextant.worlds.trajectories import load_kitti_poses

finite = st.floats(-1e6, 1e6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("tum")


@given(arrays(np.float64, (5, 2), elements=finite), arrays(np.float64, 5, elements=st.floats(-np.pi, 3.1415)))
def test_what_is_written_is_read_again(folder, xy, heading):
    poses, times = np.column_stack([xy, heading]), 1.6e9 + np.arange(5) / 3
    write_tum(folder / "a.txt", times, poses)
    told_times, told = read_tum(folder / "a.txt")
    assert np.array_equal(told_times, times)
    assert np.array_equal(told[:, :2], poses[:, :2])
    assert np.abs(np.exp(1j * told[:, 2]) - np.exp(1j * heading)).max() < 1e-12


def test_evo_reads_what_is_written(folder):
    evo = pytest.importorskip("evo.tools.file_interface")
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.normal(0, 30, (9, 2)), rng.uniform(-3, 3, 9)])
    write_tum(folder / "b.txt", 1e9 + np.arange(9.0), poses)
    read = evo.read_tum_trajectory_file(folder / "b.txt")
    assert np.array_equal(read.positions_xyz[:, :2], poses[:, :2])
    matrices = np.array(read.poses_se3)
    assert np.allclose(np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0]), poses[:, 2])
    _, ours = read_tum_matrices(folder / "b.txt")
    assert np.allclose(ours, matrices, atol=1e-12)


def test_quaternions_are_rotations(folder):
    rotations = Rotation.random(20, random_state=0)
    table = np.column_stack([np.arange(20), np.zeros((20, 3)), 1.004 * rotations.as_quat()])
    np.savetxt(folder / "c.txt", table, fmt="%.12f", header="timestamp tx ty tz qx qy qz qw")
    _, poses = read_tum_matrices(folder / "c.txt")
    assert np.allclose(poses[:, :3, :3], rotations.as_matrix(), atol=1e-9)


GOOD = "1.0 0 0 0 0 0 0 1"


@pytest.mark.parametrize(
    ("lines", "told"),
    [([], "has no poses"), (["# only a comment"], "has no poses"), ([GOOD, "2.0 1 2 3"], "line 2: 8 finite numbers"),
     ([GOOD, "2.0 nan 0 0 0 0 0 1"], "line 2: 8 finite"), (["2,0,0,0,0,0,0,1"], "line 1: 8 finite"),
     ([GOOD, "2.0 0 -1e160 3.4e38 0 0 0 1"], r"line 2: the position \(0, -1e\+160, 3.4e\+38\) is further away than"),
     ([GOOD, "2.0 0 0 0 0 0 0 0"], "line 2: the quaternion has length 0"),
     ([GOOD, "# a comment", "1.0 0 0 0 0 0 0 1"], r"line 3: time 1.000000 is not after 1.000000 of line 1"),
     ([GOOD, "0.5 0 0 0 0 0 0 1"], "time 0.500000 is not after"),
     (["1 0 0 0 0 0.7071068 0 0.7071068"], "nearly perpendicular")],
)  # fmt: skip
def test_a_damaged_file_is_told_with_its_lines(folder, lines, told):
    path = folder / "d.txt"
    path.write_text("\n".join(lines))
    with pytest.raises(UserError, match=told) as error:
        read_tum(path)
    assert "d.txt" in str(error.value)


def test_a_missing_or_binary_file_is_told(folder):
    with pytest.raises(UserError, match=r"nothing\.txt does not exist"):
        read_tum(folder / "nothing.txt")
    (folder / "e.txt").write_bytes(b"\x7fELF\xff\x00\x81")
    with pytest.raises(UserError, match=r"e\.txt cannot be read"):
        read_tum(folder / "e.txt")
    with pytest.raises(Exception, match=r"2 times for 3 poses|poses"):  # type checks, where they are on, come first
        write_tum(folder / "f.txt", np.zeros(2), np.zeros((3, 3)))


# -- planes ------------------------------------------------------------------------------------------------------------


def pose(axis_ahead, ahead="z", position=(1.0, 2.0, 3.0)):
    """A pose whose z (or x) axis points along ``axis_ahead``, rolled at random."""
    first = np.asarray(axis_ahead, float) / np.linalg.norm(axis_ahead)
    other = np.cross(first, np.random.default_rng(0).normal(size=3))
    other /= np.linalg.norm(other)
    third = np.cross(first, other)
    matrix = np.eye(4)
    columns = (other, third, first) if ahead == "z" else (first, other, third)
    matrix[:3, :3], matrix[:3, 3] = np.column_stack(columns), position
    return matrix


@given(st.floats(-3.1, 3.1), st.floats(-1.2, 1.2), st.sampled_from(["x", "z"]), st.sampled_from(["xy", "xz", "yz"]))
def test_heading_is_that_of_the_axis_ahead_whatever_its_tilt_and_roll(heading, tilt, ahead, plane):
    u, v = ("xyz".index(letter) for letter in plane)
    axis = np.zeros(3)
    axis[u], axis[v], axis[3 - u - v] = np.cos(tilt) * np.cos(heading), np.cos(tilt) * np.sin(heading), np.sin(tilt)
    matrix = pose(axis, ahead)[None]
    assert to_plane(matrix, plane, ahead, "p")[0] == pytest.approx([matrix[0, u, 3], matrix[0, v, 3], heading])


def test_a_camera_that_looks_along_the_normal_has_no_heading():
    up = np.stack([pose([1, 0, 0]), pose([0, 0.05, 1])])
    with pytest.raises(UserError, match=r"1 of 2 poses is nearly perpendicular(.|\n)*pose 2: 87 degrees"):
        to_plane(up, "xy", "z", "poses.txt")
    assert to_plane(up, "yz", "x", "p").shape == (2, 3)
    edge = np.radians(STEEPEST_DEG)
    assert len(to_plane(pose([np.cos(edge - 1e-6), 0, np.sin(edge - 1e-6)])[None], "xy", "z", "p")) == 1
    with pytest.raises(UserError):
        to_plane(pose([np.cos(edge + 1e-6), 0, np.sin(edge + 1e-6)])[None], "xy", "z", "p")


@pytest.mark.real_data
def test_a_kitti_car_drives_where_its_camera_looks(real_data):
    poses = load_kitti_poses(real_data / "kitti" / "poses" / "07.txt")
    flat = to_plane(poses, "xz", "z", "07")
    assert flat[0] == pytest.approx([0, 0, np.pi / 2], abs=1e-6)
    step = flat[1:, :2] - flat[:-1, :2]
    moving = np.linalg.norm(step, axis=1) > 0.3
    aside = np.angle(np.exp(1j * (np.arctan2(step[:, 1], step[:, 0]) - flat[:-1, 2])))[moving]
    assert np.abs(np.degrees(aside)).max() < 15  # a car's camera, ahead of its axle, drifts aside in bends
    assert np.median(np.abs(np.degrees(aside))) < 1
    with pytest.raises(UserError, match=r"plane=xz"):
        to_plane(poses, "xy", "z", "07")


# -- times -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "seconds"),
    [("1305031102.175304.png", 1305031102.175304), ("t1152907051.038043_x0.2_y0.1.jpeg", 1152907051.038043),
     ("1403636579763555584.png", 1403636579.7635556), ("1418381798086398.jpg", 1418381798.086398),
     ("frame_000123.png", None), ("20240102.png", None), ("a.png", None)],
)  # fmt: skip
def test_times_in_names(name, seconds):
    found = times_of_names([Path(name)])
    assert (found is None) == (seconds is None)
    assert found is None or found == pytest.approx(seconds, abs=1e-6)


def test_poses_between_two_are_interpolated_the_shorter_way_round():
    times = np.array([10.0, 11.0, 13.0])
    poses = np.array([[0, 0, 3.0], [2, 0, -3.0], [2, 4, -3.0]])
    found = poses_at(times, poses, np.array([10.0, 10.5, 12.0, 13.0]), list("abcd"), None, "k")
    assert found[:, :2].tolist() == [[0, 0], [1, 0], [2, 2], [2, 4]]
    assert np.allclose(np.exp(1j * found[:, 2]), np.exp(1j * np.array([3.0, np.pi, -3.0, -3.0])))
    assert np.abs(found[:, 2]).max() <= np.pi


@given(arrays(np.float64, 30, elements=st.floats(0.01, 5.0)))
def test_at_the_times_of_the_poses_they_are_themselves(steps):
    times = np.cumsum(steps)
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.normal(size=(30, 2)), rng.uniform(-3, 3, 30)])
    assert np.allclose(poses_at(times, poses, times, ["n"] * 30, 0.001, "k"), poses, atol=1e-9)


def test_images_without_a_pose_at_their_time_are_named():
    times, poses = np.array([0.0, 1.0, 4.0]), np.zeros((3, 3))
    wanted = np.array([-0.5, 0.5, 2.0, 4.0, 5.0])
    with pytest.raises(UserError, match=r"k: 3 of 5 images(.|\n)*a at -0.5(.|\n)*c at 2.0(.|\n)*e at 5.0") as error:
        poses_at(times, poses, wanted, list("abcde"), 2.0, "k")
    assert "d at" not in str(error.value)
    assert len(poses_at(times[:1], poses[:1], np.array([0.0]), ["a"], 2.0, "k")) == 1
    with pytest.raises(UserError, match="1 of 1 image"):
        poses_at(times[:1], poses[:1], np.array([0.1]), ["a"], 2.0, "k")


def test_images_out_of_order_and_gaps_name_the_images():
    with pytest.raises(UserError, match=r"out of order: c at 2.0\d* s comes after b at 3.0"):
        check_rising(np.array([1.0, 3.0, 2.0, 4.0]), list("abcd"), "k")
    check_rising(np.array([1.0, 2.0]), list("ab"), "k")
    with pytest.raises(UserError, match=r"1 gaps in time above max_gap_s=2\n  b to c: 3.000 s"):
        check_gaps(np.array([1.0, 3.0, 6.0]), list("abc"), 2.0, "k")
