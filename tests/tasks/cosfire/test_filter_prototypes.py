"""Which examples filters are configured from, and where."""

import pytest
import torch

from sextant.chapters.cosfire import representations
from sextant.chapters.cosfire.filter_prototypes import PrototypeSettings, configure, own_responses
from sextant.errors import UserError
from sextant.layers.cosfire import Cosfire, GaborBank

LABELS = torch.tensor([3, 1, 3, 1, 3, 1, 7])


@pytest.fixture
def images():
    return torch.randint(0, 256, (7, 1, 20, 24), generator=torch.Generator().manual_seed(0), dtype=torch.uint8)


def made(images, seed=0, labels=LABELS, **settings):
    filters = Cosfire(GaborBank(), floor=0.01)
    chosen = PrototypeSettings(**{"per_class": 2, "least_parts": 1} | settings)
    return filters, configure(filters, images, labels, chosen, torch.Generator().manual_seed(seed))


def test_so_many_filters_of_each_class_each_from_an_example_of_it(images):
    filters, found = made(images)
    assert found.labels.tolist() == [1, 1, 3, 3, 7, 7]
    assert len(filters) == 6
    assert LABELS[found.images].tolist() == found.labels.tolist()
    assert found.images[0] != found.images[1]  # there are enough
    assert found.images[4] == found.images[5] == 6
    assert not torch.equal(found.points[4], found.points[5])


def test_each_filter_is_that_of_its_example_at_its_point(images):
    filters, found = made(images)
    for number in range(len(filters)):
        alone = Cosfire(GaborBank(), floor=0.01)
        alone.configure(images[found.images[number]].float() / 255, tuple(found.points[number].tolist()))
        one, other = filters.tuples(number), alone.tuples(0)
        assert torch.equal(one.rho, other.rho)
        torch.testing.assert_close(one.phi, other.phi)


def test_own_responses_by_single_images_in_batches_of_any_size(images, monkeypatch):
    filters, found = made(images)
    each = [filters(images[i][None].float() / 255)[0, n].max() for n, i in enumerate(found.images.tolist())]
    own = own_responses(filters, images[found.images])
    torch.testing.assert_close(own, torch.stack(each), rtol=1e-5, atol=1e-6)
    monkeypatch.setattr(representations, "FLOATS_AT_ONCE", 2 * len(filters.rho) * 20 * 24)
    torch.testing.assert_close(own_responses(filters, images[found.images]), torch.stack(each), rtol=1e-5, atol=1e-6)


def test_the_seed_chooses(images):
    (_, one), (_, same), (_, other) = made(images), made(images), made(images, seed=1)
    assert torch.equal(one.points, same.points)
    assert torch.equal(one.images, same.images)
    assert not torch.equal(one.points, other.points)


def test_points_keep_off_the_border_or_are_the_centre(images):
    _, found = made(images, per_class=20, margin=0.3)
    assert ((found.points[:, 0] >= 0.3 * 23) & (found.points[:, 0] <= 0.7 * 23)).all()
    assert ((found.points[:, 1] >= 0.3 * 19) & (found.points[:, 1] <= 0.7 * 19)).all()
    assert found.points[:, 0].max() - found.points[:, 0].min() > 0.3 * 23
    _, central = made(images, at="centre")
    assert central.points.tolist() == [[11.5, 9.5]] * 6


def test_an_example_without_structure_is_passed_over(images):
    images[[0, 2]] = 128  # two of the three of class 3
    filters, found = made(images, per_class=3)
    assert found.images[found.labels == 3].tolist() == [4, 4, 4]
    assert len(filters) == 9


def test_places_that_give_too_few_parts_are_passed_over_and_leave_nothing_behind(images):
    filters, _ = made(images, per_class=5)
    fewest = sorted(len(filters.tuples(n)) for n in range(len(filters)))
    least = fewest[len(fewest) // 2]
    filters, found = made(images, per_class=5, least_parts=least)
    assert len(filters) == len(found.labels) == 15
    assert all(len(filters.tuples(n)) >= least for n in range(15))


def test_no_filter_of_so_many_parts_is_told(images):
    with pytest.raises(
        UserError, match=r"least_parts=10000 parts could be configured for class \d.* in 20 tries"
    ) as told:
        made(images, least_parts=10_000)
    assert "Lower task.least_parts" in told.value.fix


def test_what_the_bank_cannot_take_is_told_by_its_own_words(images):
    with pytest.raises(UserError, match=r"at the last place: .*takes grey images"):
        made(images.expand(-1, 3, -1, -1))
