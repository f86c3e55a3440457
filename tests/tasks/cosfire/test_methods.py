"""What a class is told by, by hand."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sextant.baselines.linear_svm import LinearSVM
from sextant.chapters.cosfire.methods import (
    METHODS,
    REPRESENTATIONS,
    nearest_example,
    principal_components,
    strongest_filter,
    svm_of,
)


def test_every_method_is_told_and_looks_at_something():
    assert METHODS.keys() == REPRESENTATIONS.keys()


def test_the_strongest_filter_is_measured_by_its_own_prototype():
    maxima = torch.tensor([[0.5, 0.2, 0.3], [0.1, 0.2, 0.3]])
    own, labels = torch.tensor([1.0, 0.25, 0.4]), torch.tensor([2, 0, 2])
    found = strongest_filter(maxima, own, labels, 4)
    expected = [[0.8, -np.inf, 0.75, -np.inf], [0.8, -np.inf, 0.75, -np.inf]]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_filter_that_answers_nothing_to_its_own_prototype_breaks_nothing():
    found = strongest_filter(torch.tensor([[0.0, 0.1]]), torch.tensor([0.0, 0.2]), torch.tensor([0, 1]), 2)
    assert found.tolist() == [[0.0, 0.5]]


@given(seed=st.integers(0, 999), images=st.integers(1, 5), examples=st.integers(1, 9))
def test_the_nearest_example_by_loops(seed, images, examples):
    rng = np.random.default_rng(seed)
    shown, known = rng.normal(size=(images, 4)), rng.normal(size=(examples, 4))
    labels = rng.integers(0, 3, examples)
    found = nearest_example(*map(torch.from_numpy, (shown, known, labels)), 4).numpy()
    for image in range(images):
        for label in range(4):
            own = [k for k in range(examples) if labels[k] == label]
            cosines = [shown[image] @ known[k] / np.linalg.norm(shown[image]) / np.linalg.norm(known[k]) for k in own]
            assert found[image, label] == pytest.approx(max(cosines, default=-np.inf))


def test_many_images_are_looked_up_in_batches():
    shown = torch.randn(2100, 3, generator=torch.Generator().manual_seed(0))
    known, labels = shown[::7], torch.arange(300) % 5
    found = nearest_example(shown, known, labels, 5)
    assert (found[::7].argmax(1) == labels).all()
    torch.testing.assert_close(found[::7].amax(1), torch.ones(300))


def test_one_c_and_one_scaling_need_no_tuning_images():
    labels = torch.arange(60) % 3
    features = torch.randn(60, 6, generator=torch.Generator().manual_seed(0))
    found = svm_of((features, labels), (features[:0], labels[:0]), 3, (10.0,), ("each",), 30, 0)
    whole = LinearSVM.fit(features.double().numpy(), labels.numpy(), 3, 10.0, scaling="each")
    np.testing.assert_array_equal(found.weights, whole.weights)
    assert (found.c, found.scaling) == (10.0, "each")


def test_c_is_chosen_with_few_examples_and_the_svm_fitted_to_all():
    generator = torch.Generator().manual_seed(0)
    labels = torch.arange(120) % 3
    features = torch.randn(3, 6, generator=generator)[labels] + torch.randn(120, 6, generator=generator)
    examples, tuning = (features[:90], labels[:90]), (features[90:], labels[90:])
    found = svm_of(examples, tuning, 3, (0.01, 1.0), ("all", "each"), 30, 0)
    whole = LinearSVM.fit(examples[0].double().numpy(), examples[1].numpy(), 3, found.c, scaling=found.scaling)
    np.testing.assert_array_equal(found.weights, whole.weights)
    rows = np.random.default_rng(0).permutation(90)[:30]
    few = tuple(values.numpy()[rows] for values in (examples[0].double(), examples[1]))
    held = (tuning[0].double().numpy(), tuning[1].numpy())
    chosen = LinearSVM.choose(few, held, 3, (0.01, 1.0), scalings=("all", "each"))
    assert (found.c, found.scaling) == (chosen.c, chosen.scaling)
    every = svm_of(examples, tuning, 3, (0.01, 1.0), ("all", "each"), 90, 0)
    answers = every.scores(held[0]).argmax(1)
    assert (answers == held[1]).mean() > 0.6


@pytest.mark.parametrize("count", [1, 3, 5, 50])
def test_components_keep_what_examples_differ_in_and_all_of_them_keep_cosines(count):
    """One, some, all that six examples span, and more than there are."""
    rng = torch.Generator().manual_seed(0)
    images, known = (torch.randn(rows, 9, generator=rng, dtype=torch.float64) for rows in (4, 6))
    short, among = principal_components(images, known, count)
    assert among.shape == (6, min(count, 5))
    assert short.shape == (4, min(count, 5))
    centred = known - known.mean(0)
    values = torch.linalg.svdvals(centred)[: min(count, 5)]
    torch.testing.assert_close(among.square().sum(0), values.square())
    if count >= 5:
        torch.testing.assert_close(among @ among.T, centred @ centred.T)
