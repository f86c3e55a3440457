"""Poses in the files of EuRoC, RobotCar and NCLT, below folders as these datasets have them."""

import numpy as np
import pytest
from PIL import Image

from sextant.chapters.localization.data import PoseFolder, motions_along, read_odometry
from sextant.chapters.localization.data.own_drive import open_drive
from sextant.chapters.localization.data.recorded_poses import read_recorded
from sextant.chapters.localization.trajectories import compare_trajectories
from sextant.errors import UserError
from sextant.tools.inspection import inspect

N, START = 8, 1_403_636_579
#: images every second, and poses every quarter of a second from half a second before
SECONDS, POSED_AT = np.arange(N), np.arange(-2, 4 * N) / 4


def path_at(seconds, turned=0.0):
    """x east, y north and the heading counter-clockwise from east, of a robot on an arc."""
    heading = 0.1 * np.asarray(seconds) + 0.3
    return np.column_stack([15 * np.sin(heading), -15 * np.cos(heading), heading + turned])


def euroc(poses, seconds):
    """A body whose z axis points ahead, x up and y right, in a world with z up."""
    lines = [
        "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
        "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]"
    ]
    for (x, y, heading), second in zip(poses, seconds, strict=True):
        # world_from_body = Rz(heading) [right-handed axes: x up, y right, z ahead], as a product of quaternions
        level = np.array([0, 0.5, 0, 0.5]) * 2**0.5  # half a turn about the axis between x and z
        turn = np.array([np.cos(heading / 2), 0, 0, np.sin(heading / 2)])
        w, v = turn[0] * level[0] - turn[3] * level[3], turn[0] * level[1:] + level[0] * turn[1:]
        w, *v = map(float, (w, *(v + np.cross(turn[1:], level[1:]))))
        lines.append(f"{stamp(second, 9)},{float(x)!r},{float(y)!r},1.5,{w!r},{v[0]!r},{v[1]!r},{v[2]!r},0,0,0")
    return "\n".join(lines)


def stamp(second, digits):
    return str(round((START + second) * 10**digits)) if digits < 9 else str(START * 10**9 + round(second * 10**9))


def ned(x, y, heading):
    """North, east, down, roll, pitch and the yaw clockwise from north."""
    return f"{float(y)!r},{float(x)!r},-110.0,0.0,0.0,{float(np.pi / 2 - heading)!r}"


def robotcar(poses, seconds):
    lines = [
        "timestamp,ins_status,latitude,longitude,altitude,northing,easting,down,utm_zone,velocity_north,"
        "velocity_east,velocity_down,roll,pitch,yaw"
    ]
    for pose, second in zip(poses, seconds, strict=True):
        north, east, down, *angles = ned(*pose).split(",")
        where = f"{north},{east},{down},30U,0,0,0,{','.join(angles)}"
        lines.append(f"{stamp(second, 6)},INS_SOLUTION_GOOD,51.76,-1.26,110.0,{where}")
    return "\n".join(lines)


def vo(poses, seconds):
    """The pose of each frame in the one before: x ahead, y right, z down, so that turns to the right are positive."""
    lines = ["source_timestamp,destination_timestamp,x,y,z,roll,pitch,yaw"]
    for k, (x, y, turn) in enumerate(motions_along(poses).tolist()):
        if k:
            lines.append(f"{stamp(seconds[k], 6)},{stamp(seconds[k - 1], 6)},{x!r},{-y!r},0,0,0,{-turn!r}")
    return "\n".join(lines)


def nclt(poses, seconds):
    lines = [f"{stamp(second, 6)},{ned(*pose)}" for pose, second in zip(poses, seconds, strict=True)]
    return "\n".join([f"{stamp(-3, 6)}, nan, nan, nan, nan, nan, nan", *lines])


#: images, poses and odometry from a drive's folder; how these are written; the settings of a source of them
LAYOUTS = {
    "euroc": ("mav0/cam0/data", "mav0/state_groundtruth_estimate0/data.csv", euroc, "mav0/vio.csv", euroc, {}),
    "robotcar": ("stereo/centre", "gps/ins.csv", robotcar, "vo/vo.csv", vo, {"ahead": "x"}),
    "nclt": ("lb3/Cam5", "groundtruth_{date}.csv", nclt, "odometry_mu_100hz.csv", nclt, {"ahead": "x"}),
}
#: odometry in its own frame: turned, and elsewhere
OWN = 1.2


