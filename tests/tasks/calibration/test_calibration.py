import functools
from dataclasses import replace

import numpy as np
import pytest
import pytorch_lightning as pl
import torch
from calibration_toy import ToyPanoramas, distribution

from sextant.chapters.calibration.data.batches import Crops
from sextant.chapters.calibration.data.datamodule import CalibrationData
from sextant.chapters.calibration.network import CalibrationPrediction, CalibrationSpec, CameraNetwork, reported
from sextant.chapters.calibration.report import _looks, _over_crops, arrays, compare, figures, metrics, table
from sextant.chapters.calibration.task import Calibration
from sextant.corruptions import CorruptionSuite
from sextant.geometry import CameraParameters, Parameterization, ParameterSpace
from sextant.losses import BearingLoss
from sextant.models import CalibrationNet, StridedCNN


def data(**changes):
    counts = {"train": 64, "val": 8, "test": 4}
    settings = {"size": (48, 64), "crops_per_panorama": counts, "batch_size": 32, "eval_batch_size": 48, "seed": 0}
    return CalibrationData(ToyPanoramas(), distribution(), None, **settings | changes)


def module(crops):
    torch.manual_seed(0)
    parameterization = Parameterization()
    space = ParameterSpace.covering(parameterization, crops.distribution_sample())
    spec = CalibrationSpec(
        48, 64, (4 / 3,), tuple(space.low.tolist()), tuple(space.high.tolist()), 48, 8, (0.0, 0.0, 0.8, -0.1),
        (0.1, 0.2, 0.2, 0.1),
    )  # fmt: skip
    network = CalibrationNet(StridedCNN(6, (48, 64), 64, widths=(16, 24, 32, 32)), 64)
    loss = BearingLoss(spec.space(parameterization))
    adam = functools.partial(torch.optim.AdamW, lr=2e-3)
    return Calibration(network, spec, parameterization, loss, CorruptionSuite({}, 0), optimizer=adam)


def trainer(epochs, folder):
    return pl.Trainer(
        max_epochs=epochs, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False, num_sanity_val_steps=0, default_root_dir=folder,
    )  # fmt: skip


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    crops = data()
    calibration = module(crops)
    run = trainer(8, tmp_path_factory.mktemp("run"))
    run.fit(calibration, crops)
    validation = dict(run.validate(calibration, crops, verbose=False)[0])
    run.test(calibration, crops, verbose=False)
    return calibration, crops, validation


