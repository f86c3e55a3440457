"""A localizer in a world that has changed since its map was made, off the map, and after a jump."""

import csv
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.ndimage import gaussian_filter

from sextant import Localizer
from sextant.atomic_files import write_sealed_json
from sextant.chapters.localization.data.own_drive import open_drive
from sextant.chapters.localization.localized_drive import doubts, far_steps, localize_drive
from sextant.chapters.localization.localized_pose import LocalizedPose
from sextant.chapters.localization.saved_filter import filter_of, filter_values, fitted_kernel
from sextant.chapters.localization.written_poses import Row
from sextant.errors import UserError
from sextant.localization.constants import NOISE, RECOGNISED, SHARPER
from sextant.localization.likelihood import Likelihood


class Street:
    """A textured wall along a line; in another season it is darker and half of its texture is another."""

    def __init__(self, step):
        rng = np.random.default_rng(0)
        walls = [gaussian_filter(rng.normal(size=(32, 1400, 3)), (2, 4, 0)) for _ in range(2)]
        self.summer, other = (wall / wall.std() for wall in walls)
        self.winter = 0.6 * (0.7 * self.summer + 0.7 * other) - 0.5
        self.step = step
        self.poses = np.array([(step * i, 0.0, 0.0) for i in range(80)])
        self.images = np.stack([self.at(self.summer, i) for i in range(80)])

    def at(self, wall, i):
        return np.clip(128 + 40 * wall[:, round(i * 12) : round(i * 12) + 48], 0, 255).astype(np.uint8)

    def drive(self, localizer, wall=None, start=10, count=50, jump=None, seed=0, scale=1.0, noise=0.1):
        localizer.reset(seed)
        rng, found = np.random.default_rng(seed), []
        for k in range(count):
            motion = self.step * np.array([scale + noise * rng.normal(), 0.0, 0.0])
            motion = np.array([jump[1], 0.0, 0.0]) if jump and k == jump[0] else motion
            found.append(localizer.step(motion, self.at(self.winter if wall is None else wall, start + k)))
        away = [np.hypot(*(one.pose[:2] - (self.step * (start + k), 0))) for k, one in enumerate(found)]
        return found, np.array(away) / self.step


@pytest.fixture(scope="module", params=[0.3, 200.0], ids=["0.3 m", "200 m"])
def street(request):
    return Street(request.param)


@pytest.fixture(scope="module")
def localizer(street):
    return Localizer.from_images(street.images, street.poses, steps=30, particles=500)


@pytest.mark.slow
def test_it_finds_its_way_in_another_season_whatever_the_spacing_of_the_map(street, localizer):
    found, away = street.drive(localizer)
    assert np.mean(away[20:] < 2) > 0.9
    assert max(one.off_map for one in found[20:]) < 0.5
    assert not any(one.lost for one in found[20:])


@pytest.mark.slow
def test_an_image_counts_by_the_way_since_the_last_that_did(street, localizer):
    localizer.reset(0)
    localizer.step(None, street.at(street.summer, 10))
    way = 0.0
    for _ in range(4):
        way += localizer.odometry_scale / 8  # as corrected so far
        localizer.step((street.step / 8, 0.0, 0.0))  # odometry comes more often than images
    localizer.step((0.0, 0.0, 0.0), street.at(street.summer, 10))
    assert way == pytest.approx(0.5, rel=1e-3)
    assert localizer._now.learned.change.images.item() == pytest.approx(1 + way)
    localizer.step((0.0, 0.0, 0.0), street.at(street.summer, 10))  # and stands still
    localizer.step((street.step / 8, 0.0, 0.0), street.at(street.summer, 10))
    assert localizer._now.learned.change.images.item() == pytest.approx(1 + way)
    localizer.step((street.step / 4, 0.0, 0.0), street.at(street.summer, 10))  # the way adds up
    assert localizer._now.learned.change.images.item() == pytest.approx(1.5 + 3 / 8, rel=1e-3)
    localizer.step((0.0, 0.0, 0.0), street.at(street.summer, 60))  # it was carried
    counted = localizer._now.learned.change.images.item()
    assert counted > 1.5 + 3 / 8 + 0.5
    localizer.step(None)
    localizer.step((0.0, 0.0, 0.0), street.at(street.summer, 60))
    assert localizer._now.learned.change.images.item() == pytest.approx(counted + 1)
    localizer.step(None, street.at(street.summer, 60))  # which shows that it stayed
    assert localizer._now.learned.change.images.item() == pytest.approx(counted + 1)


