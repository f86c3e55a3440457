import math

import numpy as np
import pytest
from scipy import stats

from sextant.chapters.localization.along_drives import FEWEST, WIDEST, region_scale


@pytest.mark.parametrize("dof", [1, 3])
@pytest.mark.parametrize("narrow", [1.5, 4.0])
def test_regions_of_a_belief_that_is_too_narrow_hold_the_truth_elsewhere(dof, narrow):
    """Learnt of some errors, judged by others; of any distribution."""
    rng = np.random.default_rng(dof)
    first, others = (narrow**2 * dof * rng.standard_t(4, (4000, dof)) ** 2 / 2 for _ in range(2))
    scale = region_scale(first.sum(1), dof)
    assert scale > narrow / 2
    assert (others.sum(1) / scale**2 <= stats.chi2.ppf(0.95, dof)).mean() == pytest.approx(0.95, abs=0.015)


def test_regions_are_never_narrowed_nor_widened_without_end():
    wide = np.random.default_rng(0).chisquare(3, 1000) / 4
    assert region_scale(wide, 3) == 1.0
    assert region_scale(np.append(wide, np.full(100, math.inf)), 3) == WIDEST  # sure of something wrong, too often
    assert region_scale(np.append(wide, np.full(40, math.inf)), 3) == 1.0
    assert region_scale(np.full(FEWEST - 1, 100.0), 3) == 1.0
    assert region_scale(np.full(FEWEST, 100.0), 3) > 1.0
