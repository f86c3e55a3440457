import numpy as np
import pytest
from data.reconstructions.written import colmap_text, nerfstudio
from scipy.spatial.transform import Rotation

from sextant.chapters.localization.trajectories import compare_trajectories
from sextant.chapters.localization.written_poses import COLUMNS
from sextant.data.reconstructions import read_reconstruction
from sextant.errors import UserError


def poses_along(count, seed=0):
    """A drive in space, a metre a frame, that turns."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    for i in range(1, count):
        step = np.eye(4)
        step[:3, :3] = Rotation.from_rotvec(rng.normal(0, 0.05, 3)).as_matrix()
        step[:3, 3] = 1, 0, 0
        poses[i] = poses[i - 1] @ step
    return poses


def write_tum_file(path, times, poses):
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    np.savetxt(path, np.column_stack([times, poses[:, :3, 3], quaternions]), fmt="%.9f", header="timestamp ...")
    return path


def write_kitti_file(path, poses):
    np.savetxt(path, poses[:, :3].reshape(-1, 12), fmt="%.9e")
    return path


def test_frames_are_joined_by_time_and_a_rigid_motion_is_aligned_away(tmp_path):
    poses, times = poses_along(150), np.arange(150) / 10
    reference = write_tum_file(tmp_path / "a.tum", times, poses)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = Rotation.from_rotvec([0.1, 0.2, 0.7]).as_matrix(), (5, -3, 1)
    kept = np.setdiff1d(np.arange(150), [0, 40, 41, 149])
    estimate = write_tum_file(tmp_path / "b.tum", times[kept] + 0.004, (motion @ poses)[kept])
    found = compare_trajectories(reference, estimate)
    assert (len(found.reference), found.reference_frames, found.estimate_frames) == (146, 150, 146)
    assert found.absolute_m["none"].mean > 3
    assert found.absolute_m["rigid"].max < 1e-6
    assert found.absolute_deg["rigid"].max < 1e-4
    assert found.relative_m.max < 1e-6
    assert found.segments.translation_percent < 1e-6
    assert np.allclose(found.aligned("rigid"), found.reference, atol=1e-6)


def test_a_pose_is_joined_once_to_the_nearest(tmp_path):
    poses = poses_along(4)
    reference = write_tum_file(tmp_path / "a.tum", np.array([0.0, 1.0, 2.0, 3.0]), poses)
    estimate = write_tum_file(tmp_path / "b.tum", np.array([0.9, 0.98, 1.05, 2.5]), poses)
    found = compare_trajectories(reference, estimate, max_gap_s=0.2)
    assert len(found.reference) == 1
    assert np.allclose(found.estimate[0], poses[1], atol=1e-6)
    assert found.relative_m is None


def test_a_straight_line_has_no_alignment_and_says_so(tmp_path):
    poses = np.tile(np.eye(4), (120, 1, 1))
    poses[:, 2, 3] = np.arange(120)
    reference = write_kitti_file(tmp_path / "a.txt", poses)
    longer = poses.copy()
    longer[:, 2, 3] *= 1.02
    found = compare_trajectories(reference, write_kitti_file(tmp_path / "b.txt", longer))
    assert list(found.absolute_m) == ["none"]
    assert found.length_m == pytest.approx(119)
    assert found.segments.translation_percent == pytest.approx(2 * 101 / 100)  # KITTI's segment ends after its length
    assert found.segments.segments == 2
    with pytest.raises(UserError, match="alignment=rigid: the positions lie on a line"):
        found.aligned("rigid")


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (lambda folder, poses: (folder / "b.txt").write_text("1 2 3\n"), "3 numbers in its first line are not a pose"),
        (lambda folder, poses: None, "b.txt does not exist"),
        (
            lambda folder, poses: write_kitti_file(folder / "b.txt", poses + np.eye(4)[3] * [[1e160], [0], [0], [0]]),
            r"b.txt, line 1: the position \(1e\+160, 0, 0\) is further away than 1e\+09",
        ),
        (
            lambda folder, poses: write_kitti_file(folder / "b.txt", poses * [[1], [-1], [1], [1]]),
            "its 3x3 part is not a rotation",
        ),
        (lambda folder, poses: write_kitti_file(folder / "b.txt", poses[:-1]), "20 poses and .* 19; without times"),
        (
            lambda folder, poses: write_tum_file(folder / "b.txt", np.arange(20.0), poses),
            r"these poses cannot be matched: .*a.txt \(KITTI\) by lines, .*b.txt \(TUM\) by times",
        ),
    ],
)
def test_files_that_do_not_go_together(write, said, tmp_path):
    poses = poses_along(20)
    reference = write_kitti_file(tmp_path / "a.txt", poses)
    write(tmp_path, poses)
    with pytest.raises(UserError, match=said):
        compare_trajectories(reference, tmp_path / "b.txt")


def test_reconstructions_are_joined_by_the_names_of_images(tmp_path):
    poses, names = poses_along(20), [f"{i}.jpg" for i in range(20)]
    one = colmap_text(tmp_path / "images.txt", names, poses)
    other = nerfstudio(tmp_path / "transforms.json", [f"images/{name}" for name in names[5:]], poses[5:])
    found = compare_trajectories(one, other)
    assert (len(found.reference), found.reference_frames, found.estimate_frames) == (15, 20, 15)
    assert found.length_m == pytest.approx(14)
    assert found.absolute_m["none"].max < 1e-9
    nothing = nerfstudio(tmp_path / "transforms.json", ["elsewhere.jpg"], poses[:1])
    with pytest.raises(UserError, match=r"no image is in both files: the first has 0.jpg, the second elsewhere.jpg"):
        compare_trajectories(one, nothing)
    with pytest.raises(UserError, match=r"\(colmap\) by names of images, .*\(KITTI\) by lines"):
        compare_trajectories(one, write_kitti_file(tmp_path / "a.txt", poses))


def test_tables_are_joined_by_the_names_of_images_also_the_one_that_localization_writes(tmp_path):
    headings = np.linspace(0, 300, 12)
    rows = [(f"{i}.jpg", 2.0 * i, 0.1 * i * i, heading) for i, heading in enumerate(headings)]
    truth, own = tmp_path / "truth.csv", tmp_path / "poses.csv"
    truth.write_text("\n".join(["file;x;y;heading", *(";".join(map(str, row)).replace(".", ",") for row in rows)]))
    truth.write_text(truth.read_text().replace(",jpg", ".jpg"))
    said = [f"{name},{x + 1},{y},{heading - 3},0.1,0.1,1,1,1,false,,0,0," for name, x, y, heading in rows[2:]]
    own.write_text("\n".join([",".join(COLUMNS), *said]))
    found = compare_trajectories(truth, own)
    assert (len(found.reference), found.reference_frames, found.estimate_frames) == (10, 12, 10)
    assert found.absolute_m["none"].rmse == pytest.approx(1)
    assert found.absolute_deg["none"].max == pytest.approx(3)
    in_space = [f"{k}.jpg,located,1,2,{k},1,0,0,0,90,90,40,30" for k in (0, 2)] + ["1.jpg,not in the map" + 11 * ","]
    own.write_text("\n".join(["file,verdict,x,y,z,qw,qx,qy,qz,fx,fy,cx,cy", *in_space]))  # by sextant locate
    found = compare_trajectories(own, own)
    assert (len(found.reference), found.absolute_m["none"].max) == (2, 0)
    cameras = read_reconstruction(colmap_text(tmp_path / "images.txt", ["0.jpg"], poses_along(1)), "colmap")
    assert compare_trajectories(truth, tmp_path / "images.txt").absolute_m["none"].max == pytest.approx(0)
    assert cameras.names == ["0.jpg"]
    tum = write_tum_file(tmp_path / "truth.tum", np.arange(3.0), poses_along(3))
    write_tum_file(tmp_path / "trajectory.tum", np.arange(3.0), poses_along(3))
    with pytest.raises(UserError, match=r"\(TUM\) by times, .*\(table\) by names of images\nGive .*trajectory.tum"):
        compare_trajectories(tum, own)
    truth.write_text("file,x,y\n0.jpg,1,2\n")
    with pytest.raises(UserError, match=r"truth.csv has no column heading"):
        compare_trajectories(truth, own)


def test_clocks_that_never_meet(tmp_path):
    poses = poses_along(5)
    first = write_tum_file(tmp_path / "a.tum", np.arange(5.0), poses)
    second = write_tum_file(tmp_path / "b.tum", np.arange(5.0) + 1e6, poses)
    with pytest.raises(UserError, match=r"max_gap_s=0.01: no two poses are that close in time; .* 0.000 to 4.000 s"):
        compare_trajectories(first, second)
    with pytest.raises(UserError, match="max_gap_s=-1 must be at least 0"):
        compare_trajectories(first, second, max_gap_s=-1)


@pytest.mark.real_data
def test_a_real_estimate_has_its_published_errors(real_data):
    """ORB-SLAM2 (Mur-Artal & Tardos, T-RO 2017, table I): t_rel 0.70 %, r_rel 0.25 deg/100 m, RMSE 1.3 m."""
    found = compare_trajectories(real_data / "kitti/poses/00.txt", real_data / "kitti/estimates/00_ORB.txt")
    assert found.segments.translation_percent == pytest.approx(0.70, abs=0.005)
    assert found.segments.rotation_deg_per_100m == pytest.approx(0.25, abs=0.005)
    assert found.absolute_m["rigid"].rmse == pytest.approx(1.3, abs=0.05)
