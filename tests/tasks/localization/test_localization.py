"""A localizer from end to end in a small office: trained, calibrated, resumed, tested again."""

import json

import numpy as np
import pytest
import torch
import yaml
from support import evaluated
from tiny_office import office_cache, office_config

from sextant.chapters.localization.localizer import Localizer
from sextant.chapters.localization.task import Localization
from sextant.chapters.places.descriptors import BaselineDescriber
from sextant.cli import evaluate
from sextant.config import validate
from sextant.errors import UserError
from sextant.kit.trained import model_from_checkpoint, read_trained
from sextant.lifecycle.execute import execute
from sextant.localization.map_support import MapSupport
from sextant.localization.observation.evidence import Evidence
from sextant.localization.observers import Camera
from sextant.runs.checkpoint import KEY, load_checkpoint
from sextant.runs.directory import RunDirectory

#: four values of the loss, one an epoch of ten steps
USUAL = ("trainer.max_epochs=4",)


@pytest.fixture(scope="session")
def cache():
    return office_cache()


@pytest.fixture(scope="module")
def run(cache, outputs):
    """The directory of a run with some overrides."""

    def finish(*overrides, into=None):
        return RunDirectory(execute(office_config(cache, into or outputs, *overrides)).directory)

    return finish


@pytest.fixture(scope="module")
def usual(run):
    return run(*USUAL)


def logged(directory, name):
    lines = map(json.loads, directory.history.read_text().splitlines())
    return [line["metrics"][name] for line in lines if name in line["metrics"]]


def arrays(directory):
    with np.load(directory.arrays, allow_pickle=False) as found:
        return dict(found)


def metrics(directory):
    """Of a run, without what tells of the machine."""
    of_the_machine = ("ms_per_step", "memory", "us_per_particle", "ms_per_image", "fit_map_s")
    found = directory.results()["metrics"]
    return {key: value for key, value in found.items() if not any(name in key for name in of_the_machine)}


# -- training and calibration ------------------------------------------------------------------------------------------


def test_the_likelihood_of_the_map_rises(usual):
    losses = logged(usual, "train/loss")
    assert len(losses) == 4
    assert (np.diff(losses) < 0).all()
    assert losses[-1] < losses[0] - 0.02  # nats of each number of each descriptor


def test_the_posterior_over_the_map_is_calibrated(usual):
    found = usual.results()["metrics"]
    assert 0 < found["val/tempering"] < 1
    assert found["val/appearance_variance"] > 0  # night is no noise of the map's
    assert found["val/place_nll"] < found["val/place_nll_uniform"]
    assert usual.results()["outcome"] == "finished"


@pytest.mark.slow
def test_no_other_tempering_is_better(usual, run):
    noise = usual.results()["metrics"]["val/appearance_variance"]
    best = usual.results()["metrics"]["val/place_nll"]
    tempering = usual.results()["metrics"]["val/tempering"]
    for factor in (0.7, 1.4):
        given = min(1.0, factor * tempering)
        fixed = (f"likelihood.tempering={given}", f"likelihood.appearance_noise={noise}")
        other = run(*USUAL, *fixed, "task.starts=1", "task.horizon=12")
        assert other.results()["metrics"]["val/tempering"] == pytest.approx(given, rel=1e-6)
        assert other.results()["metrics"]["val/place_nll"] > best


def test_what_a_run_keeps(usual):
    found, results = arrays(usual), usual.results()
    trials = {"summer_noon", "night_clear"}
    assert {key.removeprefix("success/") for key in found if key.startswith("success/")} == trials
    for trial in trials:
        assert found[f"position_error/{trial}"].shape == (3, 30)
        converged, success = found[f"converged/{trial}"], found[f"success/{trial}"]
        np.testing.assert_array_equal(converged >= 0, success == 1)
        for at, errors, turned in zip(
            converged, found[f"position_error/{trial}"], found[f"heading_error_deg/{trial}"], strict=True
        ):
            if at >= 0:
                assert (errors[at : at + 10] <= 0.5).all()
                assert (turned[at : at + 10] <= 10).all()
    assert results["metrics"]["test/success"] == pytest.approx(np.mean([found[f"success/{t}"] for t in trials]))
    assert results["degenerate_steps"] == dict.fromkeys(sorted(trials, reverse=True), 0)
    assert results["parameters"] == 5
    regions = {key.rpartition("/")[2]: value for key, value in results["metrics"].items() if "coverage_95" in key}
    assert {row["drive"]: row["in region %"] for row in results["table"]} == {
        trial: f"{100 * regions[trial]:.0f}" if (found[f"converged/{trial}"] >= 0).any() else "–" for trial in trials
    }


