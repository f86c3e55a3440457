import math

import numpy as np
import pytest
from baselines.calibration.drawings import cameras, picture

from sextant.baselines.calibration import (
    CameraBelief,
    CombinedGeometry,
    FocalBelief,
    LineEvidence,
    PhotoPrior,
    joint_estimate,
)
from sextant.baselines.calibration.terms import StraightChains, student
from sextant.errors import UserError

CAMERAS = list(cameras(8))
SIGMA = np.array([0.05, 0.03, 0.08, 0.06])  # of tilt, roll, vfov and k1_hat
NOTHING = LineEvidence(np.zeros((0, 16, 2)), np.zeros((0, 2, 2)), 0.0, 4 / 3)


def truth_of(camera):
    """Tilt, roll, vertical field of view and k1_hat."""
    tilt, roll, _, focal, k1 = camera
    return np.array([tilt, roll, 2 * math.atan(0.5 / focal), k1 / focal**2])


def belief(values, sigma=SIGMA, **options):
    tilt, roll, vfov, k1_hat = values
    return CameraBelief(tilt, roll, 0.5 / math.tan(vfov / 2), k1_hat, tuple(sigma), **options)


def network_of(camera, seed):
    return truth_of(camera) + SIGMA * np.random.default_rng(seed).standard_normal(4)


def found(lines, *beliefs):
    tilt, roll, log_focal, k1_hat = joint_estimate(lines, beliefs).vector
    return np.array([tilt, roll, 2 * math.atan(0.5 / math.exp(log_focal)), k1_hat])


@pytest.fixture(scope="module")
def seen():
    """Lines of noisy pictures."""
    return [LineEvidence.of(picture(*c, seed=i, noise=8)) for i, c in enumerate(CAMERAS)]


def mean_errors(answers):
    return np.mean([np.abs(a - truth_of(c)) for a, c in zip(answers, CAMERAS, strict=True)], axis=0)


@pytest.mark.slow
def test_lines_sharpen_what_a_network_says(seen):
    said = [network_of(c, i) for i, c in enumerate(CAMERAS)]
    joint = [found(lines, belief(network)) for lines, network in zip(seen, said, strict=True)]
    assert (mean_errors(joint) < 0.6 * mean_errors(said)).all()


@pytest.mark.slow
def test_a_network_that_is_sure_and_wrong_spoils_nothing(seen):
    """Six of its standard errors away: a product of normals would end between the two."""
    wrong = SIGMA * [6, 0, -6, 0]
    prior = PhotoPrior(4 / 3)
    alone = mean_errors([found(lines, prior) for lines in seen])
    joint = [found(s, prior, belief(truth_of(c) + wrong)) for s, c in zip(seen, CAMERAS, strict=True)]
    assert (mean_errors(joint)[:3] < np.maximum(1.2 * alone, np.radians(2))[:3]).all()


@pytest.mark.slow
def test_few_lines_leave_the_camera_to_the_network():
    geometry, network, joint = [], [], []
    for i, camera in enumerate(cameras(16, seed=9)):
        image = picture(*camera, seed=i, noise=12, clutter=60, samples=2)
        lines = CombinedGeometry().calibrate(image).camera
        tilt, roll, focal, k1 = map(float, lines)
        truth, said = truth_of(camera), network_of(camera, i)
        geometry.append(np.abs([tilt, roll, 2 * math.atan(0.5 / focal), k1 / focal**2] - truth))
        network.append(np.abs(said - truth))
        joint.append(np.abs(found(LineEvidence.of(image), belief(said)) - truth))
    joint, geometry, network = (np.mean(values, axis=0) for values in (joint, geometry, network))
    assert (joint < 1.05 * np.minimum(network, geometry)).all()


def test_without_lines_a_single_belief_comes_back():
    said = np.array([0.2, -0.1, 1.0, -0.2])
    estimate = joint_estimate(NOTHING, [belief(said)])
    assert found(NOTHING, belief(said)) == pytest.approx(said, abs=1e-5)
    # of Student's loss with three degrees of freedom: the curvature at 0 is 4/3 of the normal's
    assert np.sqrt(estimate.covariance[[0, 1, 3], [0, 1, 3]]) == pytest.approx(SIGMA[[0, 1, 3]] * math.sqrt(3 / 4))
    assert (estimate.support.tolist(), estimate.rivals, estimate.ends) == ([0, 0, 0], 0, ())


def test_beliefs_that_agree_are_averaged_and_of_a_part_of_the_photo_in_its_heights():
    one, other = belief([0.1, 0.0, 0.9, 0.0], nu=math.inf), belief([0.2, 0.0, 0.9, 0.0], SIGMA / 2, nu=math.inf)
    assert found(NOTHING, one, other)[0] == pytest.approx(0.1 + 0.1 * 4 / 5, abs=1e-5)
    half = CameraBelief(0.0, 0.0, 1.6, -0.4, tuple(SIGMA), zoom=0.5)
    log_focal, k1_hat = joint_estimate(NOTHING, [half]).vector[2:]
    assert (math.exp(log_focal), k1_hat) == pytest.approx((0.8, -1.6), rel=1e-4)


