"""What is said of a user's own folder, however broken it is; and that every command is one that Sextant understands."""

import json
import os
import re
import shlex
import subprocess
import sys
from contextlib import suppress
from itertools import product
from pathlib import Path

import pytest
from applications.inspection.folders import (
    FOLDERS,
    WRITERS,
    N,
    apple_note,
    classes,
    drives,
    names,
    photo,
    photos,
    some_poses,
    spaced,
    write_bag,
    write_pictures,
)  # fmt: skip
from docs_commands import Command, check
from fuzzing import fuzz
from hypothesis import given
from hypothesis import strategies as st

from sextant.chapters.localization.data import PoseFolder
from sextant.chapters.localization.data.own_drive import open_drive
from sextant.data.photos.gps import GpsPosition
from sextant.errors import UserError
from sextant.tools.inspection import inspect, suggestion, summary
from sextant.tools.inspection.suggestion import outputs

#: of a drive, by the name of the format
POSE_FILES = {
    "csv": "poses.csv",
    "tum": "poses.txt",
    "kitti": "poses.txt",
    "colmap": "images.bin",
    "opensfm": "reconstruction.json",
    "nerfstudio": "transforms.json",
}


def said_of(found):
    """All that a user is shown, a line each."""
    lines = [f"{name}: {text}" for name, text in summary(found.seen).items()]
    lines += [f"{name}: {why}" for name, why in found.seen.unreadable.items()]
    for each in found.suggestions:
        lines += [f"{each.task}: {each.why}", *each.commands]
    return "\n".join([*lines, *found.remarks])


def paths_of(command):
    """Files and folders that a command reads, as Hydra and the shell would see them."""
    values = dict(word.split("=", 1) for word in shlex.split(command) if "=" in word)
    keys = ("input", "map", "queries", "prototype", "folder", "paths.data", "dataset.folder")
    bare = [word for word in shlex.split(command)[2:] if "=" not in word and word != "calibration"]
    quoted = [values[key] for key in keys if key in values and values[key] != "<map>"] + bare
    return [Path(text[1:-1].replace('\\"', '"') if text.startswith('"') else text) for text in quoted]


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_is_told_and_its_commands_are_understood(name, tmp_path):
    make, expected = FOLDERS[name]
    make(tmp_path)
    found = inspect(tmp_path)
    said = said_of(found)
    for text in expected:
        assert text in said, said
    facts = json.loads(json.dumps(found.facts()))
    assert facts["images"] == len(found.seen.headers)
    for each in found.suggestions:
        for command in each.commands:
            check(Command("guide.md", command))
            assert all(path.exists() for path in paths_of(command)), command


@pytest.mark.parametrize("form", ["csv", "tum", "kitti", "colmap", "opensfm", "nerfstudio", "gps"])
def test_the_drives_that_a_command_names_can_be_read(form, tmp_path):
    drives(tmp_path, form)
    (command,) = next(each.commands for each in inspect(tmp_path).suggestions if each.task.startswith("localize"))
    values = dict(word.removeprefix("dataset.").split("=", 1) for word in shlex.split(command) if "dataset." in word)
    values["test"] = dict([values["test"].strip("{}").replace('"', "").split(": ")])
    data = PoseFolder(**values, height=16, width=24).read()
    assert [drive.name for drive in data.test] == ["evening_run_images" if form == "colmap" else "evening_run"]
    assert len(data.map) == 8


def test_drives_in_two_towns_are_not_joined(tmp_path):
    FOLDERS["GPS of two towns"][0](tmp_path)
    assert not [each for each in inspect(tmp_path).suggestions if each.task.startswith("localize")]


@pytest.mark.parametrize(
    ("count", "images", "options"),
    [
        (25, 6, {}),  # floors
        (25, 19, {}),
        (12, 11, {}),
        (6, 5, {}),
        (2, 4, {}),
        (2, 8, {"name": "clip{c}_frame_{k:06d}"}),
        (2, 8, {"name": "frame{t}"}),
        (2, 8, {"name": "{c} FRAME-{k:04d}"}),
        (2, 8, {"seconds": 1}),
        (2, 8, {"seconds": 2}),
        (2, 8, {"name": "1714557{t:03d}000000000"}),  # nanoseconds in names
        (3, 8, {"name": "1714557690.{t:03d}000"}),
    ],
)
def test_no_classifier_is_proposed_for_what_cannot_be_learnt(count, images, options, tmp_path):
    """Boundaries: few images for the number of folders; frames of videos by their names, times by EXIF or by names."""
    classes(tmp_path, count, images, **options)
    tasks = [each.task for each in inspect(tmp_path).suggestions]
    assert "classify images" not in tasks
    assert "recognise places" not in tasks  # which would be the reason