@pytest.mark.slow
def test_it_knows_what_its_pictures_look_like_and_a_run_of_before_says_nothing(trained):
    calibration, crops, _ = trained
    of_before = {name: value for name, value in calibration.state_dict().items() if not name.startswith("looks")}
    old = module(crops)
    old.load_state_dict(of_before)
    new = module(crops)
    new.load_state_dict(calibration.state_dict())
    new.spec = old.spec = replace(calibration.spec, per_panorama=1)  # of six panoramas 95 % cannot be told
    noise = torch.randint(0, 256, (4, 3, 48, 64), dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
    usual, aspect = crops.split("test")[[0, 1, 2, 3]].images, torch.full((4,), 4 / 3)
    assert (new.predict(noise, aspect).strangeness > 1.5).all()
    assert (new.predict(usual, aspect).strangeness < 1.5).all()
    for images in (noise, usual):
        assert (old.predict(images, aspect).strangeness == 0).all()


def test_a_run_that_goes_on_with_other_panoramas_has_intervals_of_its_own(trained):
    calibration, crops, _ = trained
    spec = replace(calibration.spec, validation_crops=24)
    other = CameraNetwork(module(crops).network, spec, calibration.parameterization)
    own = {name: value for name, value in calibration.state_dict().items() if not name.startswith("loss.")}
    other.load_state_dict(own)
    assert other.scores.isinf().all()
    assert other.scores.shape == (24, 4)
    for found, expected in zip(other.network.parameters(), calibration.network.parameters(), strict=True):
        assert torch.equal(found, expected)


def test_it_learns_what_the_pictures_show(trained):
    calibration, _, validation = trained
    assert calibration.converged(validation)
    assert validation["val/bearing_deg"] < 0.6 * validation["val/bearing_deg_constant"]


def test_the_scores_of_the_intervals_are_those_of_the_validation_crops(trained):
    calibration, crops, _ = trained
    batch = crops.split("val")[list(range(48))]
    camera, scale = calibration.eval()(batch.images_in_unit_range(), batch.aspect)
    scores = (reported(camera) - reported(batch.cameras)).abs() / scale
    torch.testing.assert_close(calibration.scores, scores.detach(), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("few", [1, 8])
def test_a_validation_of_a_few_crops_keeps_their_scores_and_knows_no_more(few):
    calibration = module(data())
    for count in (48, few):  # as debug=one_batch may
        scores, looks = torch.rand(count, 4), torch.rand(count, 16)
        calibration.keep_validation(scores, looks, torch.arange(count) // 4)
        assert torch.equal(calibration.scores[:count], scores)
        assert calibration.looks_scores[:count].isfinite().all() == (count > 1)
    assert calibration.scores[few:].isinf().all()
    assert calibration.looks_scores[few:].isinf().all()
    noise = torch.randint(0, 256, (2, 3, 48, 64), dtype=torch.uint8)
    prediction = calibration.eval().predict(noise, torch.full((2,), 4 / 3))
    assert (prediction.strangeness == 0).all()
    assert prediction.quantile(0.5).isinf().all()


def test_intervals_grow_with_their_level(trained):
    calibration, crops, _ = trained
    batch = crops.split("test")[[0, 1]]
    prediction = calibration.predict(batch.images, batch.aspect)
    quantiles = torch.stack([prediction.quantile(level) for level in (0.5, 0.68, 0.8)])
    assert (quantiles.diff(dim=0) >= 0).all()
    assert prediction.scale.shape == (2, 4)


def test_too_few_scores_give_endless_intervals():
    prediction = CalibrationPrediction(CameraParameters(*torch.zeros(4, 1)), torch.ones(1, 4), torch.rand(8, 4), 1)
    assert prediction.quantile(0.95).isinf().all()
    assert prediction.quantile(0.5).isfinite().all()


def test_the_same_crops_come_again_and_other_epochs_have_others():
    crops = data()
    crops.setup("fit")
    first, again = (crops.split("train")[[5, 70]] for _ in range(2))
    assert torch.equal(first.images, again.images)
    assert not torch.equal(first.images, crops.split("train")[[5 + 384, 70 + 384]].images)
    assert torch.equal(first.panoramas, torch.tensor([5, 4]))


def test_clipping_the_expected_errors_leaves_the_network_alone():
    crops = data()
    calibration = module(crops)
    for parameter in calibration.parameters():
        parameter.grad = torch.full_like(parameter, 1e-6)
    for parameter in calibration.network.scales.parameters():
        parameter.grad = torch.full_like(parameter, 1e3)
    calibration.configure_gradient_clipping(None)
    assert all((p.grad == 1e-6).all() for p in calibration.network.backbone.parameters())
    norm = torch.cat([p.grad.flatten() for p in calibration.network.scales.parameters()]).norm()
    assert norm == pytest.approx(1, rel=1e-3)


@pytest.mark.slow
def test_the_report_has_every_method_and_its_pictures(trained):
    calibration, crops, _ = trained
    report = compare(calibration, crops, geometric=True, progress=lambda *_: None)
    assert {"constant", "prior", "vanishing points", "plumb lines", "network", "network + lines"} <= set(report.errors)
    rows = table(report, calibration.result.panoramas)
    assert rows[0]["method"] == "constant"
    numbers = metrics(calibration, report)
    assert numbers["test/bearing_deg/network"] < numbers["test/bearing_deg/constant"]
    assert 0 <= numbers["test/coverage_68/tilt"] <= 1
    kept = arrays(calibration, report)
    assert kept["tilt_deg/network"].shape == (24,)
    assert all(array.dtype != object for array in kept.values())
    assert {name for name, _ in figures(calibration, crops, report)} >= {"crops", "error_by_parameter", "coverage"}


def test_without_geometric_methods_the_report_is_of_labels_and_the_network(trained):
    calibration, crops, _ = trained
    report = compare(calibration, crops, geometric=False, progress=lambda *_: None)
    assert list(report.errors) == ["constant", "prior", "network"]
    assert np.isfinite(report.errors["network"]["bearing_deg"]).all()


@pytest.mark.parametrize(("height", "same"), [(48, True), (256, False)])
def test_geometric_methods_see_the_networks_pixels_at_its_height(height, same):
    crops = data(geometric_height=height)
    crops.setup("test")
    seen, larger = crops.split("test")[[3, 5]], crops.larger("test")[[3, 5]]
    assert larger.images.shape[-2:] == (height, height * 64 // 48)
    assert (larger.images.shape == seen.images.shape and torch.equal(larger.images, seen.images)) == same
    assert all(torch.equal(a, b) for a, b in zip(larger.cameras, seen.cameras, strict=True))


@pytest.mark.parametrize(("aspect", "width"), [("4:3", 64), ("2:1", 96), ("1:1", 48), ("3:4", 36)])
def test_geometric_methods_see_pictures_that_are_not_squashed(aspect, width):
    crops = data(geometric_height=48)
    crops.distribution = crops.test_distribution = replace(distribution(), aspect={aspect: 1})
    crops.setup("test")
    seen = np.stack(list(_over_crops(crops, "test", 3, lambda image: image, lambda *_: None)))
    split = crops.split("test")
    as_wide = Crops(split.panoramas, split.distribution, width, 48, split.seed)[[0, 1, 2]].images.permute(0, 2, 3, 1)
    assert seen.shape == as_wide.shape
    off = abs(seen.astype(float) - as_wide.numpy()).mean()
    assert off < 6
    assert (off == 0) == (width == 64)


@pytest.mark.slow
def test_two_processes_see_the_lines_that_one_sees(trained):
    crops = trained[1]
    alone = _looks(crops, "test", 24, lambda *_: None)
    crops.workers = 1
    try:
        told = []
        again = _looks(crops, "test", 24, lambda *done: told.append(done))
        assert all((again[kind] == values).all() for kind, values in alone.items())
    finally:
        crops.workers = 0
    assert told[-1] == (24, 24)
