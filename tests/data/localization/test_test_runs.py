"""Many runs along one drive: where they start, what they are told, and what a fault does to each."""

from dataclasses import replace

import numpy as np
import pytest
from data.localization.drives import circle
from hypothesis import given
from hypothesis import strategies as st

from sextant.chapters.localization.data.drive import between
from sextant.chapters.localization.data.faults import Blackout, Fault, Kidnap, NoFault
from sextant.chapters.localization.testing import lay_out_runs

DRIVE = circle(60)


@given(st.integers(1, 9), st.integers(1, 80), st.integers(1, 4))
def test_runs_are_stretches_of_the_drive(starts, horizon, every):
    runs = lay_out_runs(DRIVE, NoFault(), starts, horizon, every, seed=0)
    begins = runs.frames[0]
    assert len(begins) == starts
    assert begins[0] == 0
    assert (np.diff(begins) >= 0).all()
    assert begins[-1] == (max(0, 60 - horizon * every) if starts > 1 else 0)
    for run, length in enumerate(runs.lengths):
        assert length == min(horizon, -(-(60 - begins[run]) // every))
        frames = runs.frames[:length, run]
        np.testing.assert_array_equal(frames, begins[run] + every * np.arange(length))
        np.testing.assert_array_equal(runs.poses[:length, run], DRIVE.poses[frames])
        moved = between(DRIVE.poses[frames[:-1]], DRIVE.poses[frames[1:]])
        np.testing.assert_allclose(runs.motion[1:length, run], moved, atol=1e-12)  # composed over what is left out
    assert (runs.kidnapped_at == -1).all()
    assert len(runs.frames) == runs.lengths.max()


class CutShort(Fault):
    """A run ends early, at a frame drawn for it."""

    def drive(self, drive, rng, whole=None):
        return drive.select(0, int(rng.integers(3, len(drive) + 1)))


@pytest.mark.parametrize("seed", range(3))
def test_a_run_that_has_ended_stands_still_unseen(seed):
    runs = lay_out_runs(DRIVE, CutShort(), 8, 30, 1, seed)
    assert len(set(runs.lengths.tolist())) > 2
    assert len(runs.frames) == runs.lengths.max()
    for run, length in enumerate(runs.lengths):
        assert runs.inside[:, run].tolist() == [step < length for step in range(len(runs.frames))]
        assert runs.seen[:length, run].all()
        assert not runs.seen[length:, run].any()
        assert not runs.motion[length:, run].any()
        assert (runs.frames[length:, run] == runs.frames[length - 1, run]).all()
        assert (runs.poses[length:, run] == runs.poses[length - 1, run]).all()


def test_each_run_is_kidnapped_by_itself():
    runs = lay_out_runs(DRIVE, Kidnap(0.5, 10.0), 4, 20, 1, seed=0)
    assert runs.kidnapped_at.tolist() == [10] * 4
    apart = np.linalg.norm(runs.poses[10, :, :2] - runs.poses[9, :, :2], axis=1)
    step = np.linalg.norm(runs.motion[10, :, :2], axis=1)
    assert (apart > 7).all()
    assert (step < 3).all()  # the wheels tell an ordinary step
    assert len({int(frame) for frame in runs.frames[10] - runs.frames[9]}) > 1
    np.testing.assert_array_equal(runs.poses, DRIVE.poses[runs.frames])


def test_a_seed_tells_the_faults_and_nothing_else():
    one, again, other = (lay_out_runs(DRIVE, Kidnap(0.5, 10.0), 6, 20, 1, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one.frames, again.frames)
    np.testing.assert_array_equal(one.frames[:10], other.frames[:10])
    assert (one.frames[10:] != other.frames[10:]).any()


def test_what_may_not_be_looked_at_is_told():
    runs = lay_out_runs(DRIVE, Blackout(0.5, 4), 2, 20, 1, seed=0)
    assert runs.seen.sum(axis=0).tolist() == [16, 16]


def test_odometry_that_is_missing_is_nan():
    runs = lay_out_runs(replace(DRIVE, motion=None), NoFault(), 2, 10, 1, seed=0)
    assert np.isnan(runs.motion).all()