def write(folder, form, drives=("2012-01-08", "2012-01-15")):
    images, poses, write_poses, odometry, write_odometry, _ = LAYOUTS[form]
    rng = np.random.default_rng(0)
    for drive in drives:
        (folder / drive / images).mkdir(parents=True)
        for second in SECONDS:
            pixels = rng.integers(0, 255, (60, 80, 3), np.uint8)
            name = stamp(second, 9 if form == "euroc" else 6)
            Image.fromarray(pixels).save(folder / drive / images / f"{name}.png")
        for file, make, turned in ((poses, write_poses, 0.0), (odometry, write_odometry, OWN)):
            path = folder / drive / file.format(date=drive)
            path.parent.mkdir(parents=True, exist_ok=True)
            along = path_at(POSED_AT)
            c, s = np.cos(turned), np.sin(turned)
            along = np.column_stack([along[:, :2] @ np.array([[c, s], [-s, c]]), along[:, 2] + turned])
            path.write_text(make(along, POSED_AT))
    return folder


@pytest.mark.parametrize("form", LAYOUTS)
def test_a_folder_of_the_dataset_gives_the_poses_and_motions_at_its_images(tmp_path, form):
    images, _, _, odometry, _, settings = LAYOUTS[form]
    write(tmp_path, form)
    (tmp_path / "cache").mkdir()
    up = "/".join(".." for _ in images.split("/"))
    data = PoseFolder(
        str(tmp_path), f"2012-01-08/{images}", {"run": f"2012-01-15/{images}"}, poses=form,
        odometry=f"{up}/{odometry}", height=16, width=24, roots=(tmp_path / "cache",), **settings,
    ).read()  # fmt: skip
    truth = path_at(SECONDS)
    # between poses, positions are interpolated along chords: a quarter of a second apart, 1.5 m/s, 15 m of radius
    np.testing.assert_allclose(data.map.poses, truth, atol=1e-6)
    np.testing.assert_allclose(data.test[0].poses, truth[2:], atol=1e-6)
    np.testing.assert_allclose(data.test[0].motion, motions_along(truth[2:]), atol=1e-6)
    np.testing.assert_allclose(data.test[0].times_s, START + SECONDS[2:], atol=1e-6)


@pytest.mark.parametrize("form", LAYOUTS)
def test_its_odometry_serves_photos_of_a_drive(tmp_path, form):
    images, _, _, odometry, _, _ = LAYOUTS[form]
    drive = write(tmp_path, form, ("2012-01-08",)) / "2012-01-08"
    moves = read_odometry(drive / odometry)
    np.testing.assert_allclose(motions_along(moves.poses), motions_along(path_at(POSED_AT)), atol=1e-6)
    found = open_drive(str(drive / images), drive / odometry, tmp_path / "out")
    np.testing.assert_allclose(found.motions[1:], motions_along(path_at(SECONDS))[1:], atol=1e-6)


@pytest.mark.parametrize("form", LAYOUTS)
def test_inspect_suggests_the_settings_with_which_it_is_read(tmp_path, form):
    write(tmp_path, form)
    words = next(words for each in inspect(tmp_path).suggestions for words in each.commands if "train" in words).split()
    given = dict(word.removeprefix("dataset.").split("=", 1) for word in words if word.startswith("dataset."))
    assert given["poses"] == form
    assert given.get("ahead", "z") == LAYOUTS[form][5].get("ahead", "z")
    assert not {"pose_file", "plane"} & set(given)  # it is where the dataset has it
    found = PoseFolder(given["folder"], given["map"], {"run": f"2012-01-15/{LAYOUTS[form][0]}"}, poses=form,
                       ahead=given.get("ahead", "z"), roots=(tmp_path,)).read()  # fmt: skip
    np.testing.assert_allclose(found.map.poses, path_at(SECONDS), atol=1e-6)


