"""Live use: a map from arrays or from a run, and poses out of it."""

import json
import math
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image
from quick_runs import quick_runs  # noqa: F401
from scipy.ndimage import gaussian_filter
from tiny_office import pose_error
from tiny_places import tiny_checkpoint

import sextant
from sextant import Localizer
from sextant.baselines import Pixels
from sextant.chapters.places.saved_descriptor import SavedDescriptor, kept_network, load_descriptor
from sextant.errors import UserError
from sextant.evaluation.protocols import OFFICE_LOCALIZATION
from sextant.localization.initialisation import GaussianStart, UniformStart
from sextant.localization.likelihood import Likelihood
from sextant.localization.localize import localize
from sextant.localization.map_support import MapSupport
from sextant.localization.motion import IdentityMotion
from sextant.localization.observers import Camera
from sextant.localization.pose_kernel import PoseKernel
from sextant.localization.tiled_map import TiledMapBuilder

STEP = 0.5
KERNEL = PoseKernel("rbf", (2.0, 2.0), 1.0, 0.008, 0.002)


class Corridor:
    """A wall that a camera looks at while it moves along: what is seen at x is known."""

    def __init__(self):
        rng = np.random.default_rng(0)
        wall = gaussian_filter(rng.normal(size=(32, 700, 3)), (2, 4, 0))
        self.wall = np.clip(128 + 50 * wall / wall.std(), 0, 255).astype(np.uint8)
        self.poses = np.array([(x, 0.0, 0.0) for x in np.arange(0.0, 40.0, STEP)])
        self.images = np.stack([self.at(x) for x, _, _ in self.poses])

    def at(self, x):
        return self.wall[:, round(x * 15) : round(x * 15) + 48]

    def localizer(self, **given):
        return Localizer.from_images(
            self.images, self.poses, **{"descriptor": Pixels(16, 24), "kernel": KERNEL, "particles": 200} | given
        )


@pytest.fixture(scope="module")
def corridor():
    return Corridor()


def drive(localizer, corridor, start=5.2, steps=12, step=0.7):
    return [localizer.step(None if k == 0 else (step, 0.0, 0.0), corridor.at(start + step * k)) for k in range(steps)]


def same(a, b):
    return len(a) == len(b) and all(
        np.array_equal(x.pose, y.pose) and np.array_equal(x.covariance, y.covariance) and x.mass == y.mass
        for x, y in zip(a, b, strict=True)
    )


def test_the_package_has_no_other_names():
    with pytest.raises(AttributeError, match="Localiser"):
        sextant.Localiser  # noqa: B018


# --- a map from arrays ------------------------------------------------------------------------------------------------


def test_five_lines_of_python_tell_where_one_is(corridor):
    localizer = Localizer.from_images(corridor.images, corridor.poses, steps=20)
    told = drive(localizer, corridor, steps=20)
    assert abs(told[-1].pose[0] - (5.2 + 0.7 * 19)) < 0.5  # how far to the side, no image of this map tells
    assert not told[-1].lost
    assert told[-1].modes == 1
    assert told[-1].sigmas.shape == (3,)
    assert 0.5 <= told[-1].mass <= 1 + 1e-9


@pytest.mark.slow
def test_it_goes_the_same_way_again_after_a_reset_and_another_way_with_another_seed(corridor):
    localizer = corridor.localizer(seed=3)
    first = drive(localizer, corridor)
    localizer.reset()
    assert same(first, drive(localizer, corridor))
    localizer.reset(seed=4)
    assert not same(first, drive(localizer, corridor))


def test_a_reset_that_is_refused_changes_nothing(corridor):
    localizer = corridor.localizer(seed=3)
    for wrong in ({"seed": -1}, {"seed": 5, "start": "nowhere"}, {"seed": 5, "start": ""}):
        with pytest.raises(UserError, match=r"seed=-1|start="):
            localizer.reset(**wrong)
        assert localizer.seed == 3
    localizer.reset()


