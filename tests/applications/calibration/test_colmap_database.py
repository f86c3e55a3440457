"""What is written for COLMAP is opened with pycolmap: cameras, gravity, positions; and features are found with it."""

import json
import math
from dataclasses import replace

import numpy as np
import pycolmap
import pytest
import torch
from cli.photo_calibration.fakes import Fake, calibrate, exif, photo
from PIL import Image

from sextant.applications import PhotoCalibrator
from sextant.chapters.calibration.colmap_database import gravity_prior, write_colmap
from sextant.data.upright import STORED_FROM_UPRIGHT, TURN
from sextant.errors import ArgumentError, UserError
from sextant.geometry import tilt_roll_from_up

GPS = {1: "N", 2: (55.0, 42.0, 3.5), 3: "E", 4: (13.0, 11.0, 2.25), 5: b"\0", 6: 12.5}


def block(orientation=1, gps=None):
    found = exif(30)
    found[0x0112] = orientation
    if gps:
        found[0x8825] = gps
    return found


def calibrated(paths, model=None):
    return PhotoCalibrator(model or Fake(), "network").calibrate_many(paths)


@pytest.fixture
def opened():
    """Opens databases, and closes them."""
    databases = []

    def open_one(path):
        databases.append(pycolmap.Database.open(path))
        return databases[-1]

    yield open_one
    for database in databases:
        database.close()


def content(database):
    """Cameras and priors by the names of images."""
    priors = {prior.corr_data_id.id: prior for prior in database.read_all_pose_priors()}
    return {
        image.name: (database.read_camera(image.camera_id), priors.get(image.image_id))
        for image in database.read_all_images()
    }


@pytest.mark.slow
@pytest.mark.parametrize(("tilt", "roll"), [(0.1, -0.05), (-0.7, 0.3), (1.2, 2.5)])
def test_focal_length_distortion_and_gravity_come_back(tmp_path, opened, tilt, roll):
    cameras = calibrated([photo(tmp_path / "in" / f"{g}.png", grey=g) for g in (60, 90)], Fake(tilt=tilt, roll=roll))
    database, priors = write_colmap(cameras, tmp_path / "out")
    found = content(opened(database))
    assert json.loads(priors.read_text())["image_path"] == str(tmp_path / "in")
    for camera, name in zip(cameras, ("60.png", "90.png"), strict=True):
        theirs, prior = found[name]
        assert (theirs.model.name, theirs.width, theirs.height) == ("RADIAL", 80, 60)
        assert theirs.focal_length == pytest.approx(camera.focal_px, rel=1e-12)
        np.testing.assert_allclose(theirs.params, camera.colmap()[1], rtol=1e-12)
        assert theirs.has_prior_focal_length == (camera.verdict == "good")
        back = tilt_roll_from_up(torch.from_numpy(-prior.gravity))
        np.testing.assert_allclose(np.degrees(back), [camera.tilt_deg, camera.roll_deg], rtol=0, atol=1e-6)
        assert not prior.has_position()


def test_uncertainty_is_that_of_tilt_and_roll():
    """Against vectors of many tilts and rolls within it."""
    from types import SimpleNamespace

    for tilt, roll, orientation in ((0.2, -0.1, 1), (-0.6, 0.4, 6)):
        ends = [tuple(math.degrees(x + s * h) for s in (-1, 1)) for x, h in ((tilt, 0.02), (roll, 0.01))]
        near = SimpleNamespace(tilt_deg=ends[0], roll_deg=ends[1])
        camera = SimpleNamespace(
            tilt_deg=math.degrees(tilt), roll_deg=math.degrees(roll), interval_68=near, exif_orientation=orientation
        )
        gravity, covariance = gravity_prior(camera)
        rng = np.random.default_rng(0)
        drawn = []
        for _ in range(4000):
            camera.tilt_deg, camera.roll_deg = np.degrees([rng.normal(tilt, 0.02), rng.normal(roll, 0.01)])
            drawn.append(gravity_prior(camera)[0])
        np.testing.assert_allclose(np.cov(np.array(drawn).T), covariance, rtol=0, atol=2e-5)
        np.testing.assert_allclose(covariance @ gravity, 0, atol=1e-15)
        assert np.linalg.norm(gravity) == pytest.approx(1)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_turns_are_those_of_the_pictures(orientation):
    """Of pixels: what lies down in the upright picture is where the stored one has it."""
    stored = np.zeros((5, 7), np.uint8)
    turn = np.array(STORED_FROM_UPRIGHT[orientation])
    for value, step in enumerate([(0, 0), (0, 1), (1, 0)], start=1):  # the middle, a step down, one to the right
        x, y = turn @ step
        stored[2 + y, 3 + x] = value
    picture = Image.fromarray(stored)
    upright = np.asarray(picture if orientation == 1 else picture.transpose(TURN[orientation]))
    middle, below, beside = (np.argwhere(upright == value)[0] for value in (1, 2, 3))
    assert (below - middle).tolist() == [1, 0]
    assert (beside - middle).tolist() == [0, 1]


