import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats

from sextant.evaluation.particle_counts import needed_ratio, particles_needed
from sextant.evaluation.protocols import (
    NORDLAND_LOCALIZATION,
    OFFICE_LOCALIZATION,
    TOWN_LOCALIZATION,
    LocalizationProtocol,
)
from sextant.evaluation.success import (
    NEVER,
    converged_at,
    global_localization,
    recovery_after,
    share_of,
    tracking_share,
    within,
)

TABLES = hnp.arrays(bool, st.tuples(st.integers(1, 4), st.integers(1, 20)))


def runs_of(*texts):
    """A table from rows such as ``..xxx`` where x is within."""
    return np.array([[letter == "x" for letter in text] for text in texts])


@given(TABLES, st.integers(1, 6), st.integers(0, 8), st.none() | st.integers(0, 12))
def test_convergence_is_the_first_of_enough_good_frames(inside, frames, start, horizon):
    expected = []
    for row in inside:
        last = len(row) - frames if horizon is None else min(len(row) - frames, start + horizon)
        hits = (t for t in range(start, last + 1) if all(row[t : t + frames]))
        expected.append(next(hits, NEVER))
    assert converged_at(inside, frames, start=start, horizon=horizon).tolist() == expected


@given(TABLES, st.integers(1, 5))
def test_more_frames_running_never_converge_sooner(inside, frames):
    less, more = (converged_at(inside, n).astype(float) for n in (frames, frames + 1))
    less[less == NEVER], more[more == NEVER] = np.inf, np.inf
    assert (less <= more).all()


def test_each_run_may_start_at_a_frame_of_its_own():
    inside = runs_of("xxx..xxx", "xxx..xxx", "xxx.xx.x")
    assert converged_at(inside, 3, start=np.array([0, 1, 1])).tolist() == [0, 5, NEVER]


def test_within_needs_position_and_heading_and_counts_the_limit():
    position, heading = np.array([[0.5, 0.51, 0.1, np.nan, 0.1]]), np.array([[10.0, 1.0, 10.1, 1.0, np.nan]])
    assert within(position, heading, OFFICE_LOCALIZATION).tolist() == [[True, False, False, False, False]]
    assert within(np.array([[2.0, 3.0]]), None, NORDLAND_LOCALIZATION).tolist() == [[True, False]]
    with pytest.raises(ValueError, match="heading error for each"):
        within(position, None, TOWN_LOCALIZATION)
    with pytest.raises(ValueError, match="negative"):
        within(-position, heading, TOWN_LOCALIZATION)


def test_the_constants_are_those_stated_before_any_result():
    assert (OFFICE_LOCALIZATION.position, OFFICE_LOCALIZATION.heading_deg, OFFICE_LOCALIZATION.frames) == (0.5, 10, 10)
    assert (TOWN_LOCALIZATION.position, TOWN_LOCALIZATION.heading_deg, TOWN_LOCALIZATION.frames) == (5, 20, 10)
    assert OFFICE_LOCALIZATION.name("success") == "success_0.5m_10deg_10f"
    assert NORDLAND_LOCALIZATION.name("success") == "success_2frames_10f"
    for limits in ((0.0, 10.0, 5), (1.0, -1.0, 5), (1.0, None, 0), (math.nan, None, 1)):
        with pytest.raises(ValueError, match="must be positive"):
            LocalizationProtocol(*limits)


def test_tracking_counts_from_convergence_to_the_end_of_each_drive():
    inside = runs_of("..xx.x..", "xxxx....", "........")
    shares = tracking_share(inside, np.array([2, 0, NEVER]), np.array([8, 4, 8]))
    assert shares[:2].tolist() == [0.5, 1.0]
    assert math.isnan(shares[2])


def test_a_summary_of_global_localization():
    protocol = LocalizationProtocol(1.0, None, 2)
    found = global_localization(runs_of("..xxxx", "xxxx..", ".x.x.x"), protocol)
    assert (found.share.count, found.share.runs) == (2, 3)
    assert (found.median_frames, found.p90_frames) == (1.0, 1.8)
    assert found.tracking == pytest.approx((1 + 4 / 6) / 2)
    late = global_localization(runs_of("..xxxx", "xxxx..", ".x.x.x"), protocol, horizon=1)
    assert late.share.count == 1
    nothing = global_localization(runs_of("......"), protocol)
    assert nothing.share.rate == 0
    assert math.isnan(nothing.median_frames)


