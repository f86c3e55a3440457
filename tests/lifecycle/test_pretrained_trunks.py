"""Runs with a pretrained trunk: trained, tested, and read again where its first weights are gone."""

import numpy as np
import pytest
import torch
from calibration_toy import panorama, panorama_files, panorama_words

import sextant
from sextant.models import efficientnet_lite0_classifier, trunk
from sextant.runs.directory import RunDirectory

TRUNK = ["backbone=efficientnet_lite0", "backbone.stages=2", "tracking=none", "trainer=fast", "trainer.progress=false"]


def without_wheel(monkeypatch, tmp_path):
    monkeypatch.setenv("SEXTANT_CACHE", str(tmp_path / "empty"))
    monkeypatch.setattr(trunk, "find_spec", lambda name: None)


def state(directory):
    return torch.load(RunDirectory(directory).last_checkpoint, weights_only=True)["state_dict"]


@pytest.fixture(scope="module")
def digits(outputs):
    """A classifier of digit scans, its first stages frozen or slowed."""
    small = ["trainer.batch_size=64", "corruption=none", "optimizer=adam", "optimizer.lr=0.01"]
    slowed = ["backbone.frozen_stages=1", "backbone.rate_decay=0.5"]
    return sextant.run([*TRUNK, *small, *slowed, f"paths.outputs={outputs}"])


def test_a_classifier_of_digits_starts_from_imagenet_and_keeps_what_is_frozen(digits):
    assert digits.metrics["test/accuracy/clean"] > 0.3  # a tenth is chance
    published, found = efficientnet_lite0_classifier().state_dict(), state(digits.directory)
    none = torch.empty(0)
    same = {name for name, value in published.items() if torch.equal(found.get(f"network.{name}", none), value)}
    assert {name for name in published if name.startswith(("stem.", "stages.0."))} <= same
    assert "stages.1.0.layers.0.0.weight" not in same


@pytest.mark.slow
def test_a_trained_classifier_needs_its_first_weights_no_more(digits, outputs, monkeypatch, tmp_path):
    without_wheel(monkeypatch, tmp_path)
    classifier = sextant.ImageClassifier.load(digits.directory)
    assert classifier.classify(np.zeros((28, 28), np.uint8)).label
    again = sextant.evaluate(digits.directory, [f"paths.outputs={outputs}", "tracking=none"])
    assert again.metrics["test/accuracy/clean"] == digits.metrics["test/accuracy/clean"]


@pytest.mark.slow
def test_a_camera_is_calibrated_by_a_pretrained_trunk(tmp_path, monkeypatch):
    data = panorama_words(panorama_files(tmp_path / "panoramas"), tmp_path)
    outcome = sextant.run([*data, *TRUNK, "backbone.grid=[3,4]", "trainer.batch_size=32"])
    assert np.isfinite(outcome.metrics["test/bearing_deg/clean"])
    without_wheel(monkeypatch, tmp_path)
    photo = sextant.PhotoCalibrator.load(outcome.directory).calibrate(panorama(np.random.default_rng(1))[:48, :64])
    assert photo.focal_px > 0