def test_numbers_of_numpy_are_saved_and_a_wrong_fact_keeps_the_former_map(corridor, tmp_path):
    localizer = corridor.localizer(particles=np.int64(300), radius=np.float32(2))
    localizer.save(tmp_path)
    localizer.facts["of"] = object()
    with pytest.raises(UserError, match="of=<object"):
        localizer.save(tmp_path)
    loaded = Localizer.load(tmp_path)
    assert (loaded.particles, loaded.radius, loaded.facts) == (300, 2.0, {})


@pytest.mark.parametrize("descriptor", [Pixels(16, 24), None])
def test_what_was_saved_tells_the_same_bit_by_bit_wherever_it_is_moved(corridor, tmp_path, descriptor):
    localizer = corridor.localizer(descriptor=descriptor)
    localizer.save(tmp_path / "a")
    shutil.move(tmp_path / "a", tmp_path / "elsewhere")
    loaded = Localizer.load(tmp_path / "elsewhere")
    assert loaded.particles == 200
    assert same(drive(localizer, corridor), drive(loaded, corridor))
    assert not [path for path in (tmp_path / "elsewhere").rglob("*") if path.suffix in (".pkl", ".pt", ".ckpt")]


def test_it_is_the_filter_of_the_tests(corridor):
    localizer = corridor.localizer(likelihood=Likelihood(tempering=0.125))  # which no drive changes
    told = drive(localizer, corridor)
    rows = np.stack([localizer.describe(corridor.at(5.2 + 0.7 * k)) for k in range(12)])
    track = localize(
        localizer.filter,
        UniformStart(),
        Camera(localizer.model, localizer.likelihood, rows),
        np.arange(12)[:, None],
        np.repeat([[[0.7, 0.0, 0.0]]], 12, axis=0),
        np.ones((12, 1), bool),
        torch.Generator().manual_seed(0),
        particles=200,
        radius=localizer.radius,
    )
    assert np.array_equal(track.pose[:, 0], np.stack([one.pose for one in told]))
    assert np.array_equal(track.mass[:, 0], np.array([one.mass for one in told]))


@pytest.mark.slow
def test_a_descriptor_does_as_well_as_its_image_and_a_whitener_is_applied_to_both(corridor, tmp_path):
    localizer = corridor.localizer()
    images = drive(localizer, corridor)
    localizer.reset()
    vectors = [
        localizer.step(None if k == 0 else (0.7, 0, 0), descriptor=localizer.describe(corridor.at(5.2 + 0.7 * k)))
        for k in range(12)
    ]
    assert same(images, vectors)

    rng = np.random.default_rng(1)
    mixed = torch.from_numpy(np.linalg.qr(rng.normal(size=(384, 384)))[0])
    rows = Pixels(16, 24).describe(corridor.images) @ mixed.numpy().astype(np.float32)
    turned = corridor.localizer(descriptor=Rows(rows))
    facts = {"kind": "baseline", "class": "Pixels", "arguments": {"height": 16, "width": 24}}
    whitening = Localizer(
        turned.model,
        turned.likelihood,
        turned.filter,
        radius=1.0,
        descriptor=SavedDescriptor(Pixels(16, 24), facts, {}, mixed),
        image_size=(32, 48, 3),
        particles=200,
        adapts=True,
        odds=turned.odds,
    )
    whitening.save(tmp_path)
    for one in (whitening, Localizer.load(tmp_path)):  # a rotation changes no distance
        plain = drive(corridor.localizer(), corridor)[-1]
        assert np.allclose(drive(one, corridor)[-1].pose, plain.pose, atol=0.05)


class Rows:
    """A descriptor of the user's own, which cannot be kept."""

    def __init__(self, rows=None):
        self.rows = rows

    def describe(self, images):
        return self.rows if self.rows is not None else Pixels(16, 24).describe(images)


