import pytest

from sextant.chapters.calibration.options import CalibrationOptions
from sextant.errors import UserError


def test_options_are_read(tmp_path):
    assert CalibrationOptions.of({}) == CalibrationOptions()
    given = {"undistort": "all", "camera": "one", "focal_prior": "812.5", "input": "x"}
    assert CalibrationOptions.of(given) == CalibrationOptions(undistort="all", camera="one", focal_prior=812.5)


@pytest.mark.parametrize(
    "given",
    [
        {"undistort": "some"},
        {"camera": "two"},
        {"exports": "ros,usd"},
        *({"focal_prior": v} for v in ("0", "-3", "nan", "inf", "wide")),
    ],
)
def test_wrong_options_are_told(given):
    (key, value), *_ = given.items()
    with pytest.raises(UserError, match=f"{key}={value} must be"):
        CalibrationOptions.of(given)