@pytest.mark.slow
def test_by_day_it_knows_where_it_is(run):
    found = run(*USUAL, "task.starts=24")  # of three, two are found by some seeds and one by others
    assert arrays(found)["success/summer_noon"].mean() >= 0.85


@pytest.mark.slow
def test_whitened_errors(run):
    found = run("likelihood.whitening=true", "task.starts=1", "task.horizon=12")
    assert found.results()["metrics"]["val/place_nll"] < found.results()["metrics"]["val/place_nll_uniform"]
    whitener = load_checkpoint(found.last_checkpoint)["state_dict"]["whitener"]
    torch.testing.assert_close(whitener, whitener.mT)
    assert (torch.linalg.eigvalsh(whitener) > 0).all()
    assert not torch.allclose(whitener, torch.eye(16, dtype=torch.float64))


@pytest.mark.slow
def test_vecchias_likelihood_trains_a_like_kernel(run, usual):
    found = run("task.objective=vecchia", "task.images=120", "task.starts=1", "task.horizon=12", *USUAL)
    losses = logged(found, "train/loss")
    assert losses[-1] < losses[0]
    for name in ("length_x", "heading_length_rad", "signal_variance"):
        joint, other = (logged(directory, f"train/{name}")[-1] for directory in (usual, found))
        assert 0.5 < other / joint < 2


@pytest.mark.slow
def test_a_sharper_kernel_is_trained_alike_and_used_sharpened(run, usual):
    sharper = "kernel.sharper={length: 0.5, noise: 0.001, heading: 1.5}"
    found = run(sharper, "task.starts=1", "task.horizon=12", "task.save_map=true", *USUAL)
    assert logged(found, "train/length_x") == logged(usual, "train/length_x")
    localizer = Localizer.load(found.path / "map")
    kernel = localizer.model.kernel
    assert kernel.length[0] == pytest.approx(logged(usual, "train/length_x")[-1] / 2)
    assert kernel.heading_length == pytest.approx(logged(usual, "train/heading_length_rad")[-1] * 1.5)
    assert kernel.noise_variance <= 0.001 * kernel.signal_variance
    learnt = kernel.sharpened(2.0, 1.0)  # how far an image stands for poses beside it, it was learnt to
    assert localizer.filter.support.reach == pytest.approx(MapSupport.of(localizer.filter.prior.poses, learnt).reach)
    assert found.results()["metrics"]["val/tempering"] != usual.results()["metrics"]["val/tempering"]


@pytest.mark.slow
def test_a_laser_needs_no_training(run):
    directory = run("observation=laser_field", "task.starts=2", "trainer.max_epochs=1")
    found = directory.results()
    assert found["parameters"] == 0
    kept = load_checkpoint(directory.last_checkpoint)["state_dict"]  # it can be tested again
    assert float(kept["fitted"]) == pytest.approx(found["metrics"]["val/tempering"], rel=1e-6)
    assert 0 < found["metrics"]["val/tempering"] <= 1
    assert found["metrics"]["val/place_nll"] < found["metrics"]["val/place_nll_uniform"]


@pytest.mark.slow
def test_poses_between_the_best_images_are_judged_as_those_of_a_filter(run):
    directory = run(
        "filter=interpolated", "filter.best=3", "task.starts=2", "trainer.max_epochs=1", "task.save_map=true"
    )
    errors, found = arrays(directory)["position_error/summer_noon"], directory.results()["metrics"]
    assert np.nanmedian(errors) < 2  # of an office of many metres
    told = next(value for key, value in found.items() if "error_of_all_frames_median" in key and "summer_noon" in key)
    assert told == pytest.approx(np.nanmedian(errors), rel=1e-3)
    assert next(value for key, value in found.items() if key.startswith("test/particles_")) == 3
    assert not (directory.path / "map").exists()


