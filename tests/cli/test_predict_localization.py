"""Photos and videos localized in the map of a run."""

import csv
import json
import shutil

import cv2
import numpy as np
import pytest
from made_up_bags import Bags

from sextant import Localizer
from sextant.chapters.localization import written_poses
from sextant.chapters.localization.data.odometry_file import motions_of, read_odometry
from sextant.chapters.localization.data.pose_formats import read_tum, write_tum
from sextant.chapters.localization.written_poses import Moment, Replay, Row
from sextant.cli import predict
from sextant.console import work_progress
from sextant.errors import UserError
from sextant.geometry.planar import se2_compose


def odometry_poses(office):
    """The motions of the drive, one after the other."""
    import torch

    poses = [torch.zeros(1, 3, dtype=torch.float64)]
    for motion in office.motions[1:]:
        poses.append(se2_compose(poses[-1], torch.from_numpy(motion[None])))
    return torch.cat(poses).numpy()


def table(path, poses, names=None):
    header = "x,y,theta" + (",file" if names else "")
    rows = [",".join(map(repr, pose.tolist())) + (f",{names[k]}" if names else "") for k, pose in enumerate(poses)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def localize(office, given, output, *more):
    predict.main([f"run={office.folder}", f"input={given}", f"output={output}", "replay=none", *map(str, more)])
    with (output / "poses.csv").open() as file:
        return list(csv.DictReader(file))


def test_it_says_what_a_localizer_says_bit_by_bit(office, photos, tmp_path, capsys):
    odometry = table(tmp_path / "odometry.csv", odometry_poses(office))
    rows = localize(office, photos, tmp_path / "out", f"odometry={odometry}", "seed=3", "particles=300")
    motions, _ = motions_of(read_odometry(odometry), [str(k) for k in range(office.frames)], None, odometry)
    localizer = Localizer.load(office.folder, seed=3, particles=300)
    told = [localizer.step(m, image) for m, image in zip(motions, office.images, strict=True)]
    times, poses = read_tum(tmp_path / "out" / "trajectory.tum")
    assert np.array_equal(poses[:, :2], np.stack([one.pose[:2] for one in told]))
    assert np.array_equal(times, np.arange(office.frames))
    assert [row["file"] for row in rows] == [f"{k:04d}.png" for k in range(office.frames)]
    for row, one in zip(rows, told, strict=True):
        assert float(row["x"]) == pytest.approx(one.pose[0], abs=1e-6)
        assert float(row["sigma_heading_deg"]) == pytest.approx(np.degrees(one.sigmas[2]), abs=1e-6)
        assert float(row["off_map"]) == pytest.approx(one.off_map, abs=1e-6)
        assert row["lost"] == str(one.lost).lower()
        assert int(row["modes"]) == one.modes
    assert (tmp_path / "out" / "trajectory.png").stat().st_size > 1000
    assert f"{office.frames} images" in capsys.readouterr().out.replace("\n", " ")


def test_motions_come_back_from_poses(office, tmp_path):
    odometry = table(tmp_path / "odometry.csv", odometry_poses(office))
    names = [str(k) for k in range(office.frames)]
    motions, remarks = motions_of(read_odometry(odometry), names, None, odometry)
    assert motions[0] is None
    assert np.allclose(np.stack(motions[1:]), np.stack(office.motions[1:]), atol=1e-9)
    assert remarks == []


def test_without_odometry_it_says_so_and_files_that_are_no_photos_are_blackouts(office, photos, tmp_path, capsys):
    (photos / "0003.png").write_bytes(b"not a picture")
    (photos / "0004.png").write_bytes(b"")
    rows = localize(office, photos, tmp_path / "out")
    assert [bool(row["error"]) for row in rows[:6]] == [False, False, False, True, True, False]
    said = " ".join(capsys.readouterr().out.split())
    assert "no odometry= was given" in said
    assert "2 could not be used" in said
    assert "Skipped (2)" in said
    assert "0003.png │ cannot be decoded" in said
    localizer = Localizer.load(office.folder)
    blind = [localizer.step(None, None if k in (3, 4) else image) for k, image in enumerate(office.images)]
    _, poses = read_tum(tmp_path / "out" / "trajectory.tum")
    assert np.array_equal(poses[:, :2], np.stack([one.pose[:2] for one in blind]))


def test_a_row_of_the_odometry_whose_file_is_missing_is_a_blackout(office, photos, tmp_path):
    names = [f"{k:04d}.png" for k in range(office.frames)]
    odometry = table(tmp_path / "odometry.csv", odometry_poses(office), names)
    (photos / "0002.png").unlink()
    rows = localize(office, photos, tmp_path / "out", f"odometry={odometry}")
    assert [row["file"] for row in rows] == names
    assert rows[2]["error"] == "there is no such file"
    table(odometry, odometry_poses(office)[5:], names[5:])
    with pytest.raises(UserError, match=r"no row for 4 of .* photos, such as 0000.png"):
        localize(office, photos, tmp_path / "out", f"odometry={odometry}")


def test_names_that_tell_the_time_are_matched_with_a_trajectory_and_gaps_are_told(office, tmp_path, capsys):
    photos = office.photos(tmp_path / "photos", "{k:04d}.500000.png")
    poses, times = odometry_poses(office), np.arange(office.frames) + 0.5
    keep = np.ones(office.frames, bool)
    keep[10:20] = False
    write_tum(tmp_path / "o.tum", times[keep], poses[keep])
    localize(office, photos, tmp_path / "out", f"odometry={tmp_path / 'o.tum'}")
    assert "10 images lie outside of the trajectory" in " ".join(capsys.readouterr().out.split())
    assert np.array_equal(read_tum(tmp_path / "out" / "trajectory.tum")[0], times)
    write_tum(tmp_path / "o.tum", times + 1e6, poses)
    with pytest.raises(UserError, match="none at a time with a pose"):
        localize(office, photos, tmp_path / "out", f"odometry={tmp_path / 'o.tum'}")


def test_gaps_in_the_time_of_rows_are_told(office, tmp_path):
    times = np.arange(5.0)
    times[3:] += 60
    write_tum(tmp_path / "o.tum", times, odometry_poses(office)[:5])
    _, remarks = motions_of(read_odometry(tmp_path / "o.tum"), list("abcde"), None, tmp_path / "o.tum")
    assert "1 gaps in time above 5 s, the first, of 61.0 s, before d" in remarks[0]


@pytest.mark.parametrize("every", [1, 2])
def test_a_video(office, tmp_path, every):
    path = tmp_path / "drive.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (96, 64))
    for image in office.images[:9]:
        video.write(cv2.resize(image[..., ::-1], (96, 64)))
    video.release()
    rows = localize(office, path, tmp_path / "out", f"every={every}")
    assert [row["file"] for row in rows] == [f"frame {k}" for k in range(0, 9, every)]
    assert np.allclose(read_tum(tmp_path / "out" / "trajectory.tum")[0], np.arange(0, 9, every) / 10)
    odometry = table(tmp_path / "odometry.csv", odometry_poses(office)[:9])
    assert len(localize(office, path, tmp_path / "out", f"every={every}", f"odometry={odometry}")) == len(rows)


def test_a_recording_of_a_robot_is_localized_as_its_images_and_odometry_are(office, tmp_path):
    poses, bags = odometry_poses(office)[:9], Bags(2)
    messages = [("/camera", k + 1, bags.image(k + 1, image)) for k, image in enumerate(office.images[:9])]
    messages += [("/odom", k + 1, bags.odometry(k + 1, x, turn, y)) for k, (x, y, turn) in enumerate(poses.tolist())]
    bag = bags.write(tmp_path, sorted(messages, key=lambda message: message[1]))
    rows = localize(office, bag, tmp_path / "bag", "seed=3")
    photos = office.photos(tmp_path / "photos")
    for photo in sorted(photos.iterdir())[9:]:
        photo.unlink()
    by_photos = localize(office, photos, tmp_path / "out", f"odometry={table(tmp_path / 'o.csv', poses)}", "seed=3")
    for row, photo in zip(rows, by_photos, strict=True):
        assert float(row["x"]) == pytest.approx(float(photo["x"]), abs=1e-4)
        assert float(row["y"]) == pytest.approx(float(photo["y"]), abs=1e-4)


def test_a_drive_is_smoothed_and_the_filter_goes_as_without_it(office, photos, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(work_progress, "LINE_S", 0.0)
    odometry = table(tmp_path / "odometry.csv", odometry_poses(office))
    plain = localize(office, photos, tmp_path / "plain", f"odometry={odometry}", "particles=300")
    rows = localize(office, photos, tmp_path / "out", f"odometry={odometry}", "particles=300", "smooth=true")
    assert rows == plain
    assert f"smoothing {office.frames}/{office.frames} images" in capsys.readouterr().out
    filtered, smooth = (read_tum(tmp_path / "out" / f"{name}.tum")[1] for name in ("trajectory", "smoothed"))
    assert np.allclose(filtered[-1], smooth[-1])
    truth = office.drive.poses[: office.frames]
    errors = [np.hypot(*(poses - truth)[:, :2].T) for poses in (filtered, smooth)]
    assert errors[1][0] < errors[0][0]  # where it began is known better at the end
    assert np.median(errors[1]) <= np.median(errors[0])


def test_a_moved_map_alone_one_particle_and_a_replay(office, photos, tmp_path):
    shutil.copytree(office.folder / "map", tmp_path / "elsewhere")
    for path in sorted(photos.iterdir())[4:]:
        path.unlink()
    arguments = [f"run={tmp_path / 'elsewhere'}", f"input={photos}", f"output={tmp_path / 'out'}", "particles=1"]
    predict.main([*arguments, "replay=gif", "start=appearance"])
    assert (tmp_path / "out" / "replay.gif").read_bytes().startswith(b"GIF89a")
    predict.main(arguments)
    assert (tmp_path / "out" / "replay.mp4").stat().st_size > 1000


def test_a_replay_of_a_long_run_keeps_few_frames_evenly(monkeypatch):
    monkeypatch.setattr(written_poses, "MOST_FRAMES", 8)
    replay, row = Replay(), Row("0.png", None)
    for step in range(100):
        replay.add(Moment(step, row, np.zeros((2, 3), np.float32), np.zeros(2, np.float32)))
    steps = [moment.step for moment in replay.kept]
    assert len(steps) <= 8
    assert steps == list(range(0, 100, replay.stride))


def test_results_do_not_go_among_the_photos(office, photos):
    with pytest.raises(UserError, match=r"is input=.*would be mixed with it"):
        localize(office, photos, photos)
    first = localize(office, photos, photos / "found")
    assert len(localize(office, photos, photos / "found")) == len(first)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["input={empty}"], "no photo there"),
        ([], "input= is missing"),
        (["input={photos}", "odometry={short}"], "has 3 rows for 40 images, 0000.png to 0039.png"),
        (["input={photos}", "odometry={none}"], "none.csv does not exist"),
        (["input={photos}", "odometry={columns}"], "has the columns a, b, c"),
        (["input={photos}", "odometry={words}"], "line 2 is not a pose: 1,two,3"),
        (["input={photos}", "every=2"], "every=2 applies to a video"),
        (["input={photos}", "particles=0"], "particles=0 must be a whole number from 1"),
        (["input={photos}", "start=here"], "start=here must be one of uniform, appearance"),
        (["input={photos}", "camera=one"], "camera= belongs to calibration"),
        (["input={photos}", "matches=3"], "matches= belongs to place_recognition"),
        (["input={bad}"], "none of 1 image can be used\n  a.png: cannot be decoded"),
        (["input={video}"], "cannot be read as a video"),
        (["input={disorder}"], "images are out of order"),
    ],
)
def test_mistakes_are_told_in_one_message(office, photos, tmp_path, arguments, says):
    places = {name: tmp_path / name for name in ("empty", "bad", "disorder")}
    for folder in places.values():
        folder.mkdir()
    (places["bad"] / "a.png").write_bytes(b"x")
    for name in ("a1305031102.5.png", "b1305031101.5.png"):
        shutil.copy(photos / "0000.png", places["disorder"] / name)
    texts = {"short": "0,0,0\n1,0,0\n2,0,0\n", "columns": "a,b,c\n1,2,3\n", "words": "x,y,theta\n1,two,3\n"}
    for name, text in texts.items():
        places[name] = tmp_path / f"{name}.csv"
        places[name].write_text(text)
    places |= {"photos": photos, "none": tmp_path / "none.csv", "video": tmp_path / "v.mp4"}
    places["video"].write_bytes(b"no video")
    assert office.frames == 40
    given = [argument.format(**places) for argument in arguments]
    with pytest.raises(UserError) as caught:
        predict.main([f"run={office.folder}", f"output={tmp_path / 'out'}", "replay=none", *given])
    assert says in str(caught.value)