@pytest.mark.parametrize("name", [name for name in FOLDERS if "odometry" in name or "drive" in name or "walk" in name])
def test_no_classifier_is_proposed_for_drives(name, tmp_path):
    FOLDERS[name][0](tmp_path)
    assert "classify images" not in [each.task for each in inspect(tmp_path).suggestions]


@pytest.mark.parametrize(("metres", "town"), [(0.1, False), (0.5, False), (0.51, True), (1, True)])
def test_a_coarse_map_is_scored_by_the_limits_of_a_town(metres, town, tmp_path):
    spaced(tmp_path, metres)
    (command,) = next(each.commands for each in inspect(tmp_path).suggestions if each.task.startswith("localize"))
    assert ("dataset.protocol=town" in shlex.split(command)) is town


@pytest.mark.parametrize(("name", "head"), [("odometry.csv", "left,right"), ("notes.csv", "file,x,y,theta")])
def test_a_table_that_is_no_odometry_is_not_taken_for_it(name, head, tmp_path):
    FOLDERS["odometry beside"][0](tmp_path)
    text = (tmp_path / "winter/odometry.csv").read_text().replace("file,x,y,theta", head)
    (tmp_path / "winter/odometry.csv").unlink()
    (tmp_path / "winter" / name).write_text(text)
    assert "odometry=" not in said_of(inspect(tmp_path))


ROW = {"x": 1.5, "y": "-2", "theta": 0.1, "heading_deg": 9, "nsec": 5}
ODOMETRY = [
    ("odometry.csv", "x,y,theta", 3, True),
    ("Odom.TXT", "x,y,heading_deg", 3, True),
    ("odometry.csv", "", 3, True),  # no header
    ("odom_left.csv", "file,x,y,theta,speed", 3, True),
    ("wheels.csv", "x,y,theta", 3, True),
    ("wheels.txt", "y;x;heading_deg", 3, True),
    ("log.csv", "timestamp,x,y,theta", 3, True),
    ("log.csv", "Time [ms]|X|Y|Theta", 3, True),
    ("log.txt", "sec\tnsec\tx\ty\ttheta", 3, True),
    ("images/log.csv", "t,x,y,theta", 3, True),
    ("1700000000.5.csv", "time_ns,x,y,heading_deg", 3, True),
    ("odometry.csv", "x,y,theta", 2, False),
    ("odometry.csv", "x,y,theta", 4, False),
    ("wheels.csv", "t,x,y,theta", 9, False),  # the images have no times
    ("odometry.csv", "left,right", 3, False),
    ("odometry.csv", "x,y", 3, False),
    ("wheels.csv", "", 3, False),
    ("wheels.csv", "x,y,z,theta", 3, False),
    ("wheels.csv", "file,x,y,theta", 3, False),  # maybe poses
    ("around/wheels.csv", "x,y,theta", 3, False),
    (".odometry.csv", "x,y,theta", 3, False),
    ("odometry.csv", "x,y,theta", 0, False),
]


@pytest.mark.parametrize(("name", "head", "rows", "offered"), ODOMETRY)
def test_images_are_offered_with_the_odometry_that_is_theirs(name, head, rows, offered, tmp_path):
    """Boundaries: the name or the columns make a table odometry; separators; where; rows per image."""
    for k in range(3):
        photo(tmp_path / "images" / f"{'abc'[k]}.jpg", k, 48, 36)
    separator = next((each for each in ";|\t" if each in head), ",")
    words = [each.lower() for each in head.split(separator)] if head else ["x", "y", "theta"]
    rows_of = ({"file": f"{'abcd'[k % 4]}.jpg", **ROW} for k in range(rows))
    lines = [separator.join(str(row.get(each, k)) for each in words) for k, row in enumerate(rows_of)]
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("\n".join([*([head] if head else []), *lines]))
    found = inspect(tmp_path)
    commands = [each for suggested in found.suggestions for each in suggested.commands]
    images, table = tmp_path / "images", tmp_path / name
    wanted = suggestion.command("localize", map="<map>", input=images, odometry=table, output="localization/images")
    assert (wanted in commands) is offered
    assert sum("odometry=" in each for each in commands) == offered
    if offered:
        assert found.facts()["odometry"] == [{"file": name, "rows": rows}]
        assert len(open_drive(str(tmp_path / "images"), tmp_path / name, tmp_path / "found").motions) == 3