def test_what_comes_after_a_drives_length_does_not_count():
    """With the frame of a kidnap for a length, a run that finds itself only then was lost before."""
    protocol = LocalizationProtocol(1.0, None, 3)
    inside = runs_of("......xxxx", "xxx.xxxxxx", "...xxxxxxx")
    kidnapped = np.array([5, 5, 5])
    before = global_localization(inside, protocol, length=kidnapped)
    assert (before.share.count, before.median_frames) == (1, 0)  # the third had two frames only
    assert before.tracking == 4 / 5
    assert recovery_after(inside, kidnapped, protocol, length=np.array([10, 7, 10])).share.count == 2


def test_recovery_counts_from_the_kidnap_and_ends_at_the_horizon():
    protocol = LocalizationProtocol(1.0, None, 2)
    inside = runs_of("xxx..xx.....", "xxx.......xx", "xx..........")
    found = recovery_after(inside, np.array([3, 3, 3]), protocol, horizon=5)
    assert (found.share.count, found.median_frames) == (1, 2.0)
    assert recovery_after(inside, np.array([3, 3, 3]), protocol, horizon=7).p90_frames == pytest.approx(6.5)
    # within at the frame before and at the first one after is no convergence before the kidnap
    assert recovery_after(runs_of("xxxx"), np.array([3]), protocol).share.count == 0


@given(st.integers(0, 40), st.integers(1, 40))
def test_the_interval_of_a_share_is_wilsons(count, runs):
    count = min(count, runs)
    found = share_of(np.arange(runs) < count)
    z, p = stats.norm.ppf(0.975), count / runs
    middle, half = p + z**2 / (2 * runs), z * math.sqrt(p * (1 - p) / runs + z**2 / (4 * runs**2))
    assert found.low == pytest.approx((middle - half) / (1 + z**2 / runs), abs=1e-9)
    assert found.high == pytest.approx((middle + half) / (1 + z**2 / runs), abs=1e-9)
    assert found.low <= found.rate <= found.high


COUNTS = np.array([25, 50, 100, 200])


def seeds(*shares, number=20):
    """Success of 20 seeds at each count, the same seeds failing first."""
    return np.array([np.arange(number) < share * number for share in shares])


def test_particles_needed_are_the_fewest_that_suffice():
    assert particles_needed(COUNTS, seeds(0.5, 0.95, 0.9, 1.0)) == 50
    assert particles_needed(COUNTS, seeds(0.5, 0.9, 0.9, 0.9)) == math.inf
    assert particles_needed(COUNTS, seeds(0.5, 0.9, 0.9, 0.9), 0.5) == 25
    for counts, table in ((COUNTS[::-1].copy(), seeds(0, 0, 0, 0)), (COUNTS[:3], seeds(0, 0, 0, 0))):
        with pytest.raises(ValueError, match="ascending counts"):
            particles_needed(counts, table)


def test_a_ratio_that_is_reached_by_both():
    ratio = needed_ratio((COUNTS, seeds(0, 0, 0.5, 1)), (COUNTS, seeds(0.2, 1, 1, 1)))
    assert (ratio.least, ratio.most, ratio.censored) == (4, 4, 0)
    assert ratio.low == ratio.high == 4  # at 200 and at 50 no seed fails, whichever are drawn


def test_a_censored_ratio_is_an_interval():
    never, soon = (COUNTS, seeds(0, 0, 0, 0)), (COUNTS, seeds(0, 1, 1, 1))
    above, below, unknown = needed_ratio(never, soon), needed_ratio(soon, never), needed_ratio(never, never)
    assert (above.least, above.most, above.low, above.high, above.censored) == (4, math.inf, 4, math.inf, 1)
    assert (below.least, below.most, below.low, below.high) == (0, 0.25, 0, 0.25)
    assert (unknown.least, unknown.most) == (0, math.inf)


def test_the_interval_holds_the_true_ratio_about_as_often_as_it_says():
    """Two methods that need 50 and 100: there success is sure; below it is a coin's."""
    rng = np.random.default_rng(5)
    counts = np.array([25, 50, 100])
    held = 0
    for _ in range(60):
        first, second = (np.vstack([rng.random((k, 12)) < 0.5, np.ones((3 - k, 12), bool)]) for k in (2, 1))
        ratio = needed_ratio((counts, first), (counts, second), resamples=300)
        held += ratio.low <= 2 <= ratio.high
    assert held >= 57


def test_pairing_uses_the_same_seeds():
    """A method against itself: with the same seeds drawn for both the ratio is 1 in every resample."""
    method = (COUNTS, seeds(0.3, 0.8, 0.95, 1))
    same = needed_ratio(method, method)
    assert (same.low, same.high) == (1, 1)
    with pytest.raises(ValueError, match="same seeds"):
        needed_ratio(method, (COUNTS, seeds(0, 0, 0, 1, number=7)))
