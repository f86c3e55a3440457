"""A walk with an unknown camera through a rendered town, in a map by another camera in another season."""

import csv
import json
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from PIL import Image

from sextant import Localizer, PhotoCalibrator, cli
from sextant.data.photos import Pinhole
from sextant.errors import UserError
from sextant.geometry import PerspectiveCamera, level_camera_pose
from sextant.tools.walks.posed_images import PosedImages
from sextant.tools.walks.shared_camera import SharedCamera, shared_view
from sextant.tools.walks.walking import _straightened_map, localize_walk
from sextant.worlds import Rays, Town, condition, drive, irregular_streets, random_walk

#: vertical fields of view of the map's camera and the walk's, whose lens is a barrel, which looks up and is rolled
NARROW, WIDE, K1, TILT, ROLL = 0.96, 1.25, -0.25, 0.08, 0.05
SIZE = (224, 168)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walk")
    streets = irregular_streets(size_m=200, block_m=80, seed=3)
    town, way = Town(streets, seed=3), random_walk(streets, 150, seed=1)
    mapped = drive(streets, way, seed=2).sample_by_distance(3).poses
    walked = drive(streets, way, seed=5).sample_by_distance(3).poses[12:36]
    shoot(folder / "summer", town, condition("summer_noon"), mapped, PerspectiveCamera.from_vfov(NARROW, *SIZE))
    lens = PerspectiveCamera.from_vfov(WIDE, *SIZE, k1=K1)
    shoot(folder / "autumn", town, condition("autumn_morning"), walked, lens, TILT, ROLL)
    (folder / "autumn" / "poses.csv").rename(folder / "truth.csv")
    motion = np.column_stack([walked, walked])[:, :3]
    rows = [f"{k:03d}.png,{x},{y},{turn}" for k, (x, y, turn) in enumerate(motion)]
    (folder / "odometry.csv").write_text("\n".join(["file,x,y,theta", *rows]))
    return SimpleNamespace(folder=folder, poses=walked)


def shoot(folder, town, look, poses, camera, tilt=0.0, roll=0.0):
    """Pictures of a town with their poses; returns the pictures."""
    at = np.stack([level_camera_pose(x, y, 1.6, turn, tilt, roll).numpy() for x, y, turn in poses])
    folder.mkdir(parents=True)
    images = list(town.renderer(look).pictures(Rays.of_camera(camera, 1), at, look))
    for k, image in enumerate(images):
        Image.fromarray(image).save(folder / f"{k:03d}.png")
    rows = [f"{k:03d}.png,{x},{y},{np.degrees(turn)}" for k, (x, y, turn) in enumerate(poses)]
    (folder / "poses.csv").write_text("\n".join(["file,x,y,heading", *rows]))
    return images


@pytest.fixture(scope="module")
def walked(world):
    """The command, once."""
    out = world.folder / "out"
    words = [f"input={world.folder / 'autumn'}", f"map={world.folder / 'summer'}", f"output={out}"]
    more = [f"odometry={world.folder / 'odometry.csv'}", "photos=8", "replay=none", "rows=48"]
    cli.run("walk", [*words, *more])
    return out


def away(out, poses):
    found = [(float(row["x"]), float(row["y"])) for row in csv.DictReader((out / "poses.csv").open())]
    return np.hypot(*(np.array(found) - poses[:, :2]).T)


@pytest.mark.slow
def test_it_is_where_it_was(walked, world):
    assert np.mean(away(walked, world.poses)[4:] < 5) > 0.9


@pytest.mark.slow
def test_its_camera_is_told_with_intervals(walked):
    told = json.loads((walked / "walk.json").read_text())
    for name, vfov in (("walk", WIDE), ("map", NARROW)):
        camera = told["cameras"][name]["camera"]
        low, high = camera["intervals"]["95"]["focal_px"]
        assert low < SIZE[1] / 2 / np.tan(vfov / 2) < high
        assert told["cameras"][name]["photos"] == 8
    found = [told["cameras"][name]["focal_of_longer_side"] for name in ("walk", "map")]
    assert found[0] / found[1] == pytest.approx(np.tan(NARROW / 2) / np.tan(WIDE / 2), rel=0.25)
    assert told["cameras"]["walk"]["tilt_deg"] == pytest.approx(np.degrees(TILT), abs=3)
    assert told["cameras"]["walk"]["roll_deg"] == pytest.approx(np.degrees(ROLL), abs=3)
    assert told["unseen"] < 0.1