VIDEOS = (
    b"", b"no video", b"\0\0\0\x18ftypmp42\0\0\0\0mp42isom", b"RIFF....AVI LIST",
    b"RIFF\x20\0\0\0AVI LIST\x04\0\0\0hdrl",
    b"\x1aE\xdf\xa3" + b"\xff" * 40, b"\0\0\1\xba" * 20, b"\xff\xd8\xff\xe0" + b"\0" * 100, bytes(range(256)) * 4,
)  # fmt: skip


@pytest.mark.parametrize("suffix", [".mp4", ".AVI", ".mkv", ".mpg"])
def test_videos_that_do_not_open_are_named(tmp_path, suffix):
    """Boundaries: empty; another kind of file; containers cut at their beginning, under their own suffix and others."""
    for k, content in enumerate(VIDEOS):
        (tmp_path / f"{k}{suffix}").write_bytes(content)
    found = inspect(tmp_path)
    assert set(found.seen.unreadable) == {f"{k}{suffix}" for k in range(len(VIDEOS))}
    assert found.remarks == ("no image, video, recording, poses or odometry that can be read",)
    for k in range(len(VIDEOS)):
        with pytest.raises(UserError, match=rf"input=.*/{k}\{suffix} cannot be read as a video"):
            open_drive(str(tmp_path / f"{k}{suffix}"), None, tmp_path / "found")


@pytest.mark.slow
def test_the_libraries_say_nothing_of_videos_that_do_not_open(tmp_path):
    """In a process of its own, as the first use of FFmpeg in a process decides what it prints."""
    for k, suffix in product(range(len(VIDEOS)), (".mp4", ".AVI", ".mkv", ".mpg")):
        (tmp_path / f"{k}{suffix}").write_bytes(VIDEOS[k])
    code = "import sys; from sextant.data.videos import open_video, Path\n"
    code += "print(sum(open_video(Path(each)).read()[0] for each in sys.argv[1:]))"
    files = sorted(map(str, tmp_path.iterdir()))
    said = subprocess.run([sys.executable, "-c", code, *files], capture_output=True, text=True, check=True)
    assert (len(files), said.stdout, said.stderr) == (4 * len(VIDEOS), "0\n", "")


def test_no_suggestion_is_made_of_nothing(tmp_path):
    assert inspect(tmp_path).suggestions == ()


def test_no_suggestion_is_made_of_a_recording_that_cannot_be_read(tmp_path):
    for name in ("empty.bag", "empty.mcap", "empty.db3"):
        (tmp_path / name).touch()
    found = inspect(tmp_path)
    assert (found.suggestions, found.facts()["recordings"]) == ((), [])
    assert found.remarks == ("no image, video, recording, poses or odometry that can be read",)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("empty.bag", b"", "is empty (0 bytes)"),
        ("words.bag", b"hello", "is not a ROS 1 bag: it begins with b'hello', not with b'#ROSBAG V2.0'"),
        ("empty.mp4", b"", "is empty (0 bytes)"),
        ("empty.csv", b"", "is empty (0 bytes)"),
        ("notes.txt", b"hello", "is no image, video, recording, poses or odometry"),
        ("empty.png", b"", "is empty (0 bytes)"),
        ("odometry.csv", b"x,y,theta\n1,2,3\n1,2,much\n", "line 3 is not a pose: 1,2,much"),
        ("words.jpg", b"some words", "cannot be decoded (10 bytes): it is text"),
    ],
)
def test_one_file_of_which_nothing_can_be_read_is_refused(name, content, said, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=re.escape(f"input={tmp_path / name} {said}")) as error:
        inspect(tmp_path / name)
    assert ("a photo (.jpg, .jpeg, .png, " in error.value.fix) == (name == "notes.txt")


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.jpg")
    with pytest.raises(UserError, match=r"pipe.jpg is neither a folder nor a file"):
        inspect(tmp_path / "pipe.jpg")


def test_positions_and_times_of_headers(tmp_path):
    gps = {1: "S", 2: (33.0, 30.0, 0.0), 3: "E", 4: (151.0, 0.0, 36.0), 5: b"\x01", 6: 12.0, 16: "M", 17: 370.5}
    photo(tmp_path / "a.jpg", gps=gps, taken=90)
    (header,) = inspect(tmp_path).seen.headers.values()
    assert header.gps.position == GpsPosition(
        pytest.approx(-33.5), pytest.approx(151.01), -12.0, pytest.approx(10.5), True
    )
    assert header.taken_s == 1714557690  # 2024-05-01 10:01:30
    facts = inspect(tmp_path / "a.jpg").facts()
    assert (facts["gps"], facts["gps_directions"], facts["gps_extent_m"]) == (1, 1, [0, 0])


