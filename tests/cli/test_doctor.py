"""``sextant doctor calibration``."""

import re
from functools import partial

import pytest

from sextant.chapters.calibration.metrics import doctor as calibration_doctor


@pytest.fixture
def doctor(run_verb):
    return partial(run_verb, "doctor")


@pytest.mark.slow
def test_calibration_is_sound_here(doctor):
    status, said = doctor("calibration")
    assert status == 0, said
    assert "FAIL" not in said
    for text in ("round trip", "Newton against bisection", "OpenCV", "closed form", "cross-talk", "2.55", "+0.108"):
        assert text in said
    assert re.search(r"\d+ passed, 0 failed, in ", said)
    assert "against the render" in said


def test_a_failure_is_shown_and_is_the_exit_status(doctor, monkeypatch):
    bad = calibration_doctor.Finding("lens", "a figure [of 3]", 0.5, 1e-9)
    monkeypatch.setattr(calibration_doctor, "examine", lambda crop: ([bad], []))
    status, said = doctor("calibration")
    assert status == 1
    assert "FAIL" in said
    assert "a figure [of 3]" in said
    assert "0 passed, 1 failed" in said


@pytest.mark.parametrize("arguments", [["calibraton"], ["calibration", "more"]])
def test_mistakes_are_told_with_the_usage(doctor, arguments):
    status, said = doctor(*arguments)
    assert status == 2
    assert "sextant doctor [calibration]" in said


def test_help(doctor):
    status, said = doctor("--help")
    assert status == 0
    assert "sextant doctor [calibration]" in said