def test_a_map_of_a_stream_of_images_is_opened_with_the_usual_filter(corridor, tmp_path):
    made = corridor.localizer()
    builder = TiledMapBuilder(tmp_path)
    for poses, rows in zip(made.model.map.poses.split(13), made.model.map.descriptors.split(13), strict=True):
        builder.add(poses, rows)
    builder.finish(KERNEL, made.likelihood, tile=32, map_evidence="mean", facts={"city": "none"})
    opened = Localizer.load(tmp_path, particles=200, descriptor=made.descriptor.describer, verify=False)
    assert (opened.radius, opened.facts, opened.image_size) == (2.5 * STEP, {"city": "none"}, None)
    assert opened.filter.prior.sigmas == made.filter.prior.sigmas
    # of equally far images another may be the neighbour: the same but for that, once both know where they are
    for ours, theirs in list(zip(drive(opened, corridor), drive(made, corridor), strict=True))[6:]:
        assert ours.pose == pytest.approx(theirs.pose, abs=0.1)
        assert ours.lost == theirs.lost
    assert Localizer.load(tmp_path, radius=2.0).radius == 2.0


def test_a_descriptor_of_ones_own_is_given_again(corridor, tmp_path):
    localizer = corridor.localizer(descriptor=Rows())
    told = drive(localizer, corridor)
    localizer.save(tmp_path)
    with pytest.raises(UserError, match="built from descriptors computed elsewhere"):
        Localizer.load(tmp_path).step(None, corridor.at(3.0))
    assert same(told, drive(Localizer.load(tmp_path, descriptor=Rows()), corridor))


def test_unknown_motion_spreads_the_particles_and_nothing_seen_changes_no_weight(corridor):
    localizer = corridor.localizer(start=GaussianStart(torch.tensor([[20.0, 0.0, 0.0]]).double(), (0.01, 0.01, 0.01)))
    localizer.filter = replace(localizer.filter, support=None)  # which weighs where the particles are
    localizer.step()
    before = localizer.belief
    known = localizer.step((0.0, 0.0, 0.0))
    unknown = localizer.step(None)
    assert known.sigmas[0] < 0.05 < 0.15 < unknown.sigmas[0]
    assert torch.equal(before.log_weights, localizer.belief.log_weights)


def test_images_that_come_too_soon_change_no_weight_and_a_saved_map_remembers(corridor, tmp_path):
    localizer = corridor.localizer()
    everywhere = MapSupport.everywhere(localizer.filter.prior.poses, outliers=0.1)
    localizer.filter = replace(localizer.filter, support=everywhere, apart=(2.0, 1.0), ess_threshold=0.0)
    counted, before = [], None
    for step in range(7):
        localizer.step((0.7, 0.0, 0.0), corridor.at(5.2 + 0.7 * step))
        after = localizer.belief.log_weights
        counted.append(before is None or not torch.allclose(before, after, rtol=0, atol=1e-9))
        before = after
    assert counted == [True, False, False, True, False, False, True]
    localizer.save(tmp_path)
    loaded = Localizer.load(tmp_path)
    assert loaded.filter.apart == (2.0, 1.0)
    assert (loaded.filter.support.reach, loaded.filter.support.outliers) == (math.inf, 0.1)
    localizer.reset()
    assert same(drive(localizer, corridor), drive(loaded, corridor))


def test_one_particle_and_an_image_that_nothing_explains(corridor):
    one = corridor.localizer(particles=1)
    assert all(np.isfinite(told.pose).all() and told.mass == 1 for told in drive(one, corridor))
    localizer = corridor.localizer()
    localizer.step(None, corridor.at(5.0))
    told = localizer.step((0.5, 0.0, 0.0), descriptor=np.full(384, 3e38, np.float32))
    assert told.degenerate
    assert np.isfinite(told.pose).all()
    assert not drive(localizer, corridor)[-1].degenerate


def test_the_first_image_can_say_where_to_start(corridor):
    localizer = corridor.localizer(start="appearance", particles=50)
    told = localizer.step(None, corridor.at(20.0))
    assert abs(told.pose[0] - 20) < 2


# --- the map of a run -------------------------------------------------------------------------------------------------


def test_the_frames_of_a_drive_end_within_the_protocol(office):
    told = office.steps(Localizer.load(office.folder))
    position, heading = pose_error(told[-1].pose, office.drive.poses[office.frames - 1])
    assert position <= OFFICE_LOCALIZATION.position
    assert heading <= OFFICE_LOCALIZATION.heading_deg
    assert not told[-1].lost