def test_folders_of_one_camera_each_are_calibrated_apart(tmp_path):
    photos(tmp_path / "phone", camera=("Apple", "iPhone 12"))
    photos(tmp_path / "zoom", camera=("Canon", "Canon EOS 5D"), focal=50)
    assert inspect(tmp_path).suggestions[0].commands == (
        f"sextant predict input={tmp_path}/phone output=calibrated/phone camera=one",
        f"sextant predict input={tmp_path}/zoom output=calibrated/zoom camera=one",
    )


def test_folders_of_one_name_are_calibrated_apart(tmp_path):
    photos(tmp_path / "day1" / "left", camera=("Apple", "iPhone 12"))
    photos(tmp_path / "day2" / "left", camera=("Canon", "Canon EOS 5D"), focal=50)
    assert inspect(tmp_path).suggestions[0].commands == (
        f"sextant predict input={tmp_path}/day1/left output=calibrated/day1/left camera=one",
        f"sextant predict input={tmp_path}/day2/left output=calibrated/day2/left camera=one",
    )


def alike(folder):
    """Files and folders whose names differ only in the suffix, or in the folder around them."""
    make = {name: FOLDERS[name][0] for name in ("a drive without poses", "two trajectories", "known cameras")}
    for name in ("tracks", "one/set", "two/set"):
        (folder / name).mkdir(parents=True)
    make["a drive without poses"](folder)
    write_bag(folder, 1).rename(folder / "again.bag")
    write_pictures(folder / "again", names(), first=30)
    make["two trajectories"](folder / "tracks")
    (folder / "tracks" / "estimate_2.txt").write_bytes((folder / "tracks" / "estimate.txt").read_bytes())
    for name in ("one", "two"):
        make["known cameras"](folder / name / "set")


def test_no_two_commands_write_to_one_place(tmp_path):
    alike(tmp_path)
    several = 0
    for each in inspect(tmp_path).suggestions:
        words = [word for command in each.commands for word in shlex.split(command)]
        written = [word for word in words if word.startswith(("output=", "figure="))]
        assert len(set(written)) == len(written), written
        several += len(written) > 1
    assert several == 4  # walk, localize, benchmark, trajectory


def test_a_suffix_is_kept_where_it_tells_two_apart(tmp_path):
    (tmp_path / "drive.1").mkdir()
    inputs = [Path("night.mp4"), Path("drive.1"), Path("day/night.mp4")]
    found = outputs("walk", tmp_path, inputs)
    assert [path.as_posix() for path in found.values()] == ["walk/night", "walk/drive.1", "walk/day/night"]
    (tmp_path / "night").mkdir()
    assert outputs("walk", tmp_path, [Path("night.mp4")]) == {Path("night.mp4"): Path("walk/night.mp4")}
    (tmp_path / "night").rmdir()
    several = [*inputs, Path("night.bag")]
    assert outputs("walk", tmp_path, several) == {each: Path("walk", each) for each in several}


@pytest.mark.parametrize("plane", [True, False])
def test_photos_are_located_only_in_poses_that_locate_reads(plane, tmp_path):
    """It reads poses.csv before others, which must be of six dimensions."""
    for k, drive in enumerate(("office", "photos")):
        write_pictures(tmp_path / drive, names(), first=20 * k)
    WRITERS["nerfstudio"][1](tmp_path / "office" / "transforms.json", names(), some_poses(N))
    if plane:
        rows = [f"{name},{k},0,0" for k, name in enumerate(names())]
        (tmp_path / "office" / "poses.csv").write_text("\n".join(["file,x,y,heading", *rows]))
    commands = [each for suggestion in inspect(tmp_path).suggestions for each in suggestion.commands]
    assert any(each.startswith("sextant locate ") for each in commands) is not plane


@pytest.mark.parametrize("missing", [0, 2])
def test_photos_are_located_only_where_each_photo_has_a_pose_in_order(missing, tmp_path):
    for k, drive in enumerate(("office", "photos")):
        write_pictures(tmp_path / drive, names(), first=20 * k)
    lines = [f"1 0 0 {k} 0 1 0 0 0 0 1 0" for k in range(N - missing)]
    (tmp_path / "office" / "poses.txt").write_text("\n".join(lines))
    commands = [each for suggestion in inspect(tmp_path).suggestions for each in suggestion.commands]
    assert any(each.startswith("sextant locate ") for each in commands) is not bool(missing)