@pytest.mark.slow
def test_the_page_has_what_was_found_and_its_pictures(walked):
    page = (walked / "report.md").read_text()
    assert "| focal length, px |" in page
    assert "| images | 24 |" in page
    for name in ("trajectory.png", "straightened.png"):
        assert f"({name})" in page
        assert Image.open(walked / name).width > 300


@pytest.mark.slow
def test_a_second_walk_may_be_a_video_in_the_map_of_the_first(walked, world):
    video = world.folder / "walk.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"MJPG"), 10, SIZE)
    for path in sorted((world.folder / "autumn").glob("*.png"))[:8]:
        writer.write(cv2.imread(str(path)))
    writer.release()
    shown = []
    found = localize_walk(
        video, walked / "map", world.folder / "second", calibrator=PhotoCalibrator.load(), photos=2, every=2,
        start="appearance", smooth=True, replay="none", progress=lambda what, unit: shown.append(what) or _silent(),
    )  # fmt: skip
    assert len(found.rows) == 4
    assert found.map_camera is None
    assert found.view == Pinhole(**Localizer.load(walked / "map").facts["view"])
    assert shown == ["calibrating the walk", "localizing", "smoothing"]
    assert {path.name for path in found.files} >= {"report.md", "walk.json", "smoothed.tum"}
    assert "| – |" in (world.folder / "second" / "report.md").read_text()
    medians = [np.median(away(world.folder / "second", world.poses[:8:2]))]
    for seed in (1, 2, 3):  # four frames of one seed are 2.6 to 5.7 m away in the median
        localize_walk(
            video, walked / "map", world.folder / f"second{seed}", calibrator=PhotoCalibrator.load(), photos=2,
            every=2, start="appearance", replay="none", seed=seed,
        )  # fmt: skip
        medians.append(np.median(away(world.folder / f"second{seed}", world.poses[:8:2])))
    assert np.mean(medians) < 6  # 6 m apart, without odometry


def _silent():
    from sextant.reporter import SILENT

    return SILENT.progress("", "")


@pytest.mark.slow
def test_a_map_that_does_not_tell_its_camera_needs_a_field_of_view(walked, world, tmp_path):
    localizer = Localizer.load(walked / "map")
    localizer.facts = {}
    localizer.save(tmp_path / "map")
    given = {"photos": 1, "replay": "none", "held": "level"}
    with pytest.raises(UserError, match="does not record the camera of its images"):
        localize_walk(world.folder / "autumn", tmp_path / "map", tmp_path / "out", **given)


class NeverAsked:
    """A calibrator of mistakes that are known before it has its turn."""

    def one_camera(self, *_, **__):
        raise AssertionError("calibrated first")


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [{"descriptor": "Hog"}, {"rows": 120}, {"vfov_deg": 55}])
def test_what_a_saved_map_has_of_its_own_is_not_given_again(walked, world, tmp_path, wrong):
    name, value = next(iter(wrong.items()))
    with pytest.raises(UserError, match=f"{name}={value} does not apply to map=.*: a saved map has its own"):
        localize_walk(world.folder / "autumn", walked / "map", tmp_path / "out", calibrator=NeverAsked(), **wrong)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (
            {"descriptor": "Hogg"},
            "descriptor=Hogg is neither one of Hog, PatchNormalised, Pixels, WhitenedPCA nor a run",
        ),
        ({"rows": 4}, "rows=4 must be from 8 to 1080"),
        ({"rows": 100_000}, "rows=100000 must be from 8 to 1080"),
        ({"vfov_deg": 170}, "vfov_deg=170 must be between"),
        ({"held": "upside_down"}, "held=upside_down must be one of"),
    ],
)
def test_mistakes_are_told_before_any_camera_is_looked_for(tmp_path, wrong, says):
    for name in ("autumn", "summer"):
        (tmp_path / name).mkdir()
        for k in range(3):
            Image.new("RGB", (64, 48), (40 * k, 90, 20)).save(tmp_path / name / f"{k:03d}.png")
        (tmp_path / name / "poses.csv").write_text("file,x,y,heading\n000.png,0,0,0\n001.png,1,0,0\n002.png,2,0,0\n")
    (tmp_path / "autumn" / "poses.csv").unlink()
    with pytest.raises(UserError, match=says):
        localize_walk(tmp_path / "autumn", tmp_path / "summer", tmp_path / "out", calibrator=NeverAsked(), **wrong)