def test_a_runs_map_has_what_the_run_calibrated_and_filtered_with(office):
    localizer = Localizer.load(office.folder / "map")
    metrics = json.loads((office.folder / "metrics.json").read_text())["metrics"]
    assert localizer.likelihood.tempering == pytest.approx(metrics["val/tempering"])
    assert localizer.particles == 400
    assert localizer.filter.recovery.weigh_jitter
    assert localizer.image_size == (32, 48, 3)
    assert localizer.radius == 2 * OFFICE_LOCALIZATION.position
    rows = localizer.descriptor.describer.describe(office.images[:3])
    assert rows.shape == (3, localizer.model.map.dimension)


def test_images_may_be_files_pictures_arrays_and_lists_of_any_size(corridor, tmp_path):
    pictures = [Image.fromarray(image) for image in corridor.images]
    files = [tmp_path / f"{number:03d}.png" for number in range(len(pictures))]
    for picture, file in zip(pictures, files, strict=True):
        picture.save(file)
    poses = corridor.poses.tolist()
    given = ((corridor.images, "Pixels"), (pictures, "pixels"), (files, Pixels()))
    made = [Localizer.from_images(images, poses, name, kernel=KERNEL, seed=3) for images, name in given]
    first = made[0].model.map.descriptors
    assert all(torch.equal(one.model.map.descriptors, first) for one in made[1:])
    seen = corridor.at(3.0)
    enlarged = Image.fromarray(seen).resize((96, 64), Image.Resampling.NEAREST)
    steps = [made[0].describe(image) for image in (seen, seen.tolist(), Image.fromarray(seen))]
    assert all(np.array_equal(step, steps[0]) for step in steps)
    np.testing.assert_allclose(made[0].describe(enlarged), steps[0], atol=0.05)


def test_a_motion_may_be_a_tensor_with_a_gradient(corridor):
    steps = [
        corridor.localizer().step(motion, corridor.at(3.5)).pose
        for motion in ((0.5, 0.0, 0.0), torch.tensor([0.5, 0.0, 0.0], requires_grad=True))
    ]
    np.testing.assert_array_equal(*steps)


def test_a_map_of_few_images_is_one(corridor):
    localizer = Localizer.from_images(corridor.images[:5], corridor.poses[:5], "WhitenedPCA", kernel=KERNEL)
    assert localizer.model.map.dimension == 4
    assert np.isfinite(localizer.step(None, corridor.images[2]).pose).all()


