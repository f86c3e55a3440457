"""The filter that a config of localization describes."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.recipes.localization import test_settings as settings_of

LINE = np.column_stack([np.arange(9.0), np.zeros(9), np.zeros(9)])


@pytest.mark.parametrize(
    ("overrides", "supported"), [([], True), (["filter.support=null"], False), (["observation=laser_field"], False)]
)
def test_cameras_are_asked_where_the_map_is_and_lasers_anywhere(overrides, supported):
    config = validate(to_plain(compose(["task=localization", *overrides])))
    data = SimpleNamespace(drives=SimpleNamespace(map=SimpleNamespace(poses=LINE), unit="m"))
    found = settings_of(config, data).filter(torch.from_numpy(LINE))
    assert (found.support is not None) is supported
    if found.support is not None:
        assert found.support.reach == pytest.approx(0.5)  # of a map every metre
