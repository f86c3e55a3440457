"""The user's own drives: every format, and every way to get them wrong."""

import copy
import shutil
from pathlib import Path

import numpy as np
import pytest
from data.places.gps_pictures import add_gps
from data.places.place_pictures import picture, write_pictures
from data.reconstructions.written import WRITERS
from PIL import Image

from sextant.chapters.localization.data import DriveSettings, LocalizationSource, PoseFolder, as_localization_source
from sextant.chapters.localization.data.drive import motions_along
from sextant.chapters.localization.data.pose_formats import write_tum
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.data.source import MissingDataError
from sextant.errors import UserError

N = 8
POSES = np.column_stack([np.arange(N) * 1.5, np.arange(N) * 0.5, np.linspace(-3, 3, N)])
ODOMETRY = POSES + np.array([100.0, -50.0, 0.0]) + 0.01 * np.random.default_rng(0).normal(size=(N, 3))


def names(first=0):
    return [f"{1000.25 + first + i:.2f}.png" for i in range(N)]


def csv(poses):
    rows = [f"{name},{x},{y},{np.degrees(turn)}" for name, (x, y, turn) in zip(names(), poses, strict=True)]
    return "\n".join(["file,x,y,heading", *rows])


def kitti(poses):
    """Cameras with z ahead and y down, in the plane x, z."""
    zero, one, (x, z, heading) = np.zeros(N), np.ones(N), poses.T
    c, s = np.cos(heading), np.sin(heading)
    rows = np.column_stack([s, zero, c, x, zero, one, zero, zero, -c, zero, s, z])
    return "\n".join(" ".join(f"{value:.12f}" for value in row) for row in rows)


def write(folder, form):
    """A map, and a run with odometry, in one of the formats."""
    for k, drive in enumerate(("map", "run")):
        write_pictures(folder / drive, names(), first=20 * k)
        for file, poses in (("poses", POSES + np.array([0, k / 10, 0])), ("odometry", ODOMETRY)):
            if form == "csv":
                (folder / drive / f"{file}.csv").write_text(csv(poses))
            elif form in ("colmap", "opensfm", "nerfstudio"):
                name, written = WRITERS[form]
                rows = np.loadtxt(kitti(poses).splitlines()).reshape(-1, 3, 4)
                spatial = np.tile(np.eye(4), (N, 1, 1))
                spatial[:, :3] = rows
                written(
                    folder / drive / (name if file == "poses" else f"odometry{Path(name).suffix}"), names(), spatial
                )
            elif form == "kitti":
                (folder / drive / f"{file}.txt").write_text(kitti(poses))
            else:
                write_tum(folder / drive / f"{file}.txt", 1000.25 + np.arange(N), poses)
    return folder


FORMS = {
    "csv": {"poses": "csv", "odometry": "odometry.csv"},
    "kitti": {"poses": "kitti", "odometry": "odometry.txt", "plane": "xz"},
    "tum": {"poses": "tum", "odometry": "odometry.txt", "ahead": "x"},
    "colmap": {"poses": "colmap", "odometry": "odometry.bin", "plane": "xz"},
    "opensfm": {"poses": "opensfm", "odometry": "odometry.json", "plane": "xz"},
    "nerfstudio": {"poses": "nerfstudio", "odometry": "odometry.json", "plane": "xz"},
}


def source(folder, form="csv", **changes):
    return PoseFolder(str(folder), height=16, width=24, **{**FORMS[form], **changes})


@pytest.fixture(params=FORMS)
def form(request):
    return request.param


def same(a, b):
    return np.allclose(a[:, :2], b[:, :2], atol=1e-9) and np.allclose(np.exp(1j * a[:, 2]), np.exp(1j * b[:, 2]))


def test_all_formats_tell_the_same(tmp_path, form):
    found = source(write(tmp_path, form), form)
    assert isinstance(found, LocalizationSource)
    assert found.conditions() == ("map", "run")
    data = as_localization_source(found).read()
    (early,), (late,) = data.validation, data.test
    assert (len(early), len(late)) == (2, 6)
    assert same(data.map.poses, POSES)
    assert same(late.poses, POSES[2:] + np.array([0, 0.1, 0]))
    assert same(late.motion, motions_along(ODOMETRY[2:]))
    assert late.odometry == "measured"
    assert np.array_equal(late.images[0], picture(22))
    assert data.map.motion is None
    assert (late.times_s is not None) == (form == "tum")
    (told,) = data.notes
    assert "images are 1.6 m apart, further than the 0.5 m" in told