@pytest.mark.slow
def test_a_robot_that_stands_keeps_what_it_knows_though_its_images_are_noisy(street, localizer):
    found, _ = street.drive(localizer, count=20)
    rng, image = np.random.default_rng(1), street.at(street.winter, 29).astype(float)
    for _ in range(100):
        noisy = (image + rng.normal(scale=3, size=image.shape)).clip(0, 255).astype(np.uint8)
        last = localizer.step((0.0, 0.0, 0.0), noisy)
    assert np.sqrt(last.covariance[0, 0]) < 1.5 * np.sqrt(found[-1].covariance[0, 0])
    assert localizer.recognised > RECOGNISED
    assert len(localizer._sample.images) <= 21  # of what the drive as a whole shows, one place counts once


@pytest.mark.slow
def test_a_robot_that_stands_grows_no_surer_of_what_it_sees(street, localizer):
    localizer.reset(0)
    image = street.at(street.winter, 33)
    first = localizer.step(None, image)
    told = [localizer.step((0.0, 0.0, 0.0), image) for _ in range(40)]
    assert first.lost
    assert told[-1].lost
    assert told[-1].mass == pytest.approx(first.mass, abs=0.1)
    moving, _ = street.drive(localizer, count=40)
    assert not moving[-1].lost
    image = street.at(street.winter, 49)
    told = [localizer.step((0.0, 0.0, 0.0), image) for _ in range(40)]
    assert not told[-1].lost
    assert told[-1].sigmas[0] > 0.8 * moving[-1].sigmas[0]


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_odometry_may_err_alike_in_each_step(street, localizer, scale):
    found, away = street.drive(localizer, count=60, scale=scale, noise=0.05)
    sigmas = np.array([one.sigmas[0] for one in found]) / street.step
    assert np.mean((away / sigmas)[20:] < 2.5) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.6, 1.4])
def test_odometry_that_is_far_off_is_put_right_on_the_way(street, localizer, scale):
    _, away = street.drive(localizer, count=60, scale=scale, noise=0.05)
    assert localizer.odometry_scale == pytest.approx(1 / scale, rel=0.15)
    assert np.mean(away[40:] < 2) > 0.8
    localizer.reset(0)
    assert localizer.odometry_scale == 1


def elsewhere():
    """A walk past a wall that is not the street's."""
    rng = np.random.default_rng(7)
    wall = gaussian_filter(rng.normal(size=(32, 1400, 3)), (2, 4, 0))
    return wall / wall.std()


@pytest.mark.slow
def test_in_a_world_that_is_not_the_maps_it_is_lost(street, localizer):
    found, _ = street.drive(localizer, elsewhere(), count=60)
    assert np.mean([one.lost for one in found[10:]]) > 0.9
    assert found[-1].foreseen < 0.65
    there, _ = street.drive(localizer)
    assert there[-1].foreseen > 0.9
    assert np.isnan(there[0].foreseen)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scale", "there", "says"),
    [
        (0.7, True, r"the distances of odometry are too short: in the end they were multiplied by 1\.[3-5]\d"),
        (1.4, True, r"the distances of odometry are too long: in the end they were multiplied by 0\.[67]\d"),
        (0.0, True, "at 46 images odometry reported a standstill while the images showed motion"),
        (1.0, False, "the recent ones hardly resembled the estimated place more than any other"),
        (1.0, True, None),
    ],
)
def test_what_images_say_against_odometry_is_remarked_on(street, localizer, tmp_path, scale, there, says):
    photos, output = tmp_path / "drive", tmp_path / "out"
    photos.mkdir()
    output.mkdir()
    lines = ["file,x,y,theta"]
    for k in range(50):
        Image.fromarray(street.at(street.winter if there else elsewhere(), 10 + k)).save(photos / f"{k:03d}.png")
        lines.append(f"{k:03d}.png,{scale * street.step * k},0,0")
    (tmp_path / "odometry.csv").write_text("\n".join(lines))
    drive = open_drive(str(photos), tmp_path / "odometry.csv", output)
    localizer.reset(0)
    localize_drive(localizer, drive, drive.frames.read(localizer.image_size), output, replay="none")
    assert any(re.search(says, remark) for remark in drive.remarks) if says else not drive.remarks
    foreseen = [float(row["foreseen"]) for row in csv.DictReader((output / "poses.csv").open())]
    assert not scale or (foreseen[-1] > 0.65) == there