def test_what_may_not_be_read_is_named(tmp_path, monkeypatch):
    """Root may read everything, so the refusals are made here."""
    photos(tmp_path / "mine")
    photos(tmp_path / "theirs")

    def refused(path):
        if Path(path).name == "theirs":
            raise PermissionError(13, "Permission denied", str(path))
        return scan(path)

    scan = os.scandir
    monkeypatch.setattr(os, "scandir", refused)
    assert inspect(tmp_path).seen.unreadable == {"theirs": "cannot be read: Permission denied"}
    monkeypatch.undo()

    def closed(path, **_):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("PIL.Image.open", closed)
    assert inspect(tmp_path / "mine").seen.unreadable["0.jpg"] == "cannot be read: Permission denied"


def test_photos_are_read_by_their_headers_alone(tmp_path, monkeypatch):
    photos(tmp_path, 5)
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", lambda image: pytest.fail("it was decoded"))
    steps = []

    class Advance:
        def __enter__(self):
            return lambda done, total: steps.append((done, total))

        def __exit__(self, *_):
            pass

    assert len(inspect(tmp_path, lambda what, unit: Advance()).seen.headers) == 5
    assert steps[:5] == [(k, 5) for k in range(1, 6)]


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Files of poses and photos that can be read, and a folder for damaged ones."""
    folder = tmp_path_factory.mktemp("good")
    for form in ("csv", "tum", "kitti", "colmap", "opensfm", "nerfstudio"):
        drives(folder / form, form)
    tables = [next(folder.glob(f"{form}/map/**/{name}")) for form, name in POSE_FILES.items()]
    tagged = photo(
        folder / "a.jpg", camera=("Apple", "iPhone 12"), taken=5, note=apple_note(8), gps={1: "N", 2: (1, 2, 3)}
    )
    damaged = tmp_path_factory.mktemp("damaged")
    return [(path.name, path.read_bytes()) for path in (*tables, tagged, photo(folder / "b.png"))], damaged


@pytest.mark.slow
@fuzz
@given(
    which=st.integers(0, 7),
    edits=st.lists(st.tuples(st.integers(0, 3000), st.integers(0, 9), st.binary(max_size=6)), min_size=1, max_size=5),
)
def test_damage_anywhere_is_a_line_and_no_traceback(good, which, edits):
    files, folder = good
    name, content = files[which]
    for at, cut, piece in edits:
        at %= len(content) or 1
        content = content[:at] + piece + content[at + cut :]
    (folder / name).write_bytes(content)
    try:
        with suppress(UserError):  # one file of which nothing can be read
            json.dumps(inspect(folder / name).facts(), allow_nan=False)
    finally:
        (folder / name).unlink()


def test_what_is_not_there_is_one_message(tmp_path):
    with pytest.raises(UserError, match=r"input=.*nowhere does not exist"):
        inspect(tmp_path / "nowhere")


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("folder", "expected"),
    [
        ("photos", ["gravity: 10 by accelerometer (Mapillary)", "GPS: 10 images", "output=calibrated/lund camera"]),
        ("panoramas", ["panoramas: 88", "dataset=panorama_folder"]),
        ("essex3in1", ["2 folders, reference as the map; equal names"]),
        ("kitti", ["poses/00.txt", "1 pairs of files"]),
        ("cold", ["map.json (cold): 4,111 poses", "dataset=cold"]),
        ("york_urban", ["ground truth beside the photos: york_urban.csv"]),
        ("butterflies", ["5 folders of images, 001 to 009: if each is a class"]),
    ],
)  # fmt: skip
def test_real_sets_are_recognised(folder, expected, real_data):
    found = inspect(real_data / folder)
    for text in expected:
        assert text in said_of(found), said_of(found)
    for command in (command for each in found.suggestions for command in each.commands):
        check(Command("guide.md", command))


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("lost.tum", "0 1 2 3 0 0 0 0\n1 1 2 3 0 0 0 0\n", "(tum): 2 lines cannot be used"),
        ("a.txt", "1 0 0 nan 0 1 0 0 0 0 1 0\n", "(kitti): line 1: 12 finite numbers are expected"),
        ("poses.csv", "a.jpg,1,2,3\n", "(csv): columns a.jpg, 1, 2, 3; the first line must name file, x and y"),
    ],
)
def test_poses_that_cannot_be_used_are_told(file, text, told, tmp_path):
    (tmp_path / file).write_text(text)
    said = said_of(inspect(tmp_path))
    assert f"{file} {told}" in said
    assert "there is nothing here" not in said
    with pytest.raises(UserError, match=re.escape(f"input={tmp_path / file} {told}")):
        inspect(tmp_path / file)
