"""A laser in the particle filter: it finds itself in a room without symmetry, and again after a kidnap."""

import math

import numpy as np
import pytest
import torch
from worlds.casters import Boxes

from sextant.evaluation.pose_posterior import pose_errors
from sextant.evaluation.protocols import OFFICE_LOCALIZATION
from sextant.evaluation.success import global_localization, recovery_after, within
from sextant.geometry.planar import se2_between, se2_compose
from sextant.localization.estimate import estimate
from sextant.localization.initialisation import UniformStart
from sextant.localization.laser import BeamModel, LikelihoodField
from sextant.localization.map_prior import MapPrior
from sextant.localization.motion import ExponentialMotion
from sextant.localization.particle_filter import ParticleFilter
from sextant.localization.recovery import BayesRestart
from sextant.localization.resampling import SystematicResampling
from sextant.worlds.laser import LaserScanner, scan
from sextant.worlds.occupancy import occupancy_from_scans

SCANNER = LaserScanner(beams=181, max_range_m=12.0, range_sigma_m=0.02, dropout=0.01)
ROOM = Boxes((0.0, 0.0, 9.0, 5.0), (5.0, 3.0, 9.0, 5.0), (2.0, 3.5, 2.5, 5.0), (6.5, 0.0, 6.9, 1.0))
KIDNAP, FRAMES, RUNS = 32, 60, 8


def lawn():
    """Poses all over the room's free part, in eight directions: the mapping drive."""
    x, y = np.meshgrid(np.arange(0.5, 9, 0.5), np.arange(0.5, 5, 0.5))
    spots = np.column_stack([x.ravel(), y.ravel()])
    spots = spots[
        ~((spots[:, 0] > 4.7) & (spots[:, 1] > 2.7)) & ~((abs(spots[:, 0] - 2.25) < 0.5) & (spots[:, 1] > 3.2))
    ]
    turns = np.arange(-np.pi, np.pi, np.pi / 4)
    return np.column_stack([np.repeat(spots, len(turns), axis=0), np.tile(turns, len(spots))])


def circling(centre, frames, start):
    """A drive around a circle of 0.9 m."""
    angle = start + np.arange(frames) * 0.1 / 0.9
    return np.column_stack([centre + 0.9 * np.column_stack([np.cos(angle), np.sin(angle)]), angle + np.pi / 2])


@pytest.mark.parametrize("make", [LikelihoodField, pytest.param(BeamModel, marks=pytest.mark.slow)])
def test_it_localizes_from_anywhere_and_recovers_from_a_kidnap(make):
    rng, generator = np.random.default_rng(0), torch.Generator().manual_seed(0)
    mapped = lawn()
    grid = occupancy_from_scans(SCANNER, mapped, scan(SCANNER, ROOM, mapped, rng), 0.05)
    truth = np.stack(
        [
            np.concatenate(
                [circling((1.4, 1.5), KIDNAP, 0.5 * run), circling((4.2, 1.5), FRAMES - KIDNAP, 1.0 + 0.5 * run)]
            )
            for run in range(RUNS)
        ]
    )  # (runs, frames, 3)
    model = make(grid, SCANNER, tempering=0.1)
    map_poses = torch.from_numpy(mapped)
    mcl = ParticleFilter(
        ExponentialMotion((0.03, 0.03, 0.03)),
        SystematicResampling(),
        BayesRestart(hazard=1e-3, share=0.1),
        MapPrior(map_poses, 0.2, math.pi / 12),
    )
    state = mcl.start(UniformStart(), RUNS, 600, generator)
    poses = torch.from_numpy(truth)
    motions = se2_between(poses[:, :-1], poses[:, 1:])
    motions[:, KIDNAP - 1] = motions[:, 0]  # the odometry does not notice
    assert torch.allclose(se2_compose(poses[:, 3], motions[:, 3])[:, :2], poses[:, 4, :2])
    found = []
    for frame in range(FRAMES):
        scans = torch.from_numpy(scan(SCANNER, ROOM, truth[:, frame], rng))
        motion = motions[:, frame - 1] if frame else None
        state, _ = mcl.step(state, motion, model.observe(scans, map_poses), None, generator)
        found.append(estimate(state.belief, 0.5).pose.numpy())
    errors = pose_errors(truth, np.stack(found, axis=1))
    inside = within(np.linalg.norm(errors[..., :2], axis=2), np.degrees(np.abs(errors[..., 2])), OFFICE_LOCALIZATION)
    # corners look alike until a run has turned: several are wrong by metres for the first ten frames or more
    once = global_localization(inside[:, :KIDNAP], OFFICE_LOCALIZATION)
    again = recovery_after(inside, np.full(RUNS, KIDNAP), OFFICE_LOCALIZATION)
    # with other seeds 6 to 8 and 7 to 8 of 8 were seen
    assert once.share.count >= RUNS - 2
    assert again.share.count >= RUNS - 2
    assert once.tracking > 0.95