def test_a_run_without_a_map_and_a_damaged_one(office, photos, tmp_path):
    run = shutil.copytree(office.folder, tmp_path / "run")
    descriptors = run / "map" / "descriptors.npy"
    descriptors.write_bytes(descriptors.read_bytes()[:-8])
    with pytest.raises(UserError, match="is damaged"):
        predict.main([f"run={run}", f"input={photos}", f"output={tmp_path / 'out'}"])
    shutil.rmtree(run / "map")
    with pytest.raises(UserError, match="saved no map"):
        predict.main([f"run={run}", f"input={photos}", f"output={tmp_path / 'out'}"])


def test_a_localizer_opens_by_the_name_of_its_run(office, tmp_path):
    outputs = office.folder.parents[2]
    by_name, by_folder = Localizer.load(office.folder.name, outputs=outputs), Localizer.load(office.folder)
    assert by_name.descriptor.identity == by_folder.descriptor.identity
    with pytest.raises(UserError, match="there is no such folder"):
        Localizer.load(office.folder.name, outputs=tmp_path)


def test_the_run_keeps_trajectories_and_an_animation(office):
    names = {path.relative_to(office.folder).as_posix() for path in office.folder.rglob("*") if path.is_file()}
    assert {"trajectories/summer_noon_estimate.tum", "trajectories/summer_noon_truth.tum"} <= names
    assert "figures/replay_summer_noon.gif" in names
    facts = json.loads((office.folder / "map" / "map.json").read_text())["facts"]
    assert facts["about"]["protocol"]["name"] == "office"