def test_a_picture_that_is_stored_turned_is_so_in_the_database(tmp_path, opened):
    """COLMAP's own reader of pictures says which way they are stored, and how often to turn them."""
    level = Fake(tilt=0.0, roll=0.0)
    paths = [photo(tmp_path / f"{turn}.jpg", (80, 60), exif=block(turn)) for turn in (1, 3, 6, 8)]
    database, _ = write_colmap(calibrated(paths, level), tmp_path / "out")
    found = content(opened(database))
    for path, turns in zip(paths, (0, 2, 3, 1), strict=True):
        camera, prior = found[path.name]
        bitmap = pycolmap.Bitmap.read(path, True)
        assert (camera.width, camera.height) == (bitmap.width, bitmap.height)
        assert (camera.principal_point_x, camera.principal_point_y) == (40, 30)
        assert pycolmap.compute_rot90_from_gravity(prior.gravity) == turns


def test_photos_of_one_camera_share_it_turned_or_not(tmp_path, opened):
    paths = [photo(tmp_path / f"{k}.jpg", (60, 80) if k == 2 else (80, 60)) for k in range(3)]
    paths.append(photo(tmp_path / "3.jpg", (80, 60), exif=block(6)))  # stored lying
    one = PhotoCalibrator(Fake(), "network").one_camera(paths)
    database, priors = write_colmap(one.cameras, tmp_path / "out")
    ids = [row["camera_id"] for row in json.loads(priors.read_text())["images"]]
    assert [ids.index(each) for each in ids] == [0, 0, 2, 0]
    assert opened(database).num_rigs() == 2
    assert opened(database).num_frames() == 4
    weak = [replace(camera, verdict="weak") for camera in one.cameras]
    database, _ = write_colmap([*weak[:3], one.cameras[3]], tmp_path / "mixed")
    assert one.cameras[3].verdict == "good"
    known = [camera.has_prior_focal_length for camera in opened(database).read_all_cameras()]
    assert known == [True, False]  # by the last of the first camera's photos


def test_positions_are_those_that_colmap_reads(tmp_path, opened):
    paths = [photo(tmp_path / "a" / "1.jpg", exif=block(gps=GPS)), photo(tmp_path / "b" / "2.jpg")]
    database, _ = write_colmap(calibrated(paths), tmp_path / "out")
    found = content(opened(database))
    theirs = tmp_path / "theirs.db"
    opened(theirs)
    pycolmap.import_images(theirs, tmp_path / "a")
    (read,) = opened(theirs).read_all_pose_priors()
    prior = found["a/1.jpg"][1]
    np.testing.assert_allclose(prior.position, read.position, rtol=0, atol=1e-9)
    assert prior.coordinate_system == read.coordinate_system
    assert not found["b/2.jpg"][1].has_position()


def test_what_is_not_trustworthy_is_believed_by_nobody(tmp_path, opened):
    model = Fake(scale=(0.3, 0.2, 0.5, 0.9))
    (camera,) = calibrated([photo(tmp_path / "a.png")], model)
    assert camera.verdict == "not trustworthy"
    database, priors = write_colmap([camera], tmp_path / "out")
    theirs, prior = content(opened(database))["a.png"]
    assert prior is None
    assert not theirs.has_prior_focal_length
    (row,) = json.loads(priors.read_text())["images"]
    assert not row["in_database"]
    assert row["tilt_sigma_deg"] > 10
    np.testing.assert_allclose(row["gravity"], gravity_prior(camera)[0])


