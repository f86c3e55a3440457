"""Drives of rendered worlds: which is the map, what is for validation, and what their wheels tell."""

import json
import shutil

import numpy as np
import pytest

from sextant.chapters.localization.data import DriveSettings, LocalizationSource, as_localization_source
from sextant.chapters.localization.data.drive import motions_along
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.data.digits import Digits
from sextant.data.rendered import open_store
from sextant.data.worlds import OfficeWalk, TownCity, TownFactors, TownSeasons
from sextant.data.worlds.office_walk import OfficeWalkPlan
from sextant.data.worlds.towns import TownCityPlan, TownSeasonsPlan
from sextant.errors import UserError
from sextant.worlds.odometry import COLD_WHEELS, at_axle, between, drift, integrate
from sextant.worlds.trajectories import load_cold

LASER = {"beams": 12, "field_of_view_rad": 3.14159, "max_range_m": 15.0, "range_sigma_m": 0.02, "dropout": 0.01}
OFFICE = {
    "size_m": [12.0, 12.0], "metres": [4.0, 3.0, 3.0], "trajectories": [], "every": 10, "width": 16, "height": 12,
    "vfov_deg": 60.0, "samples": 1, "conditions": ["summer_noon", "night_clear"], "laser": LASER, "seed": 1,
}  # fmt: skip
TOWN = {
    "frames": {"train": 3, "val": 8, "test": 10}, "step_m": 3.0, "lateral_sigma_m": 0.3, "heading_sigma_deg": 2.0,
    "width": 16, "height": 12, "vfov_deg": 55.0, "samples": 1, "conditions": ["summer_noon", "fog", "night_clear"],
    "block_m": 70.0, "trajectories": {"train": None, "val": None, "test": None}, "seed": 3,
}  # fmt: skip
CITY = {
    "images": 40, "headings": 8, "size_m": 320.0, "block_m": 80.0, "width": 16, "height": 12, "vfov_deg": 55.0,
    "samples": 1, "conditions": ["summer_noon", "night_clear"], "query_frames": 20, "query_step_m": 2.0, "seed": 3,
}  # fmt: skip


def painted(self, start, stop):
    """In place of the renderer, which its own tests look at: pictures and scans that tell their number."""
    numbers = np.arange(start, stop)
    images = np.broadcast_to(
        numbers.astype(np.uint8)[:, None, None, None], (stop - start, *self.arrays["images"].shape)
    )
    if "laser" not in self.arrays:
        return {"images": images}
    laser = np.broadcast_to(numbers.astype(np.float32)[:, None], (stop - start, *self.arrays["laser"].shape))
    return {"images": images, "laser": laser}


@pytest.fixture
def quick(monkeypatch):
    for plan in (OfficeWalkPlan, TownSeasonsPlan, TownCityPlan):
        monkeypatch.setattr(plan, "render", painted)


def pixels(drive):
    return drive.images[:][:, 0, 0, 0].astype(int).tolist()


def row_of(store, drive):
    """Rows of a store by the pixels of a drive: pictures and poses must be of the same rows."""
    rows = np.array(pixels(drive))
    assert np.array_equal(store.columns["pose"][rows][:, [0, 1, 3]], drive.poses)
    return rows


def all_drives(data):
    return [drive for drive in (data.map, *data.test, *data.validation, data.validation_map) if drive is not None]


def check(source, data):
    """What holds of all data."""
    assert isinstance(source, LocalizationSource)
    assert all(source.files(split) == [] for split in ("map", "validation", "test"))
    drives = all_drives(data)
    assert all(np.array_equal(drive.frames, np.arange(len(drive))) for drive in drives)
    assert all(drive.seen.all() and not drive.kidnaps for drive in drives)
    assert all((drive.motion[0] == 0).all() for drive in (*data.test, *data.validation))
    shown = [set(pixels(drive)) for drive in (*data.test, *data.validation)]
    assert sum(map(len, shown)) == len(set.union(*shown))  # validation and test share no picture
    assert not set(pixels(data.map)) & set.union(*shown)


# -- the office --------------------------------------------------------------------------------------------------------


