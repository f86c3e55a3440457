"""Filters that are trained on: the start is the machine's, the loss falls, what was configured stays."""

import math

import numpy as np
import pytest
import torch
from torch import nn

from sextant.baselines.linear_svm import LinearSVM
from sextant.chapters.cosfire.fine_tuning import FineTuning, LinearLayer, fine_tune, log_maxima, tune_layer
from sextant.chapters.cosfire.representations import filter_maxima
from sextant.errors import LossNotFiniteError
from sextant.layers.cosfire import Cosfire, GaborBank, VectorBank, VectorKeypoints


def bars(count=42, seed=0):
    """Upright, level and slanted bars in noise; labels 0, 2 and 3 of four."""
    generator = torch.Generator().manual_seed(seed)
    images = 0.25 * torch.rand(count, 1, 16, 16, generator=generator)
    labels = torch.arange(count) % 3
    for image, label in zip(images, labels.tolist(), strict=True):
        at = int(torch.randint(5, 11, (1,), generator=generator))
        if label == 0:
            image[0, :, at] += 0.7
        elif label == 1:
            image[0, at] += 0.7
        else:
            image[0] += 0.7 * torch.eye(16)
    return (255 * images).byte(), torch.tensor([0, 2, 3])[labels]


def of_image():
    return Cosfire(GaborBank(), floor=0.01)


class OfFeatures:
    """Filters on directions of the vectors of one convolution."""

    def __init__(self):
        torch.manual_seed(0)
        self.network = nn.Conv2d(1, 6, 5).requires_grad_(False)

    def __call__(self):
        return Cosfire(VectorBank(self.network, 6), VectorKeypoints(reach=4.0, most=6), floor=0.01)


def started(make):
    images, labels = bars()
    filters = make()
    for row in (0, 1, 2):
        filters.configure(images[row].float() / 255)
    maxima = filter_maxima(filters, images)
    machine = LinearSVM.fit(log_maxima(maxima).double().numpy(), labels.numpy(), 4, 0.1)
    layer = LinearLayer(torch.from_numpy(machine.weights), torch.from_numpy(machine.bias))
    return filters, layer, maxima, images, labels


def tuned(make, epochs=6, lr=0.02, seed=0):
    filters, layer, maxima, images, labels = started(make)
    generator = torch.Generator().manual_seed(seed)
    return fine_tune(filters, make, layer, maxima, images, labels, FineTuning(epochs, lr), generator)


def loss(filters, layer, images, labels):
    scores = layer.scores(log_maxima(filter_maxima(filters, images)))
    return float(nn.functional.cross_entropy(scores, labels))


@pytest.mark.parametrize("make", [of_image, OfFeatures()])
def test_the_loss_falls_and_what_was_configured_stays(make):
    filters, layer, maxima, images, labels = started(make)
    before = {name: value.clone() for name, value in filters.state_dict().items()}
    generator = torch.Generator().manual_seed(0)
    found = fine_tune(filters, make, layer, maxima, images, labels, FineTuning(6, 0.02), generator)
    assert all(torch.equal(before[name], value) for name, value in filters.state_dict().items())
    assert list(filters.parameters(recurse=False)) == []
    assert loss(found.filters, found.layer, images, labels) < 0.9 * loss(filters, layer, images, labels)
    assert found.losses[-1] < found.losses[0]
    assert len(found.losses) == 6
    assert not torch.equal(found.filters.weights.double(), filters.weights)
    if isinstance(make, OfFeatures):
        assert not torch.allclose(found.filters.channels.double(), filters.channels)


def test_no_step_leaves_the_scores_of_the_machine():
    filters, layer, maxima, images, labels = started(of_image)
    generator = torch.Generator().manual_seed(0)
    found = fine_tune(filters, of_image, layer, maxima, images, labels, FineTuning(1, 0.0), generator)
    scores = layer.scores(log_maxima(maxima))
    again = found.layer.scores(log_maxima(filter_maxima(found.filters, images)))
    np.testing.assert_allclose(again, scores, rtol=1e-3, atol=1e-3)
    expected = nn.functional.cross_entropy(scores[:, [0, 2, 3]], torch.tensor([0, -1, 1, 2])[labels])
    assert found.losses == [pytest.approx(float(expected), rel=1e-3)]


def test_the_control_is_what_filters_that_cannot_learn_give():
    filters, layer, maxima, images, labels = started(of_image)

    def fixed():
        made = Cosfire(GaborBank(), floor=0.01)
        made.train_parts = lambda: made
        return made

    settings, order = FineTuning(3, 0.02), lambda: torch.Generator().manual_seed(0)
    expected = fine_tune(filters, fixed, layer, maxima, images, labels, settings, order())
    found = tune_layer(layer, maxima, labels, settings, order())
    np.testing.assert_allclose(found.losses, expected.losses, rtol=1e-4)
    torch.testing.assert_close(found.layer.weights, expected.layer.weights, rtol=1e-3, atol=1e-4)
    assert found.losses[2] < found.losses[0]
    assert found.layer.bias[1] == -math.inf


def test_a_class_without_an_example_never_wins():
    found = tuned(of_image)
    assert found.layer.bias[1] == -math.inf
    assert (found.layer.weights[1] == 0).all()
    assert found.layer.bias[[0, 2, 3]].isfinite().all()


def test_the_same_seed_gives_the_same_bits_and_another_other_ones():
    one, same, other = tuned(of_image, 2), tuned(of_image, 2), tuned(of_image, 2, seed=1)
    assert one.losses == same.losses
    assert torch.equal(one.layer.weights, same.layer.weights)
    assert torch.equal(one.filters.weights, same.filters.weights)
    assert not torch.equal(one.layer.weights, other.layer.weights)


def test_the_state_fits_filters_that_do_not_train():
    found, plain = tuned(of_image, 2), of_image()
    plain.load_state_dict(found.filters.state_dict())
    images, _ = bars(4, seed=1)
    torch.testing.assert_close(filter_maxima(plain, images), filter_maxima(found.filters, images))


def test_a_loss_that_is_no_number_is_told():
    filters, layer, maxima, images, labels = started(of_image)
    broken = LinearLayer(layer.weights * math.nan, layer.bias)
    with pytest.raises(LossNotFiniteError, match=r"fine-tuning became nan at step 0\nLower task.fine_tune.lr"):
        fine_tune(filters, of_image, broken, maxima, images, labels, FineTuning(1), torch.Generator())


def test_the_step_of_a_divergence_is_counted_over_all_epochs(monkeypatch):
    filters, layer, maxima, images, labels = started(of_image)
    losses = iter([1.0, 1.0, 1.0, math.inf])  # two steps an epoch
    monkeypatch.setattr(
        "sextant.chapters.cosfire.fine_tuning.F.cross_entropy", lambda scores, _: scores.sum() * 0 + next(losses)
    )
    with pytest.raises(LossNotFiniteError, match="became inf at step 3"):
        fine_tune(filters, of_image, layer, maxima, images, labels, FineTuning(2), torch.Generator())
