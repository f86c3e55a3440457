import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sextant.evaluation.flips import (
    BENCHMARK_PERTURBATIONS,
    flip_probability,
    is_noise,
    mean_flip_probability,
)

sequences = st.tuples(st.integers(1, 4), st.integers(4, 9)).flatmap(
    lambda shape: arrays(np.int64, shape, elements=st.integers(0, 2))
)

#: the four that the authors kept for validation
OTHERS = ("speckle_noise", "gaussian_blur", "spatter", "shear")


def one_by_one(predictions, against_first, step):
    """The definition, frame by frame."""
    shares = []
    for frames in predictions:
        flips = []
        for phase in range(step):
            before = frames[phase]
            for frame in frames[phase::step][1:]:
                flips.append(before != frame)
                if not against_first:
                    before = frame
        shares.append(np.mean(flips))
    return np.mean(shares)


@given(sequences, st.integers(1, 3))
def test_flips_are_those_of_the_definition(predictions, step):
    assert flip_probability(predictions, against_first=False, step=step) == pytest.approx(
        one_by_one(predictions, False, step)
    )
    assert flip_probability(predictions, against_first=True) == pytest.approx(one_by_one(predictions, True, 1))


def test_a_single_deviating_frame_flips_twice_or_deviates_once():
    predictions = np.array([[3, 3, 5, 3, 3]])
    assert flip_probability(predictions, against_first=False) == 0.5
    assert flip_probability(predictions, against_first=True) == 0.25


@given(sequences, st.permutations([0, 1, 2]))
def test_names_of_classes_do_not_matter(predictions, names):
    renamed = np.array(names)[predictions]
    for against_first in (True, False):
        assert flip_probability(renamed, against_first=against_first) == flip_probability(
            predictions, against_first=against_first
        )


def test_noise_is_compared_with_the_first_frame():
    every = (*BENCHMARK_PERTURBATIONS, *OTHERS)
    assert [name for name in every if is_noise(name)] == ["gaussian_noise", "shot_noise", "speckle_noise"]
    assert (len(BENCHMARK_PERTURBATIONS), len(set(every))) == (10, 14)


def test_the_mean_is_over_the_ten_perturbations_alone():
    values = {**dict.fromkeys(BENCHMARK_PERTURBATIONS, 0.1), **dict.fromkeys(OTHERS, 0.9)}
    assert mean_flip_probability(values) == pytest.approx(0.1)
    assert mean_flip_probability(values, ("tilt", "shear")) == pytest.approx(0.5)
    del values["tilt"]
    with pytest.raises(ValueError, match="no flip probability for tilt"):
        mean_flip_probability(values)


@pytest.mark.parametrize(("shape", "step"), [((0, 5), 1), ((2, 1), 1), ((2, 3), 3), ((2, 3), 0)])
def test_sequences_without_two_frames_to_compare_are_refused(shape, step):
    with pytest.raises(ValueError, match="need sequences of more than"):
        flip_probability(np.zeros(shape, int), against_first=False, step=step)