@pytest.mark.parametrize("directed", [True, False])
def test_gps_of_all_drives_is_in_the_frame_of_the_maps_first_image(tmp_path, directed):
    turns = np.arctan2(0.5, 1.5) + (np.linspace(-1, 1, N) if directed else np.zeros(N))
    poses = np.column_stack([3 * POSES[:, :2], turns])
    for k, drive in enumerate(("map", "run")):
        write_pictures(tmp_path / drive, names(), first=20 * k)
        for name, (x, y, turn) in zip(names(), poses + np.array([0, k / 10, 0]), strict=True):
            add_gps(tmp_path / drive / name, x, y, np.degrees(turn) if directed else None)
    data = PoseFolder(str(tmp_path), height=16, width=24, poses="gps").read()
    (late,) = data.test
    np.testing.assert_allclose(data.map.poses, poses, rtol=0, atol=1e-4)
    np.testing.assert_allclose(late.poses, poses[2:] + np.array([0, 0.1, 0]), rtol=0, atol=1e-4)
    assert np.array_equal(late.images[0], picture(22))
    notes = [note for note in data.notes if "apart" not in note and "odometry" not in note]
    lacking = [] if directed else ["map: 8 of 8 images", "test.run: 8 of 8 images"]
    assert [note.split(" have no viewing")[0] for note in notes] == lacking
    write_pictures(tmp_path / "run", names()[:2])  # without GPS
    with pytest.raises(UserError, match=r"test.run: 2 of 8 images have no GPS position(.|\n)*1000.25.png"):
        PoseFolder(str(tmp_path), poses="gps").read()


def test_images_that_a_reconstruction_has_not_posed_are_named(tmp_path):
    write(tmp_path, "opensfm")
    write_pictures(tmp_path / "map", ["unposed.png"])
    with pytest.raises(UserError, match=r"1 of 9 images has no pose in .*reconstruction.json(.|\n)*unposed.png"):
        source(tmp_path, "opensfm").read()


def test_the_mounting_is_where_the_camera_is_on_the_robot(tmp_path):
    found = source(write(tmp_path, "csv"), mounting=[0.5, 0.25, 90.0])
    drive = found.read().map
    c, s = np.cos(POSES[:, 2]), np.sin(POSES[:, 2])
    assert np.allclose(drive.poses[:, 0], POSES[:, 0] + 0.5 * c - 0.25 * s)
    assert np.allclose(drive.poses[:, 1], POSES[:, 1] + 0.5 * s + 0.25 * c)
    assert np.allclose(np.exp(1j * drive.poses[:, 2]), np.exp(1j * (POSES[:, 2] + np.pi / 2)))
    exact = source(tmp_path, mounting=[0.5, 0.25, 90.0], odometry="poses.csv").read().test[0]
    assert same(exact.motion, motions_along(exact.poses))  # motions are those of the camera too


def test_images_between_poses_are_interpolated(tmp_path):
    write(tmp_path, "tum")
    times = 1000.25 + np.arange(0, N - 0.9, 0.5)
    poses = np.column_stack([np.interp(times, 1000.25 + np.arange(N), column) for column in POSES.T])
    write_tum(tmp_path / "run" / "poses.txt", times + 0.1, poses)
    with pytest.raises(UserError, match=r"1 of 8 images has no pose(.|\n)*1000.25.png"):
        source(tmp_path, "tum").read()
    (tmp_path / "run" / "1000.25.png").unlink()
    late = source(tmp_path, "tum").read().test[0]
    assert np.allclose(late.poses[:, 0], POSES[3:, 0] - 0.15)  # the poses of a tenth of a second before


def test_order_joins_images_and_poses_that_tell_no_time(tmp_path):
    write(tmp_path, "tum")
    for drive in ("map", "run"):
        for i, name in enumerate(names()):
            (tmp_path / drive / name).rename(tmp_path / drive / f"{i}.png")
    drive = source(tmp_path, "tum").read().test[0]
    assert np.allclose(drive.times_s, 1002.25 + np.arange(6))
    with pytest.raises(UserError, match=r"8 of 8 names contain no time of a known form, such as 0.png"):
        source(tmp_path, "tum", times="names").read()
    (tmp_path / "run" / "7.png").unlink()
    with pytest.raises(UserError, match=r"test.run: poses.txt has 8 poses for 7 images"):
        source(tmp_path, "tum").read()