def test_the_first_run_is_for_validation_and_the_others_for_the_test(tmp_path, quick):
    dataset = OfficeWalk(roots=[tmp_path], **OFFICE)
    source = as_localization_source(dataset)
    assert source.conditions() == ("summer_noon", "night_clear")
    assert not any(tmp_path.iterdir())
    data = source.read()
    check(source, data)
    assert [drive.name for drive in data.validation] == ["run1/summer_noon", "run1/night_clear"]
    assert [drive.name for drive in data.test] == ["run2/summer_noon", "run2/night_clear"]
    assert (data.unit, data.protocol, data.validation_map) == ("m", "office", None)
    assert data.scanner == dataset.plan().scanner
    store = open_store(dataset.plan(), tmp_path)
    for drive in all_drives(data):
        rows = row_of(store, drive)
        assert np.array_equal(drive.laser[:, 0], rows)
        assert np.array_equal(drive.motion, motions_along(store.columns["odometry"][rows]))
        assert store.facts["conditions"][store.columns["condition"][rows[0]]] == drive.condition
        assert drive.odometry == "simulated"
    assert data.map.condition == "summer_noon"
    assert store.facts["measured_odometry"] == [False, False, False]
    again = as_localization_source(dataset, DriveSettings(odometry_scale=0.0))
    assert again.fingerprint() != source.fingerprint()
    assert np.allclose(again.read().test[0].motion, motions_along(data.test[0].poses), atol=1e-12)


def test_a_single_run_is_divided(tmp_path, quick):
    source = as_localization_source(OfficeWalk(roots=[tmp_path], **OFFICE | {"metres": [3.0, 5.0]}))
    data = source.read()
    check(source, data)
    assert [drive.name for drive in data.validation] == ["run1/summer_noon/start", "run1/night_clear/start"]
    for early, late in zip(data.validation, data.test, strict=True):
        assert len(early) == round(0.25 * (len(early) + len(late)))
        assert pixels(late)[0] == pixels(early)[-1] + 1
        assert late.condition == early.condition


def cold_file(path, n, odometry):
    """A drive around a circle, in COLD's layout; its odometry is told by an axle behind, in a frame of its own."""
    turn = np.linspace(0, 5.0, n)
    poses = np.column_stack([4 * np.cos(turn), 4 * np.sin(turn), turn + np.pi / 2])
    c, s, zero, one = np.cos(poses[:, 2]), np.sin(poses[:, 2]), np.zeros(n), np.ones(n)
    rows = np.column_stack([c, -s, zero, poses[:, 0], s, c, zero, poses[:, 1], zero, zero, one, zero])
    content = {"im_paths": [f"{i}.png" for i in range(n)], "poses": rows.tolist()}
    if odometry:
        axle = at_axle(poses, COLD_WHEELS.lever_m)
        content["odom_poses"] = integrate(np.zeros(3), _steps(axle)).tolist()
    path.write_text(json.dumps(content))
    return str(path), poses


def _steps(poses):
    from sextant.worlds.odometry import increments

    return increments(poses)


def test_measured_odometry_is_taken_from_the_file(tmp_path, quick):
    mapped, _ = cold_file(tmp_path / "map.json", 80, odometry=False)
    driven, poses = cold_file(tmp_path / "run.json", 60, odometry=True)
    dataset = OfficeWalk(roots=[tmp_path / "stores"], **OFFICE | {"trajectories": [mapped, driven], "every": 4})
    data = as_localization_source(dataset, DriveSettings(odometry_scale=0.0, validation_share=0.2)).read()
    assert {drive.odometry for drive in (*data.validation, *data.test)} == {"measured"}
    assert data.map.odometry == "simulated"
    store = open_store(dataset.plan(), tmp_path / "stores")
    assert store.facts["measured_odometry"] == [False, True]
    # the wheels of this file do not err: seen from the frame of the poses they tell the truth, whatever their own frame
    run = store.columns["odometry"][(store.columns["run"] == 1)]
    assert np.abs(between(run, poses[::4])).max() < 1e-9
    assert (len(data.validation[0]), len(data.test[0])) == (3, 12)
    for drive in (*data.validation, *data.test):
        assert np.abs(drive.motion - motions_along(drive.poses)).max() < 1e-9