# --- mistakes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"descriptor": np.zeros(7, np.float32)}, "descriptors of 7 values"),
        ({"descriptor": np.full(384, np.nan, np.float32)}, "finite"),
        ({"image": np.zeros((32, 48, 3))}, "float64 32x48x3; the network takes uint8 32x48x3"),
        ({"image": np.zeros((32, 48, 2), np.uint8)}, "uint8 32x48x2"),
        ({"image": "gone.png"}, "gone.png does not exist"),
        ({"image": np.zeros((32, 48, 3), np.uint8), "descriptor": np.zeros(384, np.float32)}, "an image and a desc"),
        ({"motion": (np.nan, 0, 0)}, "three finite numbers"),
        ({"motion": (1, 0)}, "three finite numbers"),
        ({"motion": "abc"}, "three finite numbers"),
        ({"motion": np.zeros((32, 48, 3))}, r"motion=an array of the shape \(32, 48, 3\) must be three finite numbers"),
        ({"image": b"\x89PNG"}, r"of type bytes; the network takes uint8 32x48x3\n.*PIL.Image.open\(io.BytesIO"),
        ({"motion": (1, 0, 20)}, "turns by 20 rad, more than a full turn"),
        ({"descriptor": "abc"}, "not one row of finite numbers"),
    ],
)
def test_a_step_that_does_not_fit_the_map_is_refused_and_changes_nothing(corridor, given, says):
    localizer, other = corridor.localizer(), corridor.localizer()
    for one in (localizer, other):
        one.step(None, corridor.at(3.0))
    with pytest.raises(UserError, match=says):
        localizer.step(**given)
    assert same([localizer.step((0.5, 0, 0), corridor.at(3.5))], [other.step((0.5, 0, 0), corridor.at(3.5))])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"poses": np.zeros((3, 3))}, "for 80 images"),
        ({"poses": np.full((80, 3), np.nan)}, "poses that are not finite"),
        ({"poses": np.zeros((80, 3))}, "same x, y and heading"),
        ({"images": np.zeros((0, 32, 48, 3), np.uint8)}, "images: there is none"),
        ({"images": np.zeros((1, 32, 48, 3), np.uint8), "poses": np.zeros((1, 3))}, "the map has only one image"),
        ({"poses": [[0, 0], [1]]}, "for 80 images"),
        ({"poses": [[k, 0, 90] for k in range(80)]}, "the heading 90 of image 0 exceeds two full turns"),
        ({"particles": 0}, "particles=0 must be a whole number, at least 1"),
        ({"particles": 2_000_000}, "must be a whole number, at least 1 and at most 1000000"),
        ({"particles": 100.5}, r"particles=100\.5 must be a whole number"),
        ({"lag": 2.5}, r"lag=2\.5 must be a whole number"),
        ({"seed": 2**70}, "seed=1180591620717411303424 must be a whole number"),
        ({"steps": -1}, "steps=-1 must be a whole number, at least 0"),
        ({"radius": 0}, "radius=0 must be a number above 0 and finite"),
        ({"descriptor": "HOGG"}, "descriptor=HOGG is neither one of .*Hog.* nor a run"),
        ({"descriptor": "hogs", "images": None}, "descriptor=hogs is neither one of .*Hog.* nor a run"),
        ({"descriptor": np.zeros(3)}, "descriptor=ndarray cannot describe images"),
        ({"start": "somewhere"}, "start=somewhere must be one of uniform, appearance"),
        ({"start": ["uniform"]}, r"start=\['uniform'\] must be one of uniform, appearance"),
        ({"radius": "2"}, "radius='2' must be a number above 0 and finite"),
        ({"kernel": "rbf"}, "kernel='rbf' must be of the class PoseKernel"),
        ({"observation": "LocalGP"}, "observation='LocalGP' must be of the class ObservationModel"),
        ({"likelihood": 1}, "likelihood=1 must be of the class Likelihood"),
        ({"motion": "spacing"}, "motion='spacing' must be of the class MotionModel"),
        ({"recovery": "none"}, "recovery='none' must be of the class Recovery"),
        ({"images": None}, "images is of type NoneType; several images are expected"),
        ({"images": Image.new("RGB", (48, 32))}, "images is of type Image; several images are expected"),
        ({"poses": [[k * 1e-200, 0, 0] for k in range(80)]}, r"all positions lie within 7.9e-199 m, less than 1e-06"),
        ({"poses": [[k * 1e200, 0, 0] for k in range(80)]}, r"a position of 7.9e\+201 m is further than 1e\+09"),
    ],
)
def test_what_makes_no_map_is_refused(corridor, change, says):
    images, poses = change.pop("images", corridor.images), change.pop("poses", corridor.poses)
    with pytest.raises(UserError, match=says):
        Localizer.from_images(images, poses, **{"descriptor": Pixels(16, 24), "kernel": KERNEL} | change)


def test_what_no_map_is_opened_by_is_refused(corridor, tmp_path):
    with pytest.raises(UserError, match="None is not a saved map: there is no such folder"):
        Localizer.load(None)
    corridor.localizer().save(tmp_path)
    for part in ("motion", "recovery"):
        with pytest.raises(UserError, match=f"{part}='none' must be of the class"):
            Localizer.load(tmp_path, **{part: "none"})


@pytest.mark.parametrize("pose", [[0, 0], [np.nan, 0, 0], "abc"])
def test_a_picture_is_asked_for_by_a_pose(corridor, pose):
    with pytest.raises(UserError, match="three finite numbers: x, y, heading"):
        corridor.localizer().picture_near(pose)