def test_trajectories_of_different_datasets_are_compared_by_time(tmp_path):
    (tmp_path / "ins.csv").write_text(robotcar(path_at(POSED_AT), POSED_AT))
    (tmp_path / "groundtruth_2012-01-08.csv").write_text(nclt(path_at(POSED_AT) + np.array([0.5, 0, 0]), POSED_AT))
    found = compare_trajectories(tmp_path / "ins.csv", tmp_path / "groundtruth_2012-01-08.csv")
    assert len(found.reference) == len(POSED_AT)
    assert found.absolute_m["none"].rmse == pytest.approx(0.5, abs=1e-6)
    assert found.absolute_deg["none"].rmse == pytest.approx(0, abs=1e-4)


def test_roll_and_pitch_turn_about_the_axes_of_an_aircraft(tmp_path):
    line = f"{stamp(0, 6)},0,0,0,0.1,0.2,0.0"  # roll to the right, nose up, to the north
    (tmp_path / "groundtruth.csv").write_text(line)
    _, (pose,) = read_recorded(tmp_path / "groundtruth.csv")
    np.testing.assert_allclose(pose[:3, 0], [0, np.cos(0.2), np.sin(0.2)], atol=1e-12)  # ahead: north and up
    assert pose[2, 1] == pytest.approx(np.sin(0.1) * np.cos(0.2))  # the left side is up


@pytest.mark.parametrize(
    ("form", "text", "said"),
    [
        ("euroc", robotcar(path_at([0]), [0]), r"is in the layout of robotcar, not in that of euroc"),
        ("robotcar", "file,x,y,heading\na.png,0,0,0", r"begins with file, x, y, heading, not in that of robotcar"),
        ("nclt", "", r"begins with nothing, not in that of nclt"),
        ("nclt", f"{stamp(0, 6)},1,2,3,0,0,east", r"line 1 is not a pose: 1403636579000000,1,2,3,0,0,east"),
        ("nclt", f"{stamp(0, 6)},nan,nan,nan,nan,nan,nan", "has no poses"),
        ("nclt", f"{stamp(1, 6)},0,0,0,0,0,0\n{stamp(0, 6)},0,0,0,0,0,0", "line 2: its time is not after"),
        ("robotcar", robotcar(path_at([0]), [0]).replace("-110.0", ""), "line 2 is not a pose"),
        ("robotcar", robotcar(path_at([0]), [0]).replace("\n", ",yaw\n", 1), "has 2 columns named yaw"),
        (
            "robotcar",
            robotcar(path_at([0]), [0]).replace(stamp(0, 6), "noon"),
            "line 2: timestamp='noon' is not a time",
        ),
        ("euroc", euroc(path_at([0]), [0]).replace(",0.699", ",0.9"), "line 2: the quaternion has not length 1"),
        (
            "robotcar",
            "\n".join(line for k, line in enumerate(vo(path_at(SECONDS), SECONDS).splitlines()) if k != 3),
            "line 4: destination_timestamp is not the source_timestamp of the line before",
        ),
    ],
)
def test_files_that_are_none_are_named_with_their_line(tmp_path, form, text, said):
    (tmp_path / "poses.csv").write_text(text)
    with pytest.raises(UserError, match=said):
        read_recorded(tmp_path / "poses.csv", form)


def test_several_files_that_could_be_meant_are_named(tmp_path):
    drive = write(tmp_path, "nclt") / "2012-01-08"
    (drive / "groundtruth_2012-02-02.csv").write_text("")
    folders = (str(tmp_path), "2012-01-08/lb3/Cam5", {"run": "2012-01-15/lb3/Cam5"})
    with pytest.raises(
        UserError, match=r"are 2 files: groundtruth_2012-01-08.csv, groundtruth_2012-02-02.csv"
    ) as found:
        PoseFolder(*folders, poses="nclt").read()
    assert found.value.fix == "Name one: pose_file=../../groundtruth_2012-01-08.csv"
    (drive / "groundtruth_2012-02-02.csv").unlink()
    for name in ("gtgt01.csv", "gtgt02.csv"):
        (tmp_path / "2012-01-15" / name).write_text("")
    with pytest.raises(UserError, match=r"are 2 files: gtgt01.csv, gtgt02.csv") as found:
        PoseFolder(*folders, poses="nclt", ahead="x", odometry="../../gtgt*.csv").read()
    assert found.value.fix == "Name one: odometry=../../gtgt01.csv"
