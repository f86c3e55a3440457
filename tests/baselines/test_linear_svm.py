"""The linear machine against scikit-learn's, and against the same problem solved tightly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import Normalizer, StandardScaler
from sklearn.svm import LinearSVC

from sextant.baselines.linear_svm import LinearSVM


def clusters(seed, count, width, classes, apart=1.5):
    """Images about a centre for each class, in units that differ from number to number."""
    rng = np.random.default_rng(seed)
    labels = np.arange(count) % classes
    features = apart * rng.normal(size=(classes, width))[labels] + rng.normal(size=(count, width))
    return features * rng.uniform(0.1, 50, width) + rng.normal(size=width), labels


class OneScaler(StandardScaler):
    """Divides by one number, so that the mean square of lengths is one."""

    def fit(self, *arguments):
        super().fit(*arguments)
        self.scale_ = np.full_like(self.scale_, np.sqrt(self.var_.sum()))
        return self


class EachScaler(StandardScaler):
    """Divides by a number for each feature, so that the mean square of lengths is one."""

    def fit(self, *arguments):
        super().fit(*arguments)
        self.scale_ = self.scale_ * np.sqrt(len(self.scale_))
        return self


SCALERS = {"each": [EachScaler], "all": [OneScaler], "unit": [Normalizer, OneScaler]}


def plain(features, labels, c, scaling="all", **options):
    return make_pipeline(*(make() for make in SCALERS[scaling]), LinearSVC(C=c, random_state=0, **options)).fit(
        features, labels
    )


@given(
    seed=st.integers(0, 99),
    classes=st.integers(3, 5),
    c=st.sampled_from([0.1, 1.0, 10.0]),
    scaling=st.sampled_from(sorted(SCALERS)),
)
@settings(max_examples=20)
def test_scores_are_those_of_scikit_learn(seed, classes, c, scaling):
    features, labels = clusters(seed, 60, 7, classes)
    others, _ = clusters(seed, 30, 7, classes)
    machine = LinearSVM.fit(features, labels, classes, c, scaling=scaling)
    expected = plain(features, labels, c, scaling, dual=True, tol=0.01, max_iter=5000).decision_function(others)
    np.testing.assert_allclose(machine.scores(others), expected, atol=1e-6)
    assert machine.c == c


@given(seed=st.integers(0, 99), classes=st.integers(3, 4))
@settings(max_examples=10)
def test_fewer_images_than_numbers_give_the_scores_of_the_whole_problem(seed, classes):
    features, labels = clusters(seed, 18, 60, classes, apart=0.3)
    others, _ = clusters(seed + 1000, 10, 60, classes)
    machine = LinearSVM.fit(features, labels, classes, 0.1)
    tight = plain(features, labels, 0.1, dual=False, tol=1e-10, max_iter=100_000).decision_function(others)
    np.testing.assert_allclose(machine.scores(others), tight, rtol=1e-3, atol=1e-2)
    assert machine.weights.shape == (classes, 60)


def test_the_unit_of_a_number_does_not_matter():
    features, labels = clusters(0, 60, 7, 3)
    units = np.array([1e-3, 1, 1e3, 1, 1e5, 1, 1])
    one, other = (LinearSVM.fit(values, labels, 3, scaling="each") for values in (features, features * units + 5))
    np.testing.assert_allclose(one.scores(features), other.scores(features * units + 5), atol=1e-6)


def test_the_length_of_an_image_does_not_matter_at_unit_length():
    features, labels = clusters(0, 60, 7, 3)
    lengths = np.geomspace(1e-3, 1e3, 60)[:, None]
    one, other = (LinearSVM.fit(values, labels, 3, scaling="unit") for values in (features, features * lengths))
    np.testing.assert_allclose(one.scores(features), other.scores(features * lengths), atol=1e-6)
    np.testing.assert_allclose(other.scores(7 * features), one.scores(features), atol=1e-6)
    assert np.isfinite(one.scores(np.zeros((1, 7)))).all()


def test_a_number_that_never_differs_plays_no_part():
    features, labels = clusters(0, 60, 7, 3)
    wide = np.column_stack([features, np.full(60, 1e4)])
    machine = LinearSVM.fit(wide, labels, 3)
    np.testing.assert_allclose(machine.scores(wide), LinearSVM.fit(features, labels, 3).scores(features), atol=1e-5)
    assert (machine.weights[:, -1] == 0).all()


def test_two_classes_are_told_apart_by_one_machine():
    features, labels = clusters(3, 40, 4, 2)
    machine = LinearSVM.fit(features, labels, 2)
    expected = plain(features, labels, 1.0, dual=True, tol=0.01, max_iter=5000).decision_function(features)
    scores = machine.scores(features)
    np.testing.assert_allclose(scores[:, 1], expected, atol=1e-6)
    np.testing.assert_allclose(scores[:, 0], -expected, atol=1e-6)
    assert (scores.argmax(1) == (expected > 0)).all()


@pytest.mark.parametrize("present", [[0, 2], [1, 3, 4]])
def test_a_class_without_images_never_wins(present):
    features, own = clusters(5, 30, 4, len(present))
    machine = LinearSVM.fit(features, np.array(present)[own], 6)
    far = np.concatenate([features, -1e6 * features, np.full((1, 4), 1e9)])
    assert set(machine.scores(far).argmax(1).tolist()) <= set(present)
    assert (machine.scores(features).argmax(1) == np.array(present)[own]).mean() > 0.7


def test_one_class_alone_is_refused():
    with pytest.raises(ValueError, match="two classes"):
        LinearSVM.fit(np.eye(3), np.ones(3, np.int64), 2)


def test_the_price_with_most_right_answers_is_chosen_and_of_equals_the_lowest():
    train, held = clusters(1, 60, 20, 4, apart=0.4), clusters(1, 40, 20, 4, apart=0.4)
    prices = (10.0, 0.001, 0.1)
    right = {c: (LinearSVM.fit(*train, 4, c).scores(held[0]).argmax(1) == held[1]).mean() for c in prices}
    best = min(c for c in prices if right[c] == max(right.values()))
    assert LinearSVM.choose(train, held, 4, prices).c == best
    easy = clusters(1, 60, 4, 3, apart=50)
    assert LinearSVM.choose(easy, easy, 3, (10.0, 1.0, 3.0)).c == 1.0


def test_without_validation_images_there_is_no_choice():
    features, labels = clusters(1, 30, 4, 3)
    with pytest.raises(ValueError, match="a single C and a single scaling"):
        LinearSVM.choose((features, labels), (features[:0], labels[:0]), 3, (0.3, 3.0))


@pytest.mark.filterwarnings("error")
def test_classes_known_by_one_image_each_are_told_apart_without_a_warning():
    features = np.eye(30)
    machine = LinearSVM.fit(features, np.arange(30), 30)
    np.testing.assert_array_equal(machine.scores(features).argmax(1), np.arange(30))