def test_nothing_is_believed_before_the_first_step(corridor):
    with pytest.raises(UserError, match="before the first step"):
        corridor.localizer().belief  # noqa: B018


@pytest.mark.parametrize(
    ("file", "says"),
    [("descriptors.npy", "damaged"), ("descriptor/descriptor.safetensors", "damaged"), ("map.json", "not the header"),
     ("descriptor/descriptor.json", "damaged")],
)  # fmt: skip
def test_a_damaged_file_is_told(corridor, tmp_path, file, says):
    corridor.localizer(descriptor=None).save(tmp_path)
    content = (tmp_path / file).read_bytes()
    (tmp_path / file).write_bytes(content[: len(content) // 2])
    with pytest.raises(UserError, match=says):
        Localizer.load(tmp_path)


def test_the_descriptor_of_another_map_is_refused(corridor, tmp_path):
    corridor.localizer().save(tmp_path / "a")
    corridor.localizer(descriptor=Pixels(8, 12)).save(tmp_path / "b")
    shutil.copytree(tmp_path / "b" / "descriptor", tmp_path / "a" / "descriptor", dirs_exist_ok=True)
    with pytest.raises(UserError, match="not the descriptor that the map was made with"):
        Localizer.load(tmp_path / "a")


def test_filter_parts_of_ones_own_are_asked_for(corridor, tmp_path):
    class Still(IdentityMotion):
        """Of one's own: its import path is not Sextant's."""

    corridor.localizer(motion=Still()).save(tmp_path)
    with pytest.raises(UserError, match="user-defined motion model"):
        Localizer.load(tmp_path)
    assert isinstance(Localizer.load(tmp_path, motion=Still()).filter.motion, Still)


def test_nothing_but_sextants_own_classes_is_made_of_what_a_file_names(corridor, tmp_path):
    corridor.localizer().save(tmp_path)
    header = json.loads((tmp_path / "map.json").read_text())
    header["facts"]["localizer"]["filter"]["motion"] = {"class": "__import__", "arguments": {"name": "os"}}
    (tmp_path / "map.json").write_text(json.dumps(header))
    with pytest.raises(UserError, match="damaged"):
        Localizer.load(tmp_path)


# --- trained networks -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    path = tiny_checkpoint(tmp_path_factory.mktemp("network") / "last.ckpt")
    return SimpleNamespace(path=path, folder=path.parent)


def test_a_network_goes_with_the_map(corridor, checkpoint, tmp_path):
    other = tmp_path / "run" / "last.ckpt"
    shutil.copytree(checkpoint.folder, other.parent)
    localizer = corridor.localizer(descriptor=other)
    told = drive(localizer, corridor, steps=3)
    localizer.save(tmp_path / "map")
    shutil.rmtree(other.parent)
    assert same(told, drive(Localizer.load(tmp_path / "map"), corridor, steps=3))


def test_a_network_of_code_that_is_not_sextants_is_not_built(checkpoint, tmp_path):
    kept = kept_network(checkpoint.path)
    kept.facts["config"]["backbone"] = {"_target_": "os.system"}
    kept.save(tmp_path)
    with pytest.raises(UserError, match=r"os\.system"):
        load_descriptor(tmp_path)


def test_it_says_what_it_is_and_is_saved_in_folders_alone(corridor, tmp_path):
    localizer = Localizer.from_images(corridor.images, corridor.poses, Pixels(16, 24), kernel=KERNEL)
    assert repr(localizer) == (
        "Localizer(80 images, 384 numbers each by descriptor 'baseline', spacing=0.5 m, particles=2,000, adapts=True)"
    )
    (tmp_path / "grey.png").write_bytes(b"a picture")
    for name in ("grey.png", "grey.png/map", "x" * 300):
        with pytest.raises(UserError, match=r"^folder=.* is not a folder that can be written to: "):
            localizer.save(tmp_path / name)
    assert (tmp_path / "grey.png").read_bytes() == b"a picture"
