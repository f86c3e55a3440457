import pytest

from sextant.cli.photo_calibration.options import CalibrationOptions, options_from
from sextant.errors import UserError


def test_options_are_read(tmp_path):
    assert options_from({}) == CalibrationOptions()
    given = {"undistort": "all", "camera": "one", "focal_prior": "812.5", "input": "x"}
    assert options_from(given) == CalibrationOptions("all", "one", 812.5)


@pytest.mark.parametrize(
    "given",
    [{"undistort": "some"}, {"camera": "two"}, *({"focal_prior": v} for v in ("0", "-3", "nan", "inf", "wide"))],
)
def test_wrong_options_are_told(given):
    (key, value), *_ = given.items()
    with pytest.raises(UserError, match=f"{key}={value} must be"):
        options_from(given)
