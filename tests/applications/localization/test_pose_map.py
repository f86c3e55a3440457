"""Photos located in posed photos, through Python and by ``sextant locate``, on photos with laser-measured poses."""

import csv
import json
import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from made_up_bags import Bags
from PIL import Image
from scipy.spatial.transform import Rotation

pytest.importorskip("kornia")
pytest.importorskip("poselib")

from sextant import PoseMap, cli
from sextant.applications.pixels import as_pixels
from sextant.chapters.localization import pose_map_files
from sextant.chapters.localization.data.own_drive import find_images
from sextant.chapters.localization.data.posed_photos import PhotoLens, StraightPhotos, posed_photos
from sextant.chapters.localization.given_cameras import cameras_of
from sextant.chapters.localization.locating import LocatedFrame, locate_frames, write_located
from sextant.chapters.localization.pose_map import LocatedPhoto
from sextant.chapters.localization.pose_map_files import FORMAT, _extractor
from sextant.chapters.places.photo_features import extractor_of
from sextant.correspondence import LocalFeatures, Pinhole, XFeatures, detected
from sextant.errors import ArgumentError, UserError

DATA = os.environ.get("SEXTANT_DATA")
FOLDER = Path(DATA or ".") / "strecha_posed"
real = pytest.mark.skipif(not DATA, reason="SEXTANT_DATA does not name a folder with real data")