@pytest.mark.slow
def test_a_filter_that_adapts_is_trained_tested_and_kept_as_one(run, outputs):
    quick = ("task.starts=2", "trainer.max_epochs=1", "task.save_map=true", "filter.regions=null")
    likelihood = ("likelihood.tempering=0.125", "likelihood.appearance_noise=0.0")
    adapting = (*quick, *likelihood, "filter.adapts=true", "filter.odds=20.0")
    directory, plain = run(*adapting), run(*quick, *likelihood)
    assert directory.path != plain.path
    assert not np.array_equal(
        arrays(directory)["position_error/night_clear"], arrays(plain)["position_error/night_clear"]
    )
    for found, adapts in ((directory, True), (plain, False)):
        localizer = Localizer.load(found.path / "map")
        assert (localizer.adapts, localizer.odds) == (adapts, 20.0 if adapts else None)
        assert f"adapts={adapts}" in repr(localizer)
    command = [f"run={directory.path}", f"paths.outputs={outputs}", "task.starts=1", "task.replay=false"]
    evaluate.main(command)


# -- identity, resuming, evaluation ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_interrupted_and_resumed_equals_uninterrupted_bit_for_bit(usual, run, tmp_path, monkeypatch):
    training_step, seen = Localization.training_step, []

    def interrupted_in_the_third_epoch(self, rows, batch_idx):
        seen.append(self.global_step)
        if len(seen) == 24:
            raise KeyboardInterrupt
        return training_step(self, rows, batch_idx)

    monkeypatch.setattr(Localization, "training_step", interrupted_in_the_third_epoch)
    with pytest.raises(KeyboardInterrupt):
        run(*USUAL, into=tmp_path)
    resumed = run(*USUAL, into=tmp_path)
    assert seen[24:] == list(range(20, 40))
    assert metrics(resumed) == metrics(usual)
    one, other = (load_checkpoint(directory.last_checkpoint)["state_dict"] for directory in (usual, resumed))
    assert one.keys() == other.keys()
    assert all(torch.equal(one[name], other[name]) for name in one)
    assert logged(resumed, "train/loss") == logged(usual, "train/loss")
    for name, values in arrays(usual).items():
        np.testing.assert_array_equal(values, arrays(resumed)[name])


@pytest.mark.slow
def test_wider_regions_change_nothing_but_what_is_told_of_them(usual, run):
    """Success, errors and the evidence are as without."""
    narrow = run(*USUAL, "filter.regions=null")
    assert narrow.path != usual.path
    for name, values in arrays(usual).items():
        np.testing.assert_array_equal(values, arrays(narrow)[name])
    scale = logged(usual, "val/region_scale")[-1]
    assert scale > 1
    assert logged(narrow, "val/region_scale")[-1] == 1
    told, before = metrics(usual), metrics(narrow)
    for key in (key for key in told if "nees_median" in key):
        assert told[key] == pytest.approx(before[key] / scale**2)
    for key in (key for key in told if "coverage_95" in key):
        assert told[key] >= before[key]


@pytest.mark.slow
def test_a_test_without_wider_regions_tells_what_the_filter_believes(usual, cache, tmp_path):
    tested = evaluated(tmp_path, usual, "filter.regions=null", f"paths.cache={cache}")
    scale = logged(usual, "val/region_scale")[-1]
    for key, value in metrics(tested).items():
        if "nees_median" in key:
            assert metrics(usual)[key] == pytest.approx(value / scale**2)


def test_a_localizer_of_before_tells_what_its_filter_believes(usual):
    content = read_trained(usual.last_checkpoint)
    del content["state_dict"]["region_scale"]
    config = validate(yaml.safe_load(usual.config.read_text()))
    module = model_from_checkpoint(config, content, usual.last_checkpoint)
    assert float(module.region_scale) == 1.0


def test_the_same_run_is_not_done_twice(usual, run):
    assert run(*USUAL).path == usual.path


def test_the_checkpoint_knows_its_task(usual):
    content = load_checkpoint(usual.last_checkpoint)[KEY]
    assert content["task"] == "localization"
    assert content["spec"] == {"dimension": 16, "unit": "m"}


@pytest.mark.slow
def test_descriptors_are_worked_out_once(usual, cache, run, monkeypatch):
    before = {path: path.stat().st_mtime_ns for path in cache.glob("descriptors-*.npy")}
    assert before

    def forbidden(self, images):
        raise AssertionError("it was described again")

    monkeypatch.setattr(BaselineDescriber, "describe", forbidden)
    run("seed=7", "task.starts=1", "task.horizon=12")
    assert {path: path.stat().st_mtime_ns for path in before} == before
    with pytest.raises(AssertionError, match="described again"):
        run("descriptor.dimensions=8", "task.starts=1", "task.horizon=12")


