"""One filter: many runs together are many runs alone, and one run of the engine is the live localizer, to the bit."""

import math
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
import torch
from jaxtyping import TypeCheckError
from torch.overrides import TorchFunctionMode
from torch.utils._pytree import tree_leaves

from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.saved_filter import usual_filter, usual_radius
from sextant.errors import UserError
from sextant.localization import recovery, resampling
from sextant.localization.adaptation import Adaptation
from sextant.localization.belief import Belief
from sextant.localization.descriptor_map import DescriptorMap
from sextant.localization.estimate import estimate
from sextant.localization.initialisation import AppearanceStart, UniformStart
from sextant.localization.kld_size import KLDSize
from sextant.localization.likelihood import Likelihood
from sextant.localization.localize import Steps, localize
from sextant.localization.motion import OdometryMotion
from sextant.localization.observation import (
    SGPR,
    SKI,
    SVGP,
    CachedLocalGP,
    ExactGP,
    KernelMixture,
    KernelSum,
    LocalGP,
    RandomFeatures,
)
from sextant.localization.observers import Camera
from sextant.localization.pose_kernel import PoseKernel

PLACES, DIMENSION, STEPS, RUNS = 40, 16, 24, 5
MODELS = [CachedLocalGP(8, map_evidence="mean"), CachedLocalGP(8, blend=2), LocalGP(8), KernelMixture(8), KernelSum(3)]
PARTS = ("change", "scale", "innovation", "recognition", "drive", "odometry", "standstill", "velocity")


def world(model=MODELS[0]):
    """A map along a line, with images that are alike where they are near each other, and images of another drive."""
    rng = np.random.default_rng(1)
    rough = np.cumsum(rng.normal(size=(PLACES + 6, DIMENSION)), 0)
    places = ((rough[6:] - rough[:-6]) / 3).astype(np.float32)
    poses = torch.tensor([[2.0 * k, 0.1 * k, 0.05] for k in range(PLACES)], dtype=torch.float64)
    kernel = PoseKernel("rbf", (4.0, 4.0), 0.6, 1.0, 0.02)
    fitted = model.fit(DescriptorMap.of(poses, torch.from_numpy(places)), kernel)
    again = places + 0.3 * rng.normal(size=places.shape).astype(np.float32) + 0.4
    return fitted, usual_filter(poses, kernel), again.astype(np.float32)


def drives(runs=RUNS):
    """Frames, motion and whether there is an image, by step and run; each run has faults of its own."""
    rng = np.random.default_rng(2)
    frames = np.minimum(np.arange(STEPS)[:, None] + 3 * np.arange(runs), PLACES - 1)
    motion = np.tile([1.8, 0.0, 0.0], (STEPS, runs, 1)) + 0.05 * rng.normal(size=(STEPS, runs, 3))
    seen = rng.random((STEPS, runs)) < 0.8
    for run in range(runs):
        motion[2 * run + 8 : 2 * run + 18, (run + 1) % runs] = 0.0  # odometry that stands
        motion[4 * run : 4 * run + 5, run] = np.nan
        frames[4 * run + 1 : 4 * run + 4, run] = frames[4 * run, run]  # and stands
    return frames, motion, seen


def assert_same(many, single, run, name=""):
    """All tensors of the state of one run."""
    for each in fields(many):
        value, other = getattr(many, each.name), getattr(single, each.name)
        if is_dataclass(value):
            assert_same(value, other, run, f"{name}.{each.name}")
        elif isinstance(value, torch.Tensor):
            told = lambda text, field=each.name: f"{name}.{field}: {text}"  # noqa: E731
            value = value[run : run + 1]
            torch.testing.assert_close(value, other, rtol=1e-5, atol=1e-5, equal_nan=True, msg=told)