def fountain():
    """Files, poses and the camera of the photos of one scene."""
    with (FOLDER / "poses.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["scene"] == "fountain-P11"]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for pose, row in zip(poses, rows, strict=True):
        pose[:3, :3] = [[float(row[f"r{i}{j}"]) for j in range(3)] for i in range(3)]
        pose[:3, 3] = [float(row[key]) for key in ("cx_m", "cy_m", "cz_m")]
    camera = tuple(float(rows[0][key]) for key in ("fx", "fy", "ppx", "ppy"))
    return [FOLDER / row["file"] for row in rows], poses, camera


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder of five posed photos, one of another pose, and its truth."""
    files, poses, camera = fountain()
    folder = tmp_path_factory.mktemp("posed")
    (folder / "map").mkdir()
    (folder / "photos").mkdir()
    lines = ["file,x,y,z,qw,qx,qy,qz,fx,fy,cx,cy"]
    for k in (1, 2, 4, 5, 6):
        shutil.copy(files[k], folder / "map")
        x, y, z, w = Rotation.from_matrix(poses[k, :3, :3]).as_quat()
        lines.append(",".join(map(str, (files[k].name, *poses[k, :3, 3], w, x, y, z, *camera))))
    (folder / "map" / "poses.csv").write_text("\n".join(lines))
    shutil.copy(files[3], folder / "photos" / "query.jpg")
    Image.fromarray(np.full((300, 400, 3), 200, np.uint8)).save(folder / "photos" / "wall.png")
    return folder, poses[3], camera


@real
@pytest.mark.slow
def test_a_photo_is_located_within_centimetres(desk, capsys):
    folder, truth, camera = desk
    words = [
        f"map={folder / 'map'}",
        f"input={folder / 'photos'}",
        f"output={folder / 'out'}",
        f"save={folder / 'kept'}",
    ]
    cli.run("locate", words)
    assert "1 of 2 images located, 1 not in the map" in capsys.readouterr().out
    with (folder / "out" / "poses.csv").open() as file:
        query, wall = csv.DictReader(file)
    assert (query["verdict"], wall["verdict"]) == ("located", "not in the map")
    assert np.linalg.norm([float(query[key]) - truth[k, 3] for k, key in enumerate("xyz")]) < 0.10  # camera unknown
    assert (folder / "out" / "matches" / "query.jpg").stat().st_size > 10_000
    assert (folder / "out" / "from_above.png").is_file()
    kept = PoseMap.open(folder / "kept")
    found = kept.locate(folder / "photos" / "query.jpg", camera)
    assert np.linalg.norm(found.world_from_camera[:3, 3] - truth[:3, 3]) < 0.035
    turn = Rotation.from_matrix(truth[:3, :3].T @ found.world_from_camera[:3, :3]).magnitude()
    assert np.rad2deg(turn) < 0.1
    bags, pixels = Bags(2), np.asarray(Image.open(folder / "photos" / "query.jpg"))
    info = bags.camera(1, pixels.shape[1], pixels.shape[0], [camera[0], 0, camera[2], 0, camera[1], camera[3], 0, 0, 1])
    bag = bags.write(folder, [("/eye/camera_info", 1, info), ("/eye/image_raw", 1, bags.image(1, pixels))])
    cli.run("locate", [f"map={folder / 'kept'}", f"input={bag}", f"output={folder / 'of_bag'}"])
    assert "camera 1152x768" in capsys.readouterr().out.replace("\n", " ")
    with (folder / "of_bag" / "poses.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["fx"]) == pytest.approx(camera[0], abs=1e-3)  # the camera is known
    assert np.linalg.norm([float(row[key]) - truth[k, 3] for k, key in enumerate("xyz")]) < 0.035
    again = [f"map={folder / 'map'}", f"input={folder}", f"output={folder / 'out'}", "camera=1035,1037,570,377"]
    cli.run("locate", again)  # which does not take the pictures that the first run wrote
    assert "6 of 7 images located" in capsys.readouterr().out
    cli.run("locate", words[:3])
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction(str(folder / "out" / "colmap"))
    (image,) = model.images.values()
    assert image.name == "query.jpg"
    np.testing.assert_allclose(image.projection_center(), truth[:3, 3], atol=0.10)
    np.testing.assert_allclose(image.camera.params[2:], np.array(camera[2:]) + 0.5, atol=0.01)  # the map's


@dataclass(frozen=True)
class Rough:
    """A camera whose focal length is known roughly."""

    focal_px: float
    focal_sigma: float | None


@real
@pytest.mark.slow
def test_a_rough_focal_length_is_refined(desk):
    folder, truth, camera = desk
    poses = PoseMap.from_folder(folder / "map", side=512, keypoints=1500)
    found = poses.locate(folder / "photos" / "query.jpg", Rough(1.1 * camera[0], 0.1))
    assert found.camera.fx == pytest.approx(camera[0], rel=0.02)
    assert np.linalg.norm(found.world_from_camera[:3, 3] - truth[:3, 3]) < 0.15
    unbounded = Rough(1.1 * camera[0], None)
    assert poses.locate(folder / "photos" / "query.jpg", unbounded).camera.fx == pytest.approx(camera[0], rel=0.02)


@real
@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "named"),
    [
        (lambda poses: poses @ np.diag([1.0, -1.0, -1.0, 1.0]), r"y up and z back \(OpenGL"),
        (np.linalg.inv, "camera_from_world"),
        (lambda poses: poses @ np.diag([-1.0, -1.0, 1.0, 1.0]), "x left and y up"),
    ],
)
def test_axes_of_another_convention_are_named(changed, named):
    files, poses, camera = fountain()
    with pytest.raises(UserError, match=named):
        PoseMap.from_images(files[:3], changed(poses[:3]), camera, side=320)


@real
@pytest.mark.slow
def test_poses_of_other_photos_are_refused():
    files, poses, camera = fountain()
    with pytest.raises(UserError, match="of the matches of neighbouring images agree with their poses"):
        PoseMap.from_images(files[::2], poses[::2][[3, 0, 4, 1, 5, 2]], camera, side=320)


@real
@pytest.mark.slow
def test_photos_without_overlap_make_no_map():
    files, poses, _ = fountain()
    others = sorted((Path(DATA) / "york_urban").glob("*.jpg"))[:1]
    with pytest.raises(UserError, match="images overlap"):
        PoseMap.from_images([files[0], others[0]], poses[:2], (1035.0, 1035.0, 400.0, 300.0), side=320)


def test_a_photo_of_200_megapixels_is_refused(tmp_path):
    Image.new("1", (20_000, 10_000)).save(tmp_path / "large.png")
    with pytest.raises(UserError, match="more than 179 megapixels; scale it down"):
        as_pixels(tmp_path / "large.png")


def test_features_of_a_large_photo_are_in_its_pixels():
    rng = np.random.default_rng(0)
    small = np.kron(rng.integers(0, 255, (24, 32, 3), np.uint8), np.ones((8, 8, 1), np.uint8))
    large = np.kron(small, np.ones((4, 4, 1), np.uint8))
    one = XFeatures(200, 128).detect([small])[0]
    other = detected(XFeatures(200, 128), large)
    assert (other.width, other.height, other.pixel) == (1024, 768, 8.0)
    apart = np.linalg.norm(((one.points + 0.5) * 4 - 0.5)[:, None] - other.points[None], axis=2).min(1)
    assert np.median(apart) < other.pixel


@pytest.mark.parametrize(
    ("poses", "said"),
    [
        (np.eye(4), r"poses have the shape \(4, 4\) for 2 images"),
        (np.tile(np.eye(3), (2, 1, 1)), r"poses have the shape \(2, 3, 3\)"),
        (np.tile(np.diag([1.0, 1.0, -1.0, 1.0]), (2, 1, 1)), "its axes are mirrored"),
        (np.tile(2 * np.eye(4), (2, 1, 1)), "no rigid motion"),
        (np.eye(4) + np.eye(4, k=3) * [[[0.0]], [[1e10]]], r"pose 1: the position \(1e\+10, 0, 0\) is further away"),
        ("north", "poses have the shape"),
    ],
)
def test_poses_that_are_none_are_refused(poses, said):
    images = [np.zeros((64, 64, 3), np.uint8)] * 2
    with pytest.raises(UserError, match=said):
        PoseMap.from_images(images, poses)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"cameras": 500.0}, "must be .fx, fy, cx, cy., a Pinhole"),
        ({"cameras": [(1, 1, 0, 0)] * 3}, "3 cameras for 2 images"),
        ({"cameras": Pinhole.centred(100, 100, 90.0)}, "a camera of 100x100 pixels for an image of 64x64"),
        ({"cameras": (2.1, 2.1, 32, 32)}, r"camera=2.1,2.1,32,32: .* must be from 10 to 3840 pixels .*not millimetres"),
        ({"cameras": Pinhole(64, 64, 4.2, 4.2, 32, 32)}, "must be from 10 to 3840 pixels"),
        ({"cameras": (60, 60, 320, 240)}, "principal point is 5.9 focal lengths from the centre of an image of 64x64"),
        ({"names": ["a"]}, "1 name for 2 images"),
        ({"side": "320"}, "must be a whole number, at least 64"),
    ],
)
def test_arguments_that_do_not_fit_the_images_are_refused(arguments, said):
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = 1
    images = [np.random.default_rng(k).integers(0, 255, (64, 64, 3), np.uint8) for k in range(2)]
    with pytest.raises(UserError, match=said):
        PoseMap.from_images(images, poses, **({"cameras": (60, 60, 32, 32)} | arguments))


def test_added_images_may_come_from_an_iterator():
    images = (np.zeros((64, 64, 3), np.uint8) for _ in range(2))
    with pytest.raises(ArgumentError, match="3 names for 2 images"):
        PoseMap(None, [], None, None, None).add(images, np.tile(np.eye(4), (2, 1, 1)), names=iter("abc"))


def test_a_map_is_opened_from_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "poses").mkdir()
    with pytest.raises(UserError, match=r"/poses is not a saved map of posed photos: the folder has no pose_map\.json"):
        PoseMap.open("~/poses")


@real
def test_a_lens_of_a_model_is_straightened(desk, tmp_path):
    """What the lens bent outwards comes from further out; a camera of turned images is refused."""
    folder, _, (fx, fy, cx, cy) = desk
    lines = (folder / "map" / "poses.csv").read_text().splitlines()[1:]
    frames = []
    for line in lines:
        name, x, y, z, w, i, j, k, *_ = line.split(",")
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat([float(each) for each in (i, j, k, w)]).as_matrix()
        pose[:3, 3] = [float(each) for each in (x, y, z)]
        frames.append({"file_path": name, "transform_matrix": (pose @ np.diag([1, -1, -1, 1])).tolist()})
        shutil.copy(folder / "map" / name, tmp_path)
    lens = {"camera_model": "OPENCV", "fl_x": fx, "fl_y": fy, "cx": cx + 0.5, "cy": cy + 0.5, "w": 1152, "h": 768}
    pictures = []
    for k1 in (0.0, 0.2):
        (tmp_path / "transforms.json").write_text(json.dumps(lens | {"k1": k1, "frames": frames}))
        pictures.append(StraightPhotos(posed_photos(tmp_path))[0].astype(float).mean(2))
    plain, straight = pictures
    for share in (0.2, 0.4):  # of the focal length to the right of the axis: from where the lens bent it to
        seen, there = (round(cx + fx * each) for each in (share, share * (1 + 0.2 * share**2)))
        column, other = (image[200:560, k - 1 : k + 2].mean(1) for image, k in ((straight, seen), (plain, there)))
        assert np.corrcoef(column[170:190], other[170:190])[0, 1] > 0.9
    (tmp_path / "transforms.json").write_text(json.dumps(lens | {"w": 768, "h": 1152, "frames": frames}))
    with pytest.raises(UserError, match="EXIF turns it upright"):
        PoseMap.from_folder(tmp_path)


def test_a_model_of_other_images_is_refused_and_of_smaller_ones_scaled():
    lens = PhotoLens(640, 480, (500.0, 510.0, 319.5, 239.5, 0.1, 0.0, 0.0, 0.0))
    half = lens.of_size(320, 240, "a.jpg")
    assert half.opencv == (250.0, 255.0, 159.5, 119.5, 0.1, 0.0, 0.0, 0.0)
    with pytest.raises(UserError, match="EXIF turns it upright"):
        lens.of_size(480, 640, "a.jpg")
    with pytest.raises(UserError, match=r"a\.jpg has 640x640 pixels"):
        lens.of_size(640, 640, "a.jpg")


@real
@pytest.mark.slow
def test_a_map_of_other_local_features_opens_with_them_and_refuses_others(desk, tmp_path, capsys):
    folder, truth, camera = desk
    words = [f"map={folder / 'map'}", f"input={folder / 'photos'}", f"output={tmp_path / 'out'}"]
    cli.run("locate", [*words, f"save={tmp_path / 'kept'}", "local=trunk"])
    assert "1 of 2 images located, 1 not in the map" in capsys.readouterr().out
    kept = PoseMap.open(tmp_path / "kept")
    found = kept.locate(folder / "photos" / "query.jpg", camera)
    assert np.linalg.norm(found.world_from_camera[:3, 3] - truth[:3, 3]) < 0.05
    with pytest.raises(UserError, match="other local features"):
        PoseMap.open(tmp_path / "kept", local="xfeat")
    with pytest.raises(UserError, match="must be xfeat, trunk"):
        PoseMap.from_folder(folder / "map", local="sift")
    header = tmp_path / "kept" / "pose_map.json"
    assert json.loads(header.read_text())["local"] == "trunk"


@real
@pytest.mark.slow
def test_local_features_that_are_an_object_are_given_again(desk, tmp_path):
    folder, _, camera = desk
    own = XFeatures(np.int64(600), np.int64(320))  # a header holds plain numbers
    poses = PoseMap.from_folder(folder / "map", local=own)
    assert max(map(len, poses.posed.features)) <= 600
    poses.save(tmp_path)
    with pytest.raises(UserError, match="local features of an object"):
        PoseMap.open(tmp_path)
    again = PoseMap.open(tmp_path, local=own).locate(folder / "photos" / "query.jpg", camera)
    assert again.inliers == poses.locate(folder / "photos" / "query.jpg", camera).inliers


def test_four_cameras_are_one_of_each_of_four_images():
    """And not the four numbers of one camera."""
    lens, sizes = Pinhole.centred(64, 48, 60.0), np.empty((0, 2), np.float32)
    found = [LocalFeatures(sizes, np.empty((0, 64), np.float16), 64, 48)] * 4
    assert cameras_of([lens] * 4, found, np.empty(0), XFeatures()) == [lens] * 4
    for one in ((60, 61, 32, 24), np.array([60.0, 61.0, 32.0, 24.0])):
        assert cameras_of(one, found, np.empty(0), XFeatures()) == [Pinhole(64, 48, 60.0, 61.0, 32.0, 24.0)] * 4


def test_blank_walls_make_no_map():
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = 1
    with pytest.raises(UserError, match="blank walls"):
        PoseMap.from_images([np.full((96, 128, 3), 90, np.uint8)] * 2, poses, (100, 100, 64, 48))
    with pytest.raises(UserError, match="1 image makes no map"):
        PoseMap.from_images([np.zeros((96, 128, 3), np.uint8)], poses[:1])


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("poses.csv", "file,x,y\na.png,1,2\n", "poses.csv has no column z, qw, qx, qy, qz"),
        (
            "poses.csv",
            "file,x,y,z,qw,qx,qy,qz\na.png,0,0,0,2,0,0,0\n",
            "line 2: the quaternion qw,qx,qy,qz has length 2",
        ),
        ("poses.csv", "file,x,y,z,qw,qx,qy,qz\na.png,0,nan,0,1,0,0,0\n", "line 2: y is nan, not a finite number"),
        ("poses.csv", "file,x,y,z,qw,qx,qy,qz\na.png,,0,0,1,0,0,0\n", "line 2: x is empty, not a finite number"),
        ("poses.csv", "file,x,y,z,qw,qx,qy,qz\na.png,1e300,0,0,1,0,0,0\n", "line 2: the position (1e+300, 0, 0) is"),
        ("poses.csv", "file,x,y,z,qw,qx,qy,qz,X\na.png,0,0,0,1,0,0,0,1\n", "poses.csv has 2 columns named x"),
        ("poses.csv", "file,x,y,z,qw,qx,qy,qz\na.png,0,0,0,1,0,0\n", "line 2: 7 values for 8 columns"),
        ("poses.csv", "file,x,y,z,qw,qx,qy,qz,fx\na.png,0,0,0,1,0,0,0,50\n", "fx,fy,cx,cy only fx are there"),
        (
            "poses.csv",
            "file,x,y,z,qw,qx,qy,qz,fx,fy,cx,cy\na.png,0,0,0,1,0,0,0,50,50,30,20\nb.png,1,0,0,1,0,0,0,,,,\n",
            "fx,fy,cx,cy is missing in 1 row of 2, such as line 3 Give it in all rows, or in none",
        ),
        (
            "poses.csv",
            "file,x,y,z,qw,qx,qy,qz,fx,fy,cx,cy\na.png,0,0,0,1,0,0,0,-50,50,30,20\n",
            "1 camera cannot be used a.png: focal lengths of -50 and 50 pixels",
        ),
        (
            "poses.csv",
            "file,x,y,z,qw,qx,qy,qz,fx,fy,cx,cy\na.png,0,0,0,1,0,0,0,1e300,50,30,20\nb.png,1,0,0,1,0,0,0,50,50,1e9,20\n",
            "poses.csv: 2 cameras cannot be used a.png: fx,fy,cx,cy=1e+300,50,30,20: focal lengths of an image 40",
        ),
        (
            "transforms.json",
            '{"fl_x": 0, "fl_y": 50, "w": 60, "h": 40, "frames": [{"file_path": "a.png", "transform_matrix": '
            "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}",
            "1 camera cannot be used a.png: focal lengths of 0 and 50 pixels",
        ),
        ("poses.csv", "file,x,y,z,qw,qx,qy,qz\na.png,0,0,0,1,0,0,0\na.png,1,0,0,1,0,0,0\n", "a.png has 2 rows"),
        ("poses.csv", "file,x,y,z,qw,qx,qy,qz\na.png,1,5,0,0,1,0,0,0\n", "line 2: 9 values for 8 columns"),
        ("poses.csv", "file,x,y,z,qw,qx,qy,qz\nother.png,0,0,0,1,0,0,0\n", "but of none of the photos"),
        ("poses.tum", "0 0 0 0 0 0 0 1\n", "1 pose for 2 photos"),
        (None, "", "no file of poses there"),
    ],
)
def test_a_folder_without_usable_poses_is_refused(tmp_path, name, text, said, capsys):
    for k in "ab":
        Image.fromarray(np.full((40, 60, 3), 90, np.uint8)).save(tmp_path / f"{k}.png")
    if name:
        (tmp_path / name).write_text(text)
    (tmp_path.parent / "photo").mkdir(exist_ok=True)
    Image.fromarray(np.full((40, 60, 3), 90, np.uint8)).save(tmp_path.parent / "photo" / "c.png")
    with pytest.raises(SystemExit):
        cli.run(
            "locate", [f"map={tmp_path}", f"input={tmp_path.parent / 'photo'}", f"output={tmp_path.parent / 'out'}"]
        )
    told = capsys.readouterr().err
    assert said in " ".join(told.split())
    assert "Traceback" not in told


@pytest.mark.parametrize("cameras", [True, False])
@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        (lambda photo: photo.write_bytes(photo.read_bytes()[:500]), "cannot be decoded (500 bytes)"),
        (lambda photo: photo.write_bytes(b""), "is empty (0 bytes)"),
        (lambda photo: Image.new("RGB", (1, 1)).save(photo), "has 1x1 pixels"),
    ],
)
def test_a_photo_of_the_map_that_cannot_be_read_is_named(tmp_path, cameras, damaged, said):
    lens, row = (",fx,fy,cx,cy", ",50,50,30,20") if cameras else ("", "")
    lines = [f"file,x,y,z,qw,qx,qy,qz{lens}", *(f"{k}.png,{k},0,0,1,0,0,0{row}" for k in range(2))]
    (tmp_path / "poses.csv").write_text("\n".join(lines))
    for k in range(2):
        noise = np.random.default_rng(k).integers(0, 255, (40, 60, 3), np.uint8)
        Image.fromarray(noise).save(tmp_path / f"{k}.png")
    damaged(tmp_path / "1.png")
    with pytest.raises(UserError, match=re.escape(f"{tmp_path / '1.png'}: {said}")):
        PoseMap.from_folder(tmp_path)


@pytest.mark.parametrize("header", [{}, {"sha256": {}}, {"sha256": []}])
def test_a_saved_map_whose_header_lacks_something_is_damaged(tmp_path, header):
    FORMAT.write_header(tmp_path, header)
    with pytest.raises(UserError, match=r"the map of posed photos in .* is damaged: pose_map\.json cannot be used"):
        PoseMap.open(tmp_path)


def write_small_map(folder, **changed):
    arrays = {"poses": np.eye(4)[None], "points": np.zeros((1, 3)), "covariances": np.zeros((1, 3, 3))}
    arrays |= {"pixels": np.zeros((1, 2), np.float32), "local_descriptors": np.zeros((1, 8), np.float16)}
    arrays |= {"point_of": np.zeros(1, np.int32), "descriptors": np.zeros((1, 4), np.float32)}
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)
    header = {"sha256": dict.fromkeys(arrays), "names": ["a"], "features": {"name": "own"}, "keypoints_of": [1]}
    camera = {"width": 64, "height": 48, "fx": 50, "fy": 50, "cx": 32, "cy": 24}
    FORMAT.write_header(folder, header | {"local": None, "pixel": [1.0], "cameras": [camera]} | changed)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"pixel": [0]}, "pixel=0 must be above 0"),
        ({"cameras": [{}]}, "TypeError"),
        ({"names": []}, "its images, names and cameras differ in number"),
        ({"names": None}, "TypeError"),
        ({"features": None}, "TypeError"),
    ],
)
def test_a_saved_map_that_is_damaged_is_named(tmp_path, changed, said):
    write_small_map(tmp_path, **changed)
    with pytest.raises(UserError, match=rf"the map of posed photos in {tmp_path} is damaged: .*{said}"):
        PoseMap.open(tmp_path)


def test_an_error_of_given_local_features_is_no_damage_of_the_map(tmp_path, monkeypatch):
    def check():
        raise ValueError("no weights")

    write_small_map(tmp_path)
    monkeypatch.setattr(pose_map_files, "load_descriptor", lambda folder: SimpleNamespace(describer=None))
    own = SimpleNamespace(name="own", model="own 1", side=64, detect=None, match=None, check=check)
    with pytest.raises(ValueError, match=r"^no weights"):
        PoseMap.open(tmp_path, local=own)


def test_photos_without_a_pose_are_told(tmp_path, caplog):
    for k in "abc":
        Image.fromarray(np.full((40, 60, 3), 90, np.uint8)).save(tmp_path / f"{k}.png")
    (tmp_path / "poses.csv").write_text("file,x,y,z,qw,qx,qy,qz\na.png,0,0,0,1,0,0,0\nc.png,1,0,0,1,0,0,0\n")
    assert [path.name for path in posed_photos(tmp_path).paths] == ["a.png", "c.png"]
    assert "poses.csv: 1 photo (b.png) left out: without a pose" in caplog.text


def test_poses_without_a_photo_are_told(tmp_path, caplog):
    Image.fromarray(np.full((40, 60, 3), 90, np.uint8)).save(tmp_path / "a.png")
    rows = "".join(f"{k}.png,0,0,0,1,0,0,0\n" for k in "abc")
    (tmp_path / "poses.csv").write_text(f"file,x,y,z,qw,qx,qy,qz\n{rows}")
    assert [path.name for path in posed_photos(tmp_path).paths] == ["a.png"]
    assert f"poses.csv: 2 rows (b.png, ...) left out: no such photo below {tmp_path}" in caplog.text


def test_a_run_removes_what_a_former_one_wrote_and_nothing_else(tmp_path):
    (tmp_path / "photos").mkdir()
    Image.fromarray(np.full((40, 60, 3), 90, np.uint8)).save(tmp_path / "photos" / "a.png")
    posed = SimpleNamespace(poses=np.tile(np.eye(4), (2, 1, 1)), points=np.random.default_rng(0).normal(size=(20, 3)))
    poses = SimpleNamespace(posed=posed, names=["1.jpg", "2.jpg"], locate=lambda *_: LocatedPhoto("not in the map"))
    found = LocatedPhoto("located", np.eye(4), np.eye(6), camera=Pinhole(60, 40, 50.0, 50.0, 30.0, 20.0), nearest=0)
    out = tmp_path / "out"
    again = lambda: locate_frames(  # noqa: E731
        poses, find_images(str(tmp_path / "photos"), out, 1), None, out, [], lambda done, total: None
    )
    write_located([LocatedFrame("a.png", found, 60, 40)], poses, out)
    (out / "matches").mkdir()
    for name in ("a.png.jpg", "own.jpg"):
        (out / "matches" / name).write_bytes(b"picture")
    results = again()
    files = lambda: {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}  # noqa: E731
    assert files() == {"poses.csv", "trajectory.tum", "matches/own.jpg"}
    write_located(results, poses, out)  # none is located
    (out / "colmap" / "images.txt").write_text("of another program")
    with pytest.raises(UserError, match=r"colmap/images\.txt"):
        again()
    (out / "colmap" / "images.txt").unlink()
    write_located([LocatedFrame("a.png", found, 60, 40)], poses, out)
    (out / "colmap" / "points3D.bin").write_bytes(b"of another program")
    before = files()
    with pytest.raises(UserError, match=r"did not write, and would replace or add to: .*colmap/points3D.bin\n"):
        again()
    assert files() == before


@pytest.mark.parametrize("name", ["poses.csv", "from_above.png", "colmap/images.txt", "colmap/database.db"])
def test_files_of_another_origin_in_the_output_are_refused_before_the_work(tmp_path, name, capsys):
    own = tmp_path / "out" / name
    own.parent.mkdir(parents=True)
    own.write_text("file,x,y\n")
    with pytest.raises(SystemExit):
        cli.run("locate", [f"map={tmp_path / 'none'}", f"input={tmp_path / 'none'}", f"output={tmp_path / 'out'}"])
    told = capsys.readouterr().err
    assert "has files that sextant locate did not write" in " ".join(told.split())
    assert own.read_text() == "file,x,y\n"


def test_local_features_must_be_some_and_those_of_the_map():
    for wrong in (5, object()):
        with pytest.raises(ArgumentError, match="no local features: it has no name, model, side, detect, match"):
            extractor_of(wrong, None)
    network = SimpleNamespace(describer=None)
    own = SimpleNamespace(name="own", model="own 1", side=64, detect=None, match=None)
    earlier = {"features": {"name": "xfeat", "keypoints": 64, "side": 128}}  # says nothing else
    with pytest.raises(ArgumentError, match=r"other local features \(own 1\) than those of the map in kept \(.*xfeat"):
        _extractor(Path("kept"), earlier, own, network)
    assert _extractor(Path("kept"), earlier, None, network)[0] == "xfeat"