def test_times_of_a_file(tmp_path):
    write(tmp_path, "kitti")
    for drive in ("map", "run"):
        (tmp_path / drive / "times.txt").write_text("\n".join(f"{i / 10:.6e}" for i in range(N)))
    found = source(tmp_path, "kitti", times="times.txt")
    assert np.allclose(found.read().test[0].times_s, np.arange(2, N) / 10)
    (tmp_path / "run" / "times.txt").write_text("0\n1\n")
    with pytest.raises(UserError, match=r"times.txt has 2 times for 8 images"):
        found.read()


def test_without_odometry_motion_is_missing_and_that_is_said(tmp_path):
    data = source(write(tmp_path, "csv"), odometry=None).read()
    assert np.isnan(data.test[0].motion[1:]).all()
    assert (data.test[0].motion[0] == 0).all()
    assert data.test[0].odometry == "none"
    assert any("the motion between images is unknown" in note for note in data.notes)


def test_drives_of_their_own_for_validation(tmp_path):
    write(tmp_path, "csv")
    write_pictures(tmp_path / "old", names(), first=60)
    (tmp_path / "old" / "poses.csv").write_text(csv(POSES))
    (tmp_path / "old" / "odometry.csv").write_text(csv(ODOMETRY))
    found = source(tmp_path, validation={"run": "old"})
    data = found.read()
    assert [drive.name for drive in data.validation] == ["validation/run"]
    assert [len(drive) for drive in data.test] == [N]
    assert len(found.files("validation")) == N + 2
    halves = as_localization_source(source(tmp_path), DriveSettings(validation_share=0.5)).read()
    assert len(halves.validation[0]) == N // 2


# -- mistakes ----------------------------------------------------------------------------------------------------------


def test_missing_folders_and_files_are_told(tmp_path, form):
    with pytest.raises(MissingDataError, match="Looked for"):
        source(tmp_path / "nothing", form).read()
    folder = write(tmp_path, form)
    with pytest.raises(MissingDataError, match=r"elsewhere=\S* does not exist"):
        source(folder, form, test={"elsewhere": "elsewhere"}).read()
    with pytest.raises(UserError, match="have the same files"):
        source(folder, form, test={"run": "map"}).read()
    name = source(folder, form).pose_file
    (folder / "run" / name).rename(folder / "run" / "moved")
    with pytest.raises(MissingDataError, match=rf"test.run: \S*run has no poses, the file {name}"):
        source(folder, form).files("test")
    for split, given, key in (
        ("map", {"map": "run", "test": {"other": "map"}}, "map"),
        ("validation", {"validation": {"first": "run"}, "test": {"other": "map"}, "map": "map2"}, "validation.first"),
    ):
        shutil.copytree(folder / "map", folder / "map2", dirs_exist_ok=True)
        with pytest.raises(MissingDataError, match=rf"^{key}: \S*run has no poses"):
            source(folder, form, **given).files(split)
    (folder / "run" / "moved").rename(folder / "run" / name)
    with pytest.raises(MissingDataError, match=r"has no odometry, the file wheels(.|\n)*odometry=<name>"):
        source(folder, form, odometry="wheels").files("test")


@pytest.mark.parametrize(
    ("text", "told"),
    [("file,x,y\n" + "\n".join(f"{name},0,0" for name in names()), "has no column heading, which 8 images"),
     (csv(POSES).replace("1.5,0.5", "nan,0.5"), r"x='nan' of 1001.25.png must be a finite"),
     (csv(POSES).rsplit("\n", 1)[0], r"1 of 8 images has no row(.|\n)*1007.25.png"),
     (csv(POSES) + "\nmissing.png,1,2,3", r"1 row of \S* has no image(.|\n)*missing.png")],
)  # fmt: skip
def test_a_table_that_does_not_fit_is_told(tmp_path, text, told):
    folder = write(tmp_path, "csv")
    (folder / "run" / "poses.csv").write_text(text)
    with pytest.raises(UserError, match=told):
        source(folder).read()