@pytest.mark.parametrize(
    ("recognised", "lost", "says"),
    [
        ([0.45, 0.48, 0.7], [True, True, False], ["2 of the first images resemble the map hardly more"]),
        (
            [0.35, 0.45, 0.7],
            [True, True, False],
            ["1 of 3 images resembles the map less", "1 of the first images resembles"],
        ),
        ([0.45, 0.7, 0.45], [False, False, True], []),
        ([np.nan, 0.45, 0.45], [True, True, True], []),
    ],
)
def test_first_images_that_say_too_little_are_remarked_on(recognised, lost, says):
    poses = [
        LocalizedPose(np.zeros(3), np.eye(3), 0.9, 1, gone, recognised=share)
        for share, gone in zip(recognised, lost, strict=True)
    ]
    rows = [Row(f"{k}.png", told, "") for k, told in enumerate(poses)]
    found = list(doubts(SimpleNamespace(recognised=0.7, odometry_scale=1.0), rows, False))
    assert len(found) == len(says)
    assert all(remark.startswith(said) for remark, said in zip(found, says, strict=True))


@pytest.mark.parametrize(("scale", "told"), [(1.0, 0), (1000.0, 1), (np.nan, 0)])
def test_odometry_in_another_unit_than_the_map_is_remarked_on(scale, told):
    drive = SimpleNamespace(motions=[None, *(np.array([scale, 0.0, 0.0]) if scale > 0 else None for _ in range(5))])
    found = list(far_steps(drive, np.array([[0.0, 0.0], [59.0, 0.0]]), "m"))
    assert len(found) == told
    assert all("step of odometry, 1,000, is longer than the whole map, 59 m: x and y must" in said for said in found)


@pytest.mark.slow
def test_odometry_that_says_a_moving_camera_stands_is_not_believed(street, localizer):
    found, away = street.drive(localizer, scale=0.0, noise=0.0)
    assert not any(one.disbelieved for one in found[:4])
    assert all(one.disbelieved for one in found[4:])
    assert np.mean(away[20:] < 2) > 0.8
    localizer.reset(0)
    stands = [localizer.step((0.0, 0.0, 0.0), street.at(street.winter, 33)) for _ in range(20)]
    assert not any(one.disbelieved for one in stands)
    right, _ = street.drive(localizer)
    assert not any(one.disbelieved for one in right)
    plain = Localizer(localizer.model, Likelihood(), localizer.filter, radius=localizer.radius)
    plain.descriptor, plain.image_size = localizer.descriptor, localizer.image_size
    assert not any(one.disbelieved for one in street.drive(plain, scale=0.0, noise=0.0)[0])


def test_where_odometry_is_missing_nothing_is_foreseen(street, localizer):
    localizer.reset(0)
    told = [localizer.step(None, street.at(street.winter, 10 + k)) for k in range(20)]
    assert np.isnan(told[-1].foreseen)
    assert all(one.lost == (one.mass < 0.5) for one in told)  # the belief is all that says so
    assert not all(one.lost for one in told[-10:])