def test_the_prior_of_distortion_is_as_sure_at_its_peak_as_its_curvature_says():
    """A mixture of normals, of which the narrow one has four fifths of the density at the peak."""
    prior, step = PhotoPrior(4 / 3), 1e-4
    estimate = joint_estimate(NOTHING, [prior])
    at = np.zeros((3, 5))
    at[:, 3], at[:, 4] = estimate.vector[2], estimate.vector[3] + step * np.array([-1, 0, 1])
    below, here, above = prior.cost(at)
    assert math.sqrt(estimate.covariance[3, 3]) == pytest.approx(step / math.sqrt(below - 2 * here + above), rel=0.02)
    assert 0.02 < math.sqrt(estimate.covariance[3, 3]) < 0.03  # 0.04 of the longer side


def test_of_many_chains_those_that_take_part_share_the_weight():
    chains = np.random.default_rng(0).normal(size=(400, 16, 2))
    assert StraightChains(chains).share == pytest.approx(30 / 40)
    assert StraightChains(chains[:7]).share == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tilt", "roll", "heading", "focal", "seed"),
    [(25, 0.05, 0.5, 0.9, 0), (30, -0.1, 0.3, 1.1, 1), (-25, 0.02, 0.7, 0.8, 2)],
)
def test_with_a_known_lens_the_frames_of_the_picture_are_followed(tilt, roll, heading, focal, seed):
    image = picture(math.radians(tilt), roll, heading, focal, width=400, height=300, noise=6, seed=seed)
    lens = CameraBelief(0.0, 0.0, focal, 0.0, (math.inf, math.inf, 1e-4, 1e-4), nu=math.inf)
    answer = found(LineEvidence.of(image), PhotoPrior(4 / 3), lens)
    assert answer[:2] == pytest.approx([math.radians(tilt), roll], abs=math.radians(1))


def test_a_long_lens_that_is_known_is_kept_and_an_end_of_the_search_is_told():
    long = joint_estimate(NOTHING, [PhotoPrior(1.5), FocalBelief(12.5, 0.02)])
    assert math.exp(long.vector[2]) == pytest.approx(12.5, rel=0.02)
    assert long.ends == ()
    beyond = joint_estimate(NOTHING, [PhotoPrior(1.5), FocalBelief(200.0, 0.02)])
    assert beyond.ends == ("focal length",)


def test_two_cameras_that_suit_as_well_widen_the_covariance():
    """What two sure witnesses say differs by far more than either allows: one is right, and nobody knows which."""
    sure = SIGMA / 20
    torn = joint_estimate(NOTHING, [belief([0.3, 0, 0.9, 0], sure), belief([-0.3, 0, 0.9, 0], sure)])
    assert torn.rivals == pytest.approx(0.5, abs=0.05)
    assert 0.3 < math.sqrt(torn.covariance[0, 0]) < 0.6


def test_a_focal_length_that_is_known_settles_it():
    known = FocalBelief(1.3, 0.02)
    estimate = joint_estimate(NOTHING, [PhotoPrior(4 / 3), known])
    assert math.exp(estimate.vector[2]) == pytest.approx(1.3, rel=0.01)


def test_the_same_evidence_gives_the_same_camera(seen):
    first, second = (joint_estimate(seen[0], [PhotoPrior(4 / 3)], seed=4) for _ in range(2))
    assert np.array_equal(first.vector, second.vector)
    assert np.array_equal(first.covariance, second.covariance)


def test_the_derivatives_of_losses_are_those_of_their_values():
    squares, step = np.array([[0.0, 0.3, 2.0, 50.0]]), 1e-6
    chains = StraightChains(np.random.default_rng(0).normal(size=(2, 16, 2)))
    for loss in (lambda s: student(s, 3.0), lambda s: student(s, math.inf)):
        value, slope, bend = loss(squares)
        ahead = loss(squares + step)
        assert slope == pytest.approx((ahead[0] - value) / step, rel=1e-4)
        assert bend == pytest.approx((ahead[1] - slope) / step, rel=1e-4, abs=1e-6)
    prior, five = PhotoPrior(1.0), np.array([[0.0, 0.3, 2.0, 50.0, 1.3]])
    for term, at in ((chains, squares), (prior, five), (prior, five / 50)):
        value, slope, _ = term.loss(at)
        for i in range(at.shape[1]):
            ahead = term.loss(at + step * np.eye(at.shape[1])[i])
            assert slope[0, i] == pytest.approx((ahead[0] - value).sum() / step, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("sigma", [(0.0, 0.1, 0.1, 0.1), (0.1, 0.1, float("nan"), 0.1)])
def test_beliefs_need_uncertainties(sigma):
    with pytest.raises(UserError, match="sigma > 0"):
        CameraBelief(0.0, 0.0, 1.0, 0.0, sigma)
    with pytest.raises(ValueError, match="at least one belief"):
        joint_estimate(NOTHING, [])