def test_kitti_poses_of_another_count_or_plane_are_told(tmp_path):
    folder = write(tmp_path, "kitti")
    away = POSES * np.array([1, 1, 0]) + np.array([0, 0, np.pi / 2])  # along z, where KITTI's drives begin
    (folder / "map" / "poses.txt").write_text(kitti(away))
    with pytest.raises(UserError, match=r"8 of 8 poses is nearly perpendicular(.|\n)*plane=xz"):
        source(folder, "kitti", plane="xy").read()
    lines = (folder / "run" / "poses.txt").read_text().splitlines()
    (folder / "run" / "poses.txt").write_text("\n".join(lines[:5]))
    with pytest.raises(UserError, match=r"test.run: poses.txt has 5 poses for 8 images"):
        source(folder, "kitti").read()


def test_images_out_of_order_are_told(tmp_path):
    folder = write(tmp_path, "tum")
    (folder / "run" / names()[3]).rename(folder / "run" / "a_1000.50.png")
    with pytest.raises(
        UserError, match=r"test.run: 1 of 8 names contains no time of a known form, such as a_1000.50.png"
    ):
        source(folder, "tum").read()
    for k, name in enumerate(sorted(path.name for path in (folder / "run").glob("*.png"))):
        (folder / "run" / name).rename(folder / "run" / f"{'b' if k == 3 else 'a'}_{1305031102.25 + k:.2f}.png")
    with pytest.raises(UserError, match=r"test.run: images are out of order: b_1305031105.25.png"):
        source(folder, "tum").read()


def test_gaps_in_time_are_told_for_drives_but_not_for_the_map(tmp_path):
    folder = write(tmp_path, "tum")
    for drive in ("map", "run"):
        for name in names()[2:5]:
            (folder / drive / name).unlink()
    with pytest.raises(UserError, match=r"test.run: 1 gaps in time above max_gap_s=3\n.*1001.25.png"):
        source(folder, "tum", max_gap_s=3.0).read()
    assert len(source(folder, "tum", max_gap_s=None).read().map) == 5


def test_gaps_in_odometry_are_told(tmp_path):
    folder = write(tmp_path, "tum")
    write_tum(folder / "run" / "odometry.txt", 1000.25 + np.array([0, 1, 6.5, 7.5]), ODOMETRY[:4])
    with pytest.raises(UserError, match=r"test.run, odometry.txt: 5 of 8 images have no pose at their time"):
        source(folder, "tum", max_gap_s=3.0).read()


def test_two_images_of_the_map_at_one_pose_are_told_or_left_out(tmp_path):
    folder = write(tmp_path, "csv")
    twice = POSES.copy()
    twice[5] = twice[2]
    (folder / "map" / "poses.csv").write_text(csv(twice))
    with pytest.raises(UserError, match=r"map: 1 of 8 images has the same pose(.|\n)*1005.25.png = 1002.25"):
        source(folder).read()
    data = source(folder, skip_bad=True).read()
    assert np.array_equal(data.map.images[5], picture(6))
    assert same(data.map.poses, np.delete(twice, 5, axis=0))
    assert data.notes[0] == "left out 1005.25.png = 1002.25.png"
    (folder / "run" / "poses.csv").write_text(csv(twice))  # a robot that is localized may stand still
    source(folder, skip_bad=True).read()


def test_a_damaged_image_is_named_or_left_out_and_motion_goes_over_it(tmp_path):
    folder = write(tmp_path, "csv")
    (folder / "run" / names()[4]).write_bytes(b"")
    with pytest.raises(UserError, match=r"1004.25.png is empty"):
        source(folder).read()
    data = source(folder, skip_bad=True).read()
    assert same(data.test[0].motion[1:], motions_along(ODOMETRY[[2, 3, 5, 6, 7]])[1:])
    assert any("1004.25.png" in note for note in data.notes)


def test_drives_of_deeper_images_have_one_white_level(tmp_path):
    folder = write(tmp_path / "drives", "csv")
    for drive, top in (("map", 900), ("run", 4000)):
        for name in names():
            Image.fromarray(np.full((24, 32), top, np.uint16)).save(folder / drive / name)
    found = source(folder, roots=[tmp_path / "cache"]).read()
    assert (found.map.images[0].max(), found.test[0].images[0].max()) == (900 >> 4, 4000 >> 4)