@pytest.mark.slow
def test_a_thinned_map_has_the_descriptors_of_the_images_that_are_left(run, usual, monkeypatch):
    seen = []
    fit_map = Localization.fit_map

    def noted(self, data, drive, as_it_is=None):
        model = fit_map(self, data, drive, as_it_is)
        seen.append((data.descriptors(drive), as_it_is, model.map))
        return model

    monkeypatch.setattr(Localization, "fit_map", noted)
    for fault, count in (("fault=thinned_map", 0.5), ("fault=noisy_map_poses", 1.0)):
        keep = ["fault.keep=0.5"] if "thinned" in fault else []
        run(fault, *keep, "task.starts=1", "task.horizon=12")
        described, as_it_is, found = next(each for each in reversed(seen) if each[1] is not None)
        assert len(found) == pytest.approx(count * len(described), abs=1)
        np.testing.assert_array_equal(found.descriptors.numpy(), described[as_it_is.frames])
        np.testing.assert_array_equal(found.poses.numpy(), as_it_is.poses)


def test_a_fault_without_what_it_needs(run):
    with pytest.raises(UserError, match=r"fault\.condition=spring_rain: the dataset has no map under spring_rain"):
        run("fault=wrong_season_map", "fault.condition=spring_rain", "task.starts=1", "task.horizon=12")


@pytest.mark.slow
def test_training_goes_on_from_the_weights_of_another_run(usual, run):
    found = run(
        "trainer.max_epochs=1", f"init_from={usual.path}", "task.starts=1", "task.horizon=12", "filter.regions=null"
    )
    assert logged(found, "train/loss")[0] < logged(usual, "train/loss")[2]
    assert logged(found, "val/region_scale")[-1] == 1.0


@pytest.mark.slow
def test_a_trained_localizer_is_tested_with_another_fault(usual, cache, outputs):
    tested = evaluated(outputs, usual, "fault=kidnap", "fault.distance=2.0", f"paths.cache={cache}")
    found, told = arrays(tested), metrics(tested)
    assert {key for key in found if key.startswith("success/")} == {
        "success/summer_noon, kidnap",
        "success/night_clear, kidnap",
    }
    assert any(key.startswith("test/recovered_") for key in told)
    for name in ("ate_aligned_rmse", "rpe_rmse", "rpe_deg_rmse"):
        values = [value for key, value in told.items() if key.startswith(f"test/{name}_")]
        assert values
        assert all(0 < value < 5 for value in values)  # without the metres and degrees of the kidnapping
    assert told["test/success"] == pytest.approx(np.mean([found[key] for key in found if key.startswith("success/")]))


class Nothing(Evidence):
    """An image that no pose explains."""

    def __init__(self, runs, images):
        self.runs, self.images = runs, images

    def log_likelihood(self, poses):
        return torch.full(poses.shape[:2], -torch.inf, dtype=torch.float64)

    def over_map(self):
        return torch.full((self.runs, self.images), -torch.inf, dtype=torch.float64)


@pytest.mark.slow
@pytest.mark.parametrize("recovery", ["none", "uniform", "augmented", "topk_naive", "bayes_restart"])
def test_steps_in_which_no_particle_explains_the_image_are_counted_and_got_over(run, recovery, monkeypatch):
    observe, steps = Camera.observe, []

    def blinded(self, frames):
        steps.append(frames)
        blind = 5 <= (len(steps) - 1) % 30 < 9
        return Nothing(len(frames), len(self.model.map)) if blind else observe(self, frames)

    monkeypatch.setattr(Camera, "observe", blinded)
    found = run(f"recovery={recovery}", "seed=11", "trainer.max_epochs=1")
    assert found.results()["degenerate_steps"] == {"summer_noon": 4 * 3, "night_clear": 4 * 3}  # of three runs each
    for name, values in arrays(found).items():
        if name.startswith(("position_error", "mass", "nll")):
            assert np.isfinite(values).all(), name


@pytest.mark.slow
def test_a_run_tells_what_its_sensor_is_worth_and_costs(usual, run):
    found = usual.results()["metrics"]
    by_drive = [found[f"test/descriptor_nll/{name}"] for name in ("summer_noon", "night_clear")]
    assert found["test/descriptor_nll"] == pytest.approx(np.mean(by_drive))
    assert by_drive[0] < by_drive[1]  # the map was seen at noon
    for name in ("us_per_particle", "ms_per_image", "fit_map_s", "model_mb"):
        assert found[f"test/{name}"] > 0
    blind = run(*USUAL, "likelihood=univariate", "task.starts=1", "task.horizon=12")
    assert "test/descriptor_nll" not in blind.results()["metrics"]
    assert blind.results()["metrics"]["test/us_per_particle"] > 0