@pytest.mark.parametrize("learns", [True, False])
@pytest.mark.parametrize("model", MODELS, ids=["cached", "blended", "local", "mixture", "sum"])
def test_runs_together_are_runs_alone(model, learns):
    """Given the same beliefs. Sums over several descriptors have another order than over one, so not to the bit."""
    fitted, filter, again = world(model)
    frames, motion, seen = drives()
    rules = Adaptation(fitted, Likelihood(tempering=0.125), learns=learns, odds=20.0)
    noise = torch.randn(STEPS, RUNS, 50, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    clouds = fitted.map.poses[torch.from_numpy(frames)][:, :, None] + noise * noise.new_tensor([0.7, 0.7, 0.02])

    def along(runs):
        learned, belief, states = rules.start(len(runs)), None, []
        for step in range(STEPS):
            images, looked = torch.from_numpy(again[frames[step, runs]]), torch.from_numpy(seen[step, runs])
            learned, moved = rules.believed(learned, torch.from_numpy(motion[step, runs]), images, looked)
            learned, evidence, used = rules.observed(learned, moved, images, looked, belief, filter.support)
            moves = rules.motion(learned, filter.motion)
            belief = Belief.uniform(clouds[step, runs])
            drawn = moves.unmeasured(noise[step, runs])
            told = torch.zeros(len(runs), 50) if evidence is None else evidence.log_likelihood(belief.poses)
            learned = rules.after(learned, moved, estimate(belief, 5.0), filter.support.off_map(belief), used)
            states.append((learned, told.double(), drawn))
        return states

    together = along(list(range(RUNS)))
    for run in range(RUNS):
        for (many, told, drawn), (single, other, alone) in zip(together, along([run]), strict=True):
            assert_same(many, single, run)
            torch.testing.assert_close(told[run : run + 1], other, rtol=1e-4, atol=1e-3)
            torch.testing.assert_close(drawn[run : run + 1], alone, rtol=1e-5, atol=1e-5)
    last = together[-1][0]
    assert bool((last.innovation.images > 2).all())
    assert bool((last.drive.images > 0).all())
    if learns:
        assert any(bool(learned.disbelieved.any()) for learned, _, _ in together)
        assert bool((last.change.excess > 0).any())
        assert bool((last.odometry.factor != 1).any())
        assert bool((last.velocity.weights > 0).any())
        assert bool((last.scale.images > 0).all())


@pytest.mark.parametrize("start", ["uniform", "appearance"])
@pytest.mark.parametrize("adapts", [True, False])
def test_one_run_of_the_engine_is_the_live_localizer_to_the_bit(adapts, start):
    fitted, filter, again = world()
    frames, motion, seen = (each[:, 1:2] for each in drives())
    likelihood, radius = Likelihood(tempering=0.125), usual_radius(filter.prior.poses)
    given = {"radius": radius, "particles": 200}
    live = Localizer(fitted, likelihood, filter, adapts=adapts, odds=20.0, start=start, seed=4, **given)
    begins = AppearanceStart() if start == "appearance" else UniformStart()
    rules = Adaptation(fitted, likelihood, odds=20.0) if adapts else None
    beliefs, draws, camera = [], torch.Generator().manual_seed(4), Camera(fitted, likelihood, again)
    watch = lambda step, belief: beliefs.append(belief)  # noqa: E731
    track = localize(filter, begins, camera, frames, motion, seen, draws, adaptation=rules, watch=watch, **given)
    for step in range(STEPS):
        moved = motion[step, 0] if np.isfinite(motion[step, 0]).all() else None
        told = live.step(moved, descriptor=again[frames[step, 0]] if seen[step, 0] else None)
        assert torch.equal(live.belief.poses, beliefs[step].poses), step
        assert torch.equal(live.belief.log_weights, beliefs[step].log_weights), step
        assert np.array_equal(told.pose, track.pose[step, 0])
        assert np.array_equal(told.covariance, track.covariance[step, 0])
    assert adapts == (live.odometry_scale != 1)


def test_a_filter_that_only_judges_moves_as_one_without():
    fitted, filter, again = world()
    camera, radius, found = Camera(fitted, Likelihood(), again), usual_radius(filter.prior.poses), []
    for rules in (None, Adaptation(fitted, Likelihood(), learns=False)):
        draws, given = torch.Generator().manual_seed(0), {"particles": 100, "radius": radius, "adaptation": rules}
        found.append(localize(filter, UniformStart(), camera, *drives(), draws, **given).pose)
    assert np.array_equal(*found)
    frames, motion, seen = drives()
    for moved, looked in ((motion[:, :1], seen), (motion, seen[:, :1])):
        with pytest.raises((UserError, TypeCheckError), match=r"(motion|seen) has .* must have|Type-check error"):
            localize(filter, UniformStart(), camera, frames, moved, looked, draws, **given)


def after_nine_steps(again, motion, seen, offset=10):
    fitted, filter, _ = world()
    rules = Adaptation(fitted, Likelihood(tempering=0.125), odds=20.0)
    steps, camera = Steps(filter, UniformStart(), 100, 5.0, rules), Camera(fitted, Likelihood(), again)
    draws, now = torch.Generator().manual_seed(0), None
    for frame in range(9):
        frames = np.array([frame, frame + offset])
        now = steps.step(now, torch.tensor(motion).double(), camera, frames, torch.tensor(seen), draws)
    return rules, now


def test_images_that_overflow_teach_nothing():
    again = world()[2]
    again[5] = 3e38
    _, now = after_nine_steps(again, [[2.0, 0.0, 0.0]] * 2, [True, True])
    assert now.learned.change.images.tolist() == [8.0, 9.0]
    assert now.learned.change.mean.isfinite().all()
    assert now.found.pose.isfinite().all()


def test_a_run_without_images_learns_nothing_beside_one_that_has_them():
    rules, now = after_nine_steps(world()[2], [[2.0, 0.0, 0.0], [math.nan] * 3], [True, False])
    for name in PARTS:
        assert_same(getattr(now.learned, name), getattr(rules.start(1), name), 1, name)
    assert now.learned.change.images[0] == 9


class NothingOnTheDefaultDevice(TorchFunctionMode):
    """With ``meta`` as the default device, a tensor that was not put where the map is has that device."""

    def __torch_function__(self, func, types, args=(), kwargs=None):
        found = func(*args, **(kwargs or {}))
        made = [each for each in tree_leaves(found) if isinstance(each, torch.Tensor) and each.device.type == "meta"]
        assert not made, f"{func} made a tensor on the default device"
        return found


USUAL = MODELS[0]
DEVICE_CASES = {
    "usual": (USUAL, {}),
    **{type(each).__name__: (USUAL, {"recovery": each}) for each in (
        recovery.NoRecovery(), recovery.UniformInjection(), recovery.AugmentedMCL(), recovery.TopKInjection(),
        recovery.BayesRestart(window=5, weigh_jitter=True),
    )},
    **{type(each).__name__: (USUAL, {"resampling": each}) for each in (
        resampling.StratifiedResampling(), resampling.ResidualResampling(), resampling.MultinomialResampling()
    )},
    "kld": (USUAL, {"kld": KLDSize(0.1, 0.05, 50, 300, 1.0, 0.3)}),
    "apart": (USUAL, {"apart": (3.0, 0.5)}),
    "odometry": (USUAL, {"motion": OdometryMotion()}),
    **{repr(number): (each, {}) for number, each in enumerate((
        *MODELS[1:], ExactGP(), LocalGP(8, "nearest_image"), SGPR(10), SVGP(10, steps=5, batch=20), SKI(0.5, 20),
        RandomFeatures(100), CachedLocalGP(8, rounded=True),
    ))},
}  # fmt: skip


@pytest.mark.parametrize(("case", "adapts"), [("usual", False), *((each, True) for each in DEVICE_CASES)])
def test_no_tensor_of_a_step_is_on_the_default_device_by_accident(case, adapts):
    model, changes = DEVICE_CASES[case]
    fitted, filter, again = world(model)
    rules = Adaptation(fitted, Likelihood(tempering=0.125), odds=20.0) if adapts else None
    start = AppearanceStart() if case == "usual" else UniformStart()
    steps, camera = Steps(replace(filter, **changes), start, 60, 5.0, rules), Camera(fitted, Likelihood(), again)
    frames, motion, seen = drives(2)
    motion, seen, draws, now = torch.from_numpy(motion), torch.from_numpy(seen), torch.Generator().manual_seed(0), None
    with torch.device("meta"), NothingOnTheDefaultDevice():
        for step in range(STEPS):
            now = steps.step(now, motion[step], camera, frames[step], seen[step], draws)
    assert now.found.pose.isfinite().all()


def test_that_test_notices_one():
    with (
        pytest.raises(AssertionError, match="on the default device"),
        torch.device("meta"),
        NothingOnTheDefaultDevice(),
    ):
        torch.zeros(3)


def stood_still(motion, count=20, every=1):
    """Two live filters together and the first alone: ten images ahead, then an image that repeats."""
    model, filter, images = world()
    rules = Adaptation(model, Likelihood(), odds=20.0)
    steps = Steps(filter, AppearanceStart(), 500, usual_radius(filter.prior.poses), rules)
    camera, generator, poses, now = Camera(model, Likelihood(), images), torch.Generator().manual_seed(0), [], None
    for step in range(count):
        seen = torch.full((2,), step < 10 or step % every == 0)
        now = steps.step(now, motion.expand(2, 3), camera, np.full(2, min(step, 9)), seen, generator)
        poses.append(now.found.pose[:, 0])
    return torch.stack(poses), now


@pytest.mark.slow
def test_where_motion_is_unknown_an_image_that_repeats_holds_the_robot():
    poses, now = stood_still(torch.full((1, 3), math.nan, dtype=torch.float64), count=500)
    assert (poses[9] - 18.0).abs().max() < 2.0  # at the tenth image
    assert (poses[499] - poses[9]).abs().max() < 0.5
    assert now.found.mass.min() > 0.7
    assert now.learned.still.tolist() == pytest.approx([1 / (1 + 4 / 41)] * 2)  # no two of 40 images of the map repeat


def test_a_robot_that_stands_stays_where_its_images_are_rarer_than_its_steps():
    poses, now = stood_still(torch.full((1, 3), math.nan, dtype=torch.float64), count=60, every=2)
    assert (poses[59] - 18.0).abs().max() < 3.0
    assert now.found.mass.min() > 0.5


def test_images_that_repeat_in_the_map_hold_fewer_particles():
    model, _, _ = world()
    dull = model.map.descriptors.clone()
    dull[:15] = dull[0]  # as in a tunnel
    model = MODELS[0].fit(DescriptorMap.of(model.map.poses, dull), PoseKernel("rbf", (4.0, 4.0), 0.6, 1.0, 0.02))
    rules = Adaptation(model, Likelihood(), odds=20.0)
    assert rules._still == pytest.approx(1 / (1 + 4 * 16 / 41), abs=0.02)


def test_the_first_images_of_an_unknown_drive_must_be_recognised_better_than_by_chance():
    model, _, _ = world()
    begun = Adaptation(model, Likelihood()).start(3)
    recognised = torch.tensor([0.45, 0.45, math.nan], dtype=torch.float64)
    few = replace(begun, recognised=recognised, change=replace(begun.change, images=torch.tensor([4.0, 5.0, 4.0])))
    assert few.unrecognised.tolist() == [True, False, False]
    assert replace(few, recognised=recognised - 0.1).unrecognised.tolist() == [True, True, False]