def test_colmap_goes_on_from_it(tmp_path, opened):
    """Features are found and pairs matched; cameras and gravity stay as they are."""
    rng = np.random.default_rng(0)
    scene = Image.fromarray(rng.integers(0, 255, (30, 40, 3), dtype=np.uint8)).resize((320, 240))
    (tmp_path / "in").mkdir()
    for name in ("a.png", "b.png"):
        scene.save(tmp_path / "in" / name)
    cameras = calibrated(sorted((tmp_path / "in").iterdir()))
    database, _ = write_colmap(cameras, tmp_path / "out")
    before = content(opened(database))
    options = pycolmap.FeatureExtractionOptions(num_threads=1, use_gpu=False)
    pycolmap.extract_features(database, tmp_path / "in", extraction_options=options)
    (tmp_path / "pairs.txt").write_text("a.png b.png\n")
    pairs = pycolmap.ImportedPairingOptions(match_list_path=tmp_path / "pairs.txt")
    matching = pycolmap.FeatureMatchingOptions(num_threads=1, use_gpu=False)
    pycolmap.match_image_pairs(database, matching_options=matching, pairing_options=pairs)
    after = opened(database)
    assert after.num_keypoints() > 20
    assert after.num_verified_image_pairs() == 1
    assert repr(content(after)) == repr(before)


@pytest.mark.slow
@pytest.mark.real_data
def test_gravity_is_one_direction_in_what_colmap_reconstructs(real_data, tmp_path, opened):
    """Four photos of a castle: cameras that COLMAP places by points alone see gravity in one direction of its world."""
    photos = real_data / "photos" / "sceaux_castle"
    one = PhotoCalibrator.load().one_camera(sorted(photos.glob("*.[jJ][pP][gG]")))
    database, priors = write_colmap(one.cameras, tmp_path / "out")
    extraction = pycolmap.FeatureExtractionOptions(num_threads=1, use_gpu=False, max_image_size=640)
    pycolmap.extract_features(database, photos, extraction_options=extraction)
    pycolmap.match_exhaustive(database, matching_options=pycolmap.FeatureMatchingOptions(num_threads=1, use_gpu=False))
    options = pycolmap.IncrementalPipelineOptions(num_threads=1)
    (model,) = pycolmap.incremental_mapping(database, photos, tmp_path / "sparse", options=options).values()
    assert model.num_reg_images() == len(one.cameras) == 4
    seen = content(opened(database))
    down = np.stack(
        [image.cam_from_world().rotation.inverse() * seen[image.name][1].gravity for image in model.images.values()]
    )
    angles = np.degrees(np.arccos(down @ down.mean(axis=0) / np.linalg.norm(down.mean(axis=0))))
    sigmas = [row["tilt_sigma_deg"] + row["roll_sigma_deg"] for row in json.loads(priors.read_text())["images"]]
    assert (angles < 2 * np.array(sigmas)).all(), angles


@pytest.mark.slow
def test_the_command_writes_it_and_never_over_one(tmp_path, opened):
    paths = [photo(tmp_path / f"{k}.png") for k in range(2)]
    calibrate(paths, tmp_path / "out", colmap=True)
    assert opened(tmp_path / "out" / "colmap" / "database.db").num_images() == 2
    with pytest.raises(UserError, match=r"database\.db already exists"):
        calibrate(paths, tmp_path / "out", colmap=True)


def test_what_is_no_file_is_refused(tmp_path):
    cameras = calibrated([np.full((60, 80, 3), 70, np.uint8)])
    with pytest.raises(ArgumentError, match=r"photos\[0\] is not a file"):
        write_colmap(cameras, tmp_path)
    with pytest.raises(ArgumentError, match="there is no camera"):
        write_colmap([], tmp_path)
    assert not list(tmp_path.iterdir())