@pytest.mark.real_data
def test_the_real_wheels_of_cold_drift_as_their_model_does(real_data, tmp_path):
    config = to_plain(compose(["dataset=cold", f"paths.data={real_data}"]))["dataset"]
    assert config.pop("_target_") == "sextant.data.worlds.OfficeWalk"
    plan = OfficeWalk(roots=[tmp_path], **config).plan()
    assert plan.facts["measured_odometry"] == [False, True]
    assert plan.facts["splits"] == {"map": 2056, "run": 2 * 956}
    columns = plan.columns
    first, second = (columns["odometry"][columns["run"] == run] for run in (1, 2))
    assert np.array_equal(first, second)  # one real drive, rendered under two conditions
    truth = columns["pose"][columns["run"] == 1][:, [0, 1, 3]]
    assert np.allclose(first[0], truth[0], rtol=0, atol=1e-12)
    moved, turned = drift(truth, first, 2.0)
    assert 0.02 < moved < 0.3
    assert np.radians(1) < turned < np.radians(8)
    # in the frame of the poses, not of the axle: over short ways the lever's swing would be most of the error
    cold = load_cold(real_data / "cold" / "seq1_night1.json")
    assert drift(truth, first, 0.5)[0] < 0.5 * drift(truth, cold.odometry[::2], 0.5)[0]


def test_an_office_is_rendered_and_read(tmp_path):
    data = as_localization_source(OfficeWalk(roots=[tmp_path], **OFFICE | {"metres": [3.0, 3.0]})).read()
    pictures = data.test[0].images[:]
    assert pictures.std(axis=(1, 2, 3)).min() > 2
    assert ((data.map.laser >= 0) & (data.map.laser <= 15)).all()
    assert data.map.laser.std() > 0.3
    shutil.rmtree(tmp_path)


# -- towns -------------------------------------------------------------------------------------------------------------


def test_the_first_season_of_a_town_is_its_map(tmp_path, quick):
    dataset = TownSeasons(roots=[tmp_path], **TOWN)
    source = as_localization_source(dataset)
    data = source.read()
    check(source, data)
    assert (data.map.name, data.validation_map.name) == ("test/summer_noon", "val/summer_noon")
    assert [drive.name for drive in data.test] == ["test/fog", "test/night_clear"]
    assert [drive.name for drive in data.validation] == ["val/fog", "val/night_clear"]
    assert [drive.name for drive in data.other_maps] == ["test/fog", "test/night_clear"]
    assert (len(data.map), len(data.validation_map)) == (10, 8)
    store = open_store(dataset.plan(), tmp_path)
    for drive in all_drives(data):
        rows = row_of(store, drive)
        assert (store.columns["split"][rows] == {"test": 2, "val": 1}[drive.name.split("/")[0]]).all()
        error = np.abs(drive.motion - motions_along(drive.poses))
        assert 1e-4 < error[1:, :2].max() < 1.0
        assert error[1:, 2].max() < np.radians(5)
    exact = as_localization_source(dataset, DriveSettings(odometry_scale=0.0)).read()
    assert np.allclose(exact.test[0].motion, motions_along(data.test[0].poses), atol=1e-9)
    other = as_localization_source(dataset, DriveSettings(odometry_seed=1)).read()
    assert not np.allclose(other.test[0].motion, data.test[0].motion)


def test_a_town_of_one_season_has_nothing_to_localize(tmp_path, quick):
    dataset = TownSeasons(roots=[tmp_path], **TOWN | {"conditions": ["summer_noon"]})
    with pytest.raises(UserError, match="leaves none to localize"):
        as_localization_source(dataset).read()


def test_a_city_is_mapped_once_and_driven_through_under_each_condition(tmp_path, quick):
    dataset = TownCity(roots=[tmp_path], **CITY)
    source = as_localization_source(dataset)
    data = source.read()
    check(source, data)
    assert len(data.map) == 40
    assert data.map.motion is None
    assert data.validation_map is None
    assert [(drive.name, len(drive)) for drive in data.validation] == [
        ("summer_noon/start", 4), ("night_clear/start", 4)
    ]  # fmt: skip
    assert [(drive.name, len(drive)) for drive in data.test] == [("summer_noon", 16), ("night_clear", 16)]
    store = open_store(dataset.plan(), tmp_path)
    for drive in all_drives(data):
        row_of(store, drive)


def test_what_has_no_drives_is_refused():
    factors = object.__new__(TownFactors)
    for dataset, name in ((Digits(28), "digits"), (object(), "object"), (factors, "town_factors")):
        with pytest.raises(UserError, match=f"dataset={name} has no drives"):
            as_localization_source(dataset)


@pytest.mark.parametrize("wrong", [{"odometry_scale": -1.0}, {"validation_share": 0.0}, {"validation_share": 1.0}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(UserError, match=next(iter(wrong))):
        DriveSettings(**wrong)


def test_the_config_of_cold_is_valid():
    validate(to_plain(compose(["dataset=cold", "task=place_recognition"])))
