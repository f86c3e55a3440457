"""The verdict on one photo, by the fitted probabilities that its camera is right and that it is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from baselines.calibration.drawings import cameras, picture
from cli.photo_calibration.fakes import Fake

from sextant.baselines.calibration import FocalBelief, GravityBelief
from sextant.chapters.calibration import confidence as module
from sextant.chapters.calibration.confidence import beside_probabilities, confidence
from sextant.chapters.calibration.error_model import COVARIATES, ErrorModel
from sextant.chapters.calibration.inference import find_cameras
from sextant.chapters.calibration.jointly import by_method, jointly
from sextant.chapters.calibration.verdict_probabilities import (
    RIGHT,
    WRONG,
    Verdicts,
    evidence_on_errors,
    fitted_verdicts,
)


@pytest.fixture(scope="module")
def alone():
    """The network's finding on a picture with lines in three directions."""
    image = picture(*list(cameras(8, k1=(-0.01, 0.0)))[1][:4], 0.0, width=400, height=300, noise=6)
    model = Fake(tilt=0.0, roll=0.0, scale=(0.1, 0.06, 0.15, 0.05))
    (found,) = find_cameras(model, [("a", image)], look_at_lines=True)
    return found


@pytest.fixture(scope="module")
def joint(alone):
    return by_method(alone, "joint")


def verdicts(monkeypatch, sigmas):
    """Take errors as normal, with these standard errors, whatever the evidence."""
    models = [ErrorModel(np.log(each), 0.0, (0.0,) * len(COVARIATES), 1e6, 1e-9) for each in sigmas]
    monkeypatch.setattr(module, "fitted_verdicts", lambda: Verdicts(tuple(models), 0.79))


def test_the_shipped_numbers_are_read_and_a_camera_is_likelier_not_wrong_than_right(joint):
    shipped = fitted_verdicts()
    assert 0.5 <= shipped.good < 1
    right, possible = shipped.of(joint, RIGHT), shipped.of(joint, WRONG)
    assert ((right > 0) & (right < possible) & (possible < 1)).all()


@pytest.mark.parametrize(
    ("sigmas", "verdict", "says"),
    [
        ((1e-3, 1e-3, 1e-3), "good", ()),
        ((1e-3, 1e-3, 0.1), "weak", ("focal length: within 10 % with a probability of 66%",)),
        ((0.3, 1e-3, 0.1), "not trustworthy", ("tilt: within 6° with a probability of 27%",)),
    ],
)
def test_a_verdict_says_what_is_likely(joint, monkeypatch, sigmas, verdict, says):
    verdicts(monkeypatch, sigmas)
    said, reasons, _ = confidence(joint, Fake())
    assert said == verdict
    assert tuple(reason for reason in reasons if "probability of" in reason) == says


def test_what_the_model_accounts_for_is_told_but_limits_nothing(joint, monkeypatch):
    verdicts(monkeypatch, (1e-3, 1e-3, 1e-3))
    doubted = joint.doubted(1, "few lines", modelled=True)
    assert confidence(doubted, Fake())[:2] == ("good", ("few lines",))
    cropped = doubted.doubted(1, "cropped")
    assert confidence(cropped, Fake())[:2] == ("weak", ("few lines", "cropped"))
    assert beside_probabilities(cropped, Fake())[0] == 1
    bent = replace(joint, half={level: half * [1, 1, 1, 1e3] for level, half in joint.half.items()})
    assert confidence(bent, Fake())[0] == "not trustworthy"


def test_only_one_photo_by_itself_is_modelled(alone, joint):
    assert evidence_on_errors(joint)[1].shape == (3, len(COVARIATES))
    others = [
        by_method(alone, "lines"),
        jointly(alone, [FocalBelief(1.0, 0.05)]),
        jointly(replace(alone, gravity=GravityBelief((0.0, 1.0, 0.0), 0.02))),
        jointly(replace(alone, of_others=True)),
        alone,
    ]
    for finding in others:
        assert finding.joint is None
        with pytest.raises(ValueError, match="no joint camera of one photo by itself"):
            evidence_on_errors(finding)
