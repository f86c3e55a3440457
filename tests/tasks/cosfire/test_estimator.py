"""The estimator by itself: fitted to images, asked for scores, kept in a state dict."""

import pytest
import torch

from sextant.chapters.cosfire.comparison import Comparison
from sextant.chapters.cosfire.estimator import CosfireEstimator
from sextant.chapters.cosfire.filter_prototypes import NoFilterError, PrototypeSettings
from sextant.chapters.cosfire.fine_tuning import FineTuning
from sextant.chapters.cosfire.seen_images import SeenImages
from sextant.chapters.cosfire.task import CosfireRecognition
from sextant.layers.cosfire import ConcentricCircles, Cosfire, GaborBank

LABELS = torch.arange(16) % 2


def images(seed):
    """A cross of bars (class 0) or a bar alone (1), moved a little, in noise."""
    generator = torch.Generator().manual_seed(seed)
    shown = torch.randint(0, 40, (16, 1, 32, 32), generator=generator)
    for k in range(16):
        x, y = torch.randint(13, 19, (2,), generator=generator).tolist()
        shown[k, 0, :, x - 1 : x + 2] = 255
        if k % 2 == 0:
            shown[k, 0, y - 1 : y + 2] = 255
    return shown.byte()


def made(least_parts=2, **comparison):
    chosen = {"methods": ("cosfire_svm", "strongest_filter"), "c_values": (1.0,), "scalings": ("all",), **comparison}
    return CosfireEstimator(
        lambda features: Cosfire(GaborBank((6.0,), 8), ConcentricCircles((0.0, 4.0, 8.0)), t1=0.1),
        ("cross", "bar", "circle"),
        PrototypeSettings(per_class=2, at="centre", least_parts=least_parts),
        Comparison(**chosen),
        image_shape=(1, 32, 32),
    )


@pytest.fixture(scope="module")
def fitted():
    estimator = made(fine_tuning=FineTuning(epochs=1))
    estimator.fit(images(0), LABELS)
    return estimator


def test_it_tells_images_that_it_was_not_fitted_to_apart(fitted):
    found = fitted.scores(images(1))
    assert list(found) == ["cosfire_svm", "strongest_filter", "cosfire_tuned", "layer_tuned"]
    for method in ("cosfire_svm", "cosfire_tuned", "layer_tuned"):
        assert (found[method].argmax(1) == LABELS).all(), method
    assert all((scores[:, 2] == -torch.inf).all() for scores in found.values())  # no example of a circle
    assert torch.equal(fitted.first_scores(images(1)), found["cosfire_svm"])


def test_another_with_its_state_gives_the_same_scores(fitted):
    other = made(fine_tuning=FineTuning(epochs=1))
    other.load_state_dict(fitted.state_dict())
    ours, theirs = fitted.scores(images(2)), other.scores(images(2))
    assert all(torch.equal(scores, theirs[method]) for method, scores in ours.items())
    assert other.facts() == fitted.facts()
    assert torch.equal(other.configured_from().points, fitted.configured_from().points)


def test_the_module_of_training_has_the_same_state(fitted):
    module = CosfireRecognition(fitted)
    ours, theirs = fitted.state_dict(), module.state_dict()
    assert list(ours) == list(theirs)
    module.load_state_dict({name: torch.ones_like(value) for name, value in theirs.items()})
    assert all((value == 1).all() for value in module.estimator.state_dict().values())
    module.load_state_dict(ours)


def test_fitting_again_forgets_the_first_examples():
    twice, once = made(), made()
    twice.fit(images(3), LABELS)
    for estimator in (twice, once):
        estimator.fit(images(4), LABELS)
    assert all(torch.equal(value, once.state_dict()[name]) for name, value in twice.state_dict().items())


def test_tuning_images_choose_c():
    estimator = made(c_values=(0.01, 1.0))
    with pytest.raises(ValueError, match="without validation images"):
        estimator.fit(images(0), LABELS)
    estimator.fit(images(0), LABELS, (images(1), LABELS))
    assert estimator.facts()["prices"]["cosfire_svm"] in (0.01, 1.0)


def test_examples_without_structure_are_refused():
    with pytest.raises(NoFilterError, match="could be configured for class 0"):
        made(least_parts=10**4).fit(images(0), LABELS)


def test_what_methods_see_is_computed_once():
    computed = []

    def represent(kind, seen):
        computed.append(kind)
        return seen["tiled"] + 1 if kind == "maxima" else seen.images.float()

    seen = SeenImages(torch.zeros(2, 3).byte(), represent)
    for _ in range(2):
        assert (seen["maxima"] == 1).all()
    assert computed == ["maxima", "tiled"]
