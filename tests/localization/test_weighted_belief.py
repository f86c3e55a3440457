import math

import pytest
import torch
from small_worlds import Told

from sextant.errors import UserError
from sextant.localization.belief import Belief
from sextant.localization.observation.evidence import EvidenceOfSome
from sextant.localization.weighted_belief import WeightedBelief

BELIEF = Belief.of(torch.zeros(2, 3, 3, dtype=torch.float64), torch.tensor([[0.0, -math.inf, 0.0], [0.0] * 3]).double())


def told(*values):
    row = torch.tensor(values, dtype=torch.float64)
    return lambda poses: row


def test_what_is_not_a_number_explains_nothing():
    evidence = Told([told(-1.0, -1.0, math.nan), told(math.inf, -2.0, -3.0)], None)
    weighed = WeightedBelief.of(BELIEF, evidence, None)
    assert weighed.log_likelihood.tolist() == [[-1.0, -1.0, -math.inf], [-math.inf, -2.0, -3.0]]
    assert weighed.log_weights[0].tolist() == [-math.log(2) - 1, -math.inf, -math.inf]
    assert weighed.particles.tolist() == [2, 3]
    assert float(weighed.log_evidence[0]) == -math.log(2) - 1


def test_runs_that_see_nothing_are_not_weighed():
    evidence = Told([told(math.nan, math.nan, math.nan), told(-1.0, -1.0, -1.0)], None)
    weighed = WeightedBelief.of(BELIEF, evidence, torch.tensor([False, True]))
    assert torch.equal(weighed.log_weights[0], BELIEF.log_weights[0])
    assert abs(float(weighed.log_evidence[0])) < 1e-12
    assert abs(float(weighed.log_evidence[1]) + 1) < 1e-12


class OfFirst(Told):
    def log_likelihood(self, poses):
        return super().log_likelihood(poses[:1])


def test_evidence_of_another_number_of_runs_is_refused():
    one = OfFirst([told(-1.0, -1.0, -1.0)], None)
    with pytest.raises(UserError, match=r"must have \(2, 3\)"):
        WeightedBelief.of(BELIEF, one, None)
    with pytest.raises(UserError, match="poses of 2 runs for 3 runs"):
        EvidenceOfSome(one, torch.tensor([False, False, True])).log_likelihood(BELIEF.poses)