def test_without_odometry_it_learns_how_fast_it_goes(street, localizer):
    """Two images of the map a step; without an image it goes on as it went."""
    near = []
    for seed in range(3):
        localizer.reset(seed)
        told = [localizer.step(None, street.at(street.winter, 4 + 2 * k)) for k in range(32)]
        near += [abs(one.pose[0] / street.step - (4 + 2 * k)) < 1 for k, one in enumerate(told)][-12:]
        blind = localizer.step(None)
        assert abs(blind.pose[0] / street.step - 68) < 2
    assert np.mean(near) > 0.85


@pytest.mark.slow
def test_what_came_later_mends_a_drive_without_odometry(street, localizer):
    localizer.lag = 32
    try:
        before, after = [], []
        for seed in range(3):
            localizer.reset(seed)
            told = [localizer.step(None, street.at(street.winter, 4 + k) if k % 2 == 0 else None) for k in range(32)]
            for found, into in ((told, before), (localizer.past(), after)):
                into += [abs(one.pose[0] / street.step - (4 + k)) for k, one in enumerate(found)]
    finally:
        localizer.lag = 0
        localizer.reset()
    assert np.mean(after) < min(1, np.mean(before))


def test_the_pace_is_that_of_steps_where_images_are_rarer_and_only_of_localizers_that_adapt(street, localizer):
    localizer.reset(0)
    for k in range(40):
        localizer.step(None, street.at(street.summer, 10 + k) if k % 2 == 0 else None)
    assert localizer._now.moves.pace.item() == pytest.approx(street.step, rel=0.2)
    plain = Localizer(localizer.model, Likelihood(), localizer.filter, radius=localizer.radius)
    plain.step(None)
    assert plain._now.moves is localizer.filter.motion


@pytest.mark.slow
def test_without_support_particles_drift_to_where_no_map_is(street, localizer):
    before = Localizer(
        localizer.model,
        Likelihood(tempering=0.125),
        replace(localizer.filter, support=None),
        radius=localizer.radius,
        descriptor=localizer.descriptor,
        image_size=localizer.image_size,
        particles=500,
    )

    def aside(of):
        return np.median([abs(one.pose[1]) for one in street.drive(of)[0][20:]]) / street.step

    assert aside(localizer) < 0.1 < 0.4 < aside(before)


@pytest.mark.slow
def test_after_a_jump_of_odometry_it_comes_back(street, localizer):
    found, away = street.drive(localizer, jump=(25, 1e6))
    assert found[25].lost
    assert found[25].off_map > 0.9
    assert np.mean(away[40:] < 2) > 0.8


@pytest.mark.slow
def test_where_the_map_does_not_reach_it_says_so(street, localizer):
    localizer.reset(0)
    for k in range(25):
        localizer.step((street.step, 0.0, 0.0), street.at(street.summer, 10 + k))
    rng = np.random.default_rng(5)
    for _ in range(12):  # round a corner, into a lane that was never mapped
        noise = gaussian_filter(rng.normal(size=(32, 48, 3)), (2, 4, 0))
        lane = np.clip(128 + 40 * noise / noise.std(), 0, 255).astype(np.uint8)
        told = localizer.step((0.0, 2 * street.step, 0.0), lane)
    assert told.off_map > 0.5


def test_identical_images_make_no_map(street):
    same = np.repeat(street.images[:1], 40, axis=0)
    with pytest.raises(UserError, match="the map's 40 images are all the same picture"):
        Localizer.from_images(same, street.poses[:40], steps=5)


def test_images_that_differ_by_noise_alone_tell_nothing_and_that_is_said(street):
    noise = np.random.default_rng(0).integers(-1, 2, (40, 32, 48, 3))
    nearly = np.clip(street.images[:1] + noise, 0, 255).astype(np.uint8)
    localizer = Localizer.from_images(nearly, street.poses[:40], steps=5)
    told = [localizer.step((street.step, 0.0, 0.0), street.images[0]) for _ in range(5)][-1]
    assert told.lost
    assert np.isfinite(told.pose).all()
    assert told.sigmas[0] > 0


def test_no_robot_moves_that_far(localizer):
    for motion in ((1e308, 0.0, 0.0), (0.0, -1e300, 1.0)):
        with pytest.raises(UserError, match="is further than 1e"):
            localizer.step(motion)