def test_the_fingerprint_follows_contents_and_meaning(tmp_path, form):
    folder = write(tmp_path, form)
    before = source(folder, form).fingerprint()
    assert source(folder, form).fingerprint() == before
    assert source(folder, form, mounting=[1.0, 0.0, 0.0]).fingerprint() != before
    assert as_localization_source(source(folder, form), DriveSettings(validation_share=0.5)).fingerprint() != before
    file = folder / "run" / source(folder, form).pose_file
    file.write_bytes(file.read_bytes() + b"\n")
    assert source(folder, form).fingerprint() != before


@pytest.mark.parametrize(
    "wrong", [{"poses": "imu"}, {"poses": "gps", "odometry": "wheels.csv"}, {"plane": "zx"}, {"ahead": "y"},
              {"mounting": [0.0, 0.0]}, {"mounting": [0.0, 0.0, np.nan]}, {"protocol": "railway"}, {"max_gap_s": 0.0}],
)  # fmt: skip
def test_arguments_without_meaning_are_refused(tmp_path, wrong):
    with pytest.raises(Exception, match=list(wrong)[-1]):  # type checks, where they are on, come first
        source(tmp_path, **wrong)


def config(*overrides):
    return to_plain(compose(["dataset=pose_folder", "dataset.folder=mine", *overrides]))


def test_the_config_builds_the_usual_folder(tmp_path):
    validate(config())
    plain = copy.deepcopy(config()["dataset"])
    assert plain.pop("_target_") == "sextant.chapters.localization.data.PoseFolder"
    built, usual = PoseFolder(**plain), PoseFolder("mine")
    for key, value in vars(usual).items():
        assert np.array_equal(vars(built)[key], value) if key == "mounting" else vars(built)[key] == value, key


@pytest.mark.parametrize(
    "override", ["dataset.poses=imu", "dataset.plane=zx", "dataset.mounting=[0,0]", "dataset.max_gap_s=0",
                 "dataset.test=run", "+dataset.tilt=3"],
)  # fmt: skip
def test_configs_with_mistakes_are_refused(override):
    with pytest.raises(UserError):
        validate(config(override))


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("poses", ["csv", "tum"])
def test_an_odometry_table_is_taken_at_its_own_times_or_by_rows(tmp_path, poses, timed):
    seconds = 1_700_000_000.25 + np.arange(N)
    stamps = [f"{second:.6f}.png" for second in seconds]
    for drive in ("map", "run"):
        write_pictures(tmp_path / drive, stamps, first=0)
        if poses == "csv":
            lines = [f"{name},{x},{y},{np.degrees(turn)}" for name, (x, y, turn) in zip(stamps, POSES, strict=True)]
            (tmp_path / drive / "poses.csv").write_text("\n".join(["file,x,y,heading", *lines]))
        else:
            write_tum(tmp_path / drive / "poses.txt", seconds, POSES)
    late = np.arange(-1, 3 * N) / 3 if timed else np.arange(N)  # at other times than the images
    turned = 0.2 * late
    rows = np.column_stack([2 * late, -late, turned])
    table = ["x,y,theta", *(",".join(map(repr, row)) for row in rows.tolist())]
    if timed:
        table = [
            "x,y,theta,time_ms",
            *(f"{line},{float(1000 * (seconds[0] + t))!r}" for line, t in zip(table[1:], late.tolist(), strict=True)),
        ]
    (tmp_path / "run" / "odometry.csv").write_text("\n".join(table))
    late_drive = source(tmp_path, poses, odometry="odometry.csv").read().test[0]
    at = np.arange(2, N)
    expected = motions_along(np.column_stack([2.0 * at, -1.0 * at, 0.2 * at]))
    np.testing.assert_allclose(late_drive.motion, expected, atol=1e-5)
    assert (late_drive.times_s is not None) == (timed or poses == "tum")


def test_an_odometry_table_of_another_length_needs_times(tmp_path):
    write(tmp_path, "csv")
    (tmp_path / "run" / "odometry.csv").write_text("x,y,theta\n0,0,0\n1,0,0")
    with pytest.raises(UserError, match=f"odometry.csv has 2 rows for {N} images"):
        source(tmp_path, "csv").read()