def test_the_home_folder_of_the_output_is_meant(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "found").touch()
    with pytest.raises(UserError, match=f"output={tmp_path}/found is not a folder"):
        localize_walk(tmp_path / "walk", tmp_path / "map", "~/found", calibrator=NeverAsked())


def test_an_image_of_the_map_that_cannot_be_read_is_left_out_with_a_remark(tmp_path):
    rng = np.random.default_rng(0)
    for name in "abc":
        Image.fromarray(rng.integers(0, 255, (60, 80, 3), np.uint8)).save(tmp_path / f"{name}.png")
    (tmp_path / "b.png").write_bytes(b"no picture")
    paths = [tmp_path / f"{name}.png" for name in "abc"]
    mapped = PosedImages(paths, np.arange(9.0).reshape(3, 3), tmp_path, ("another remark",))
    images, kept = _straightened_map(mapped, camera(0.9), Pinhole(40, 30, 31.0))
    assert images.shape == (2, 30, 40, 3)
    assert kept.paths == [paths[0], paths[2]]
    assert kept.poses.tolist() == mapped.poses[[0, 2]].tolist()
    assert kept.remarks[0] == "another remark"
    assert kept.remarks[1].startswith("1 of 3 images of the map cannot be read, hence left out: ")
    assert "b.png" in kept.remarks[1]


# --- the view that two cameras share ----------------------------------------------------------------------------------


def camera(vfov, k1=0.0, k2=0.0, tilt=0.0):
    focal = 240 / 2 / np.tan(vfov / 2) / 320
    return SharedCamera(320, 240, focal, k1, k2, np.array([tilt]), np.array([0.0]), {})


def test_of_two_cameras_the_narrower_is_the_view():
    view = shared_view([camera(0.9), camera(1.3)], 120)
    assert np.radians(view.vfov_deg) == pytest.approx(0.9)
    assert (view.width, view.height, view.tilt) == (160, 120, 0)


def test_cameras_that_look_up_and_down_share_what_lies_between():
    view = shared_view([camera(0.9, tilt=0.1), camera(0.9, tilt=-0.1)], 120)
    assert view.tilt == 0
    assert np.radians(view.vfov_deg) / 2 == pytest.approx(0.45 - 0.1)
    assert shared_view([camera(0.9, tilt=0.1)], 120).tilt == pytest.approx(0.1)
    with pytest.raises(UserError, match="no view in common"):
        shared_view([camera(0.9, tilt=0.6), camera(0.9, tilt=-0.6)])


@pytest.mark.parametrize("cameras", [[camera(0.9), camera(1.2, -0.25, 0.045)], [camera(0.9, tilt=0.1), camera(0.8)]])
def test_nothing_of_the_view_is_beyond_the_photos(cameras):
    view = shared_view(cameras, 60)
    image = np.zeros((240, 320, 3), np.uint8)
    assert max(each.straighten(image, view, 0)[1] for each in cameras) < 0.02


@pytest.mark.parametrize("wrong", [{"rows": 4}, {"vfov_deg": 0.0}, {"vfov_deg": 179.0}])
def test_a_view_of_nothing_is_refused(wrong):
    with pytest.raises(UserError, match=next(iter(wrong))):
        shared_view([camera(0.9)], **wrong)


def test_how_a_camera_is_held_is_one_of_three():
    with pytest.raises(UserError, match="held=upside_down must be one of mounted, by_hand, level"):
        SharedCamera.of(SimpleNamespace(), "upside_down")