def test_support_and_adaptation_are_saved_and_filters_of_before_have_none(street, localizer, tmp_path):
    localizer.save(tmp_path)
    opened = Localizer.load(tmp_path)
    assert opened.adapts
    assert opened.odds == localizer.odds > 1
    assert opened.filter.support.reach == pytest.approx(street.step / 2)
    ours, theirs = street.drive(localizer, count=10)[0], street.drive(opened, count=10)[0]
    assert all(np.array_equal(a.pose, b.pose) and a.off_map == b.off_map for a, b in zip(ours, theirs, strict=True))
    values = filter_values(localizer.filter)
    del values["support"]
    assert filter_of(values, localizer.model.map.poses).support is None


def test_maps_of_before_keep_the_evidence_and_the_regions_that_they_were_saved_with(localizer, tmp_path):
    localizer.save(tmp_path)
    header = tmp_path / "map.json"
    content = json.loads(header.read_text())
    del content["facts"]["localizer"]["odds"], content["facts"]["localizer"]["region_scale"]
    write_sealed_json(header, content)
    assert Localizer.load(tmp_path).odds is None
    assert Localizer.load(tmp_path).region_scale == 1.0


def test_what_is_told_is_as_wide_as_drives_have_asked_for(street, tmp_path):
    localizer = Localizer.from_images(street.images, street.poses, steps=5, particles=200)
    plain = street.drive(localizer, count=10)[0]
    localizer.region_scale = 3.0
    localizer.save(tmp_path)
    opened = Localizer.load(tmp_path)
    for before, told in zip(plain, street.drive(opened, count=10)[0], strict=True):
        np.testing.assert_array_equal(told.pose, before.pose)
        np.testing.assert_allclose(told.sigmas, 3 * before.sigmas)
        assert (told.mass, told.lost) == (before.mass, before.lost)


def test_the_kernel_of_a_map_is_sharper_than_what_one_traverse_taught(street):
    localizer = Localizer.from_images(street.images, street.poses, steps=3)
    taught = fitted_kernel(localizer.model.map, steps=3)
    assert localizer.model.kernel == taught.sharpened(SHARPER, NOISE)
    given = Localizer.from_images(street.images, street.poses, kernel=taught, descriptor="Pixels")
    assert given.model.kernel == taught  # a kernel that is given is taken as it is


@pytest.mark.parametrize("without_gradients", [torch.no_grad, torch.inference_mode])
def test_a_map_is_made_where_a_program_has_turned_gradients_off(street, without_gradients):
    usual = Localizer.from_images(street.images, street.poses, steps=3).model.kernel
    with without_gradients():
        assert Localizer.from_images(street.images, street.poses, steps=3).model.kernel == usual


def gardens(folder, walk):
    files = sorted((folder / "gardens_point" / walk).glob("*.jpg"))
    return np.stack([np.asarray(Image.open(file).convert("RGB")) for file in files])


@pytest.fixture(scope="module")
def mapped_gardens(real_data):
    """Gardens Point: the left side of the walk by day is the map."""
    images = gardens(real_data, "day_left")
    return Localizer.from_images(images, np.array([(float(i), 0.0, 0.0) for i in range(len(images))]))


@pytest.mark.slow
@pytest.mark.parametrize(("query", "least"), [("day_right", 0.85), ("night_right", 0.2)])
def test_a_real_walk_in_changed_light(real_data, mapped_gardens, query, least):
    """Before support it was 0 and 0."""
    localizer, seen, right = mapped_gardens, gardens(real_data, query), []
    for seed in range(2):
        localizer.reset(seed)
        rng = np.random.default_rng(seed)
        for i in range(20, 140):
            told = localizer.step((1 + 0.1 * rng.normal(), 0.02 * rng.normal(), 0.005 * rng.normal()), seen[i])
            right += [np.hypot(told.pose[0] - i, told.pose[1]) <= 2] if i >= 80 else []
    assert np.mean(right) > least
