"""Batches of places: who is in them, that they come again, and what is done to their images."""

import numpy as np
import pytest
import torch
from data.places.place_pictures import aligned_places, write_pictures
from hypothesis import given
from hypothesis import strategies as st

from sextant.chapters.places.data import ImageRows, Nordland, PlaceImages, PlaceTolerance
from sextant.chapters.places.data.augmentation import PlaceAugmentation, shifted
from sextant.chapters.places.data.batches import PlaceBatches, PlaceBatchImages
from sextant.chapters.places.data.datamodule import PlaceData
from sextant.errors import UserError

TOLERANCE = PlaceTolerance("frames", 1, 5)


def scattered(seed, n=60, traverses=3):
    """Positions along a noisy line, traverses that overlap in part."""
    rng = np.random.default_rng(seed)
    position = np.stack([rng.uniform(0, 200, n), rng.uniform(0, 3, n)], -1)
    traverse = np.sort(rng.integers(0, traverses, n))
    return PlaceImages(
        ImageRows(np.zeros((n, 4, 6, 3), np.uint8)), traverse, tuple("abc"[:traverses]), np.arange(n), ("",) * n,
        position, rng.uniform(-180, 180, n) * (rng.random(n) < 0.2), aligned=False,
    )  # fmt: skip


def batches_of(places, tolerance=TOLERANCE, p=3, c=2, seed=0):
    return PlaceBatches(places, tolerance, p, c, seed)


@given(st.integers(0, 2**31))
def test_images_of_a_place_are_positives_and_no_two_alike(seed):
    places, tolerance = scattered(seed), PlaceTolerance("m", 5, 25, 40)
    sampler = batches_of(places, tolerance, p=4, c=3, seed=seed)
    rng = np.random.default_rng(seed)
    for anchor in sampler.anchors:
        rows = sampler._images_of(anchor, rng)
        assert 2 <= len(rows) <= 3
        assert len(set(rows.tolist())) == len(rows)
        positive = places.positives(rows, rows, tolerance).toarray()
        assert (positive | np.eye(len(rows), dtype=bool)).all()


@given(st.integers(0, 2**31))
def test_every_image_with_a_positive_is_at_an_anchor(seed):
    places, tolerance = scattered(seed), PlaceTolerance("m", 5, 25)
    every = np.arange(len(places))
    matrix = places.positives(every, every, tolerance).toarray()
    sampler = batches_of(places, tolerance)
    at_anchor = matrix[:, sampler.anchors].any(1) | np.isin(every, sampler.anchors)
    assert np.array_equal(at_anchor, matrix.any(1))


def test_an_aligned_ride_has_as_many_places_as_frames_whatever_its_seasons():
    for traverses in (2, 4):
        sampler = batches_of(aligned_places(40, traverses), p=6)
        assert len(sampler.anchors) == 40
        assert len(sampler) == 6


def test_a_batch_shows_places_apart_under_other_conditions():
    places = aligned_places(60, 3)
    sampler = batches_of(places, p=4, c=3)
    for number, numbers in enumerate(sampler):
        rows = numbers.numpy().reshape(4, 3)
        assert all(set(places.traverse[group]) == {0, 1, 2} for group in rows)
        if number < len(sampler) - 2:  # at the end of an epoch few places are left to choose from
            middle = places.frame[rows].mean(1)
            assert np.abs(middle[:, None] - middle)[~np.eye(4, dtype=bool)].min() >= 3  # 5 apart, jittered by one
    for anchors in list(sampler.places_of_epoch(0))[:-2]:
        frame = places.frame[anchors]
        assert np.abs(frame[:, None] - frame)[~np.eye(4, dtype=bool)].min() >= 5


def test_an_epoch_visits_places_once_and_all_over_the_epochs():
    sampler = batches_of(aligned_places(40, 2), p=6)
    seen = set()
    for epoch in range(6):
        visited = np.concatenate(list(sampler.places_of_epoch(epoch)))
        assert len(visited) == len(set(visited.tolist())) == 36
        seen |= set(visited.tolist())
    assert len(seen) == 40


def test_images_are_drawn_from_all_within_the_tolerance():
    places = aligned_places(40, 2)
    jittered = np.concatenate([numbers.numpy().reshape(6, 2) for numbers in batches_of(places, p=6)])
    apart = np.abs(np.diff(places.frame[jittered])).ravel()
    assert set(apart.tolist()) == {0, 1}


def test_places_too_near_one_another_still_fill_a_batch():
    sampler = batches_of(aligned_places(6, 2), PlaceTolerance("frames", 0, 50), p=3)
    assert [len(numbers) for numbers in sampler] == [6, 6]
    assert [len(numbers) for numbers in batches_of(aligned_places(2, 2), p=8)] == [4]


def test_a_batch_is_a_function_of_seed_and_epoch():
    places = aligned_places(40, 3)

    def epoch(seed, number):
        sampler = batches_of(places, seed=seed)
        sampler.set_epoch(number)
        return [batch.tolist() for batch in sampler]

    assert epoch(1, 2) == epoch(1, 2)
    assert epoch(1, 2) != epoch(2, 2)
    assert np.array(epoch(1, 2)).min() >= 2 * len(places)
    assert [i % len(places) for i in epoch(1, 2)[0]] != [i % len(places) for i in epoch(1, 3)[0]]


def test_nothing_to_learn_is_told():
    with pytest.raises(UserError, match="no training image has another within the tolerance of pm0f"):
        batches_of(aligned_places(5, 1), PlaceTolerance("frames", 0, 2))
    with pytest.raises(ValueError, match="two images"):
        batches_of(aligned_places(5, 2), c=1)


def test_a_batch_keeps_images_and_places_together():
    places = aligned_places(10, 2, position_m=np.arange(40.0).reshape(20, 2) + 5e6, heading_deg=np.arange(20.0))
    batch = PlaceBatchImages(places)[torch.tensor([13, 20, 57])]
    assert batch.rows.tolist() == [13, 0, 17]
    assert batch.indices.tolist() == [13, 20, 57]
    assert batch.images.shape == (3, 3, 4, 6)
    assert batch.images[:, 0, 0, 0].tolist() == [103, 0, 107]
    assert batch.condition.tolist() == [1, 0, 1]
    assert batch.frame.tolist() == [3, 0, 7]
    assert batch.position_m[0].tolist() == [5e6 + 26, 5e6 + 27]
    assert batch.heading_deg.tolist() == [13, 0, 17]
    assert batch.to(torch.device("meta")).images.device.type == "meta"
    assert batch.images_in_unit_range().max() <= 1
    assert PlaceBatchImages(aligned_places())[[0]].to(torch.device("cpu")).position_m is None


# -- augmentation ------------------------------------------------------------------------------------------------------


def noise(count=5, height=20, width=30):
    return torch.from_numpy(np.random.default_rng(0).integers(60, 190, (count, 3, height, width)).astype(np.uint8))


def test_zero_strengths_change_nothing():
    assert torch.equal(PlaceAugmentation(0, 0, 0)(noise(), np.arange(5), 3), noise())


def test_every_other_epoch_is_mirrored():
    places = aligned_places(12, 2)
    plain, mirrored = (PlaceBatchImages(places, PlaceAugmentation(0, 0, 0, mirror)) for mirror in (False, True))
    for epoch in range(4):
        numbers = [3 + epoch * len(places), 20 + epoch * len(places)]
        expected = plain[numbers].images
        assert torch.equal(mirrored[numbers].images, expected.flip(-1) if epoch % 2 else expected)


def test_what_an_image_gets_is_a_function_of_its_number():
    change = PlaceAugmentation()
    whole = change(noise(), np.arange(5), 3)
    assert torch.equal(change(noise()[[4, 1]], np.array([4, 1]), 3), whole[[4, 1]])
    assert not torch.equal(change(noise(), np.arange(5), 4), whole)
    assert not torch.equal(change(noise(), np.arange(5) + 100, 3), whole)


def test_brightness_and_contrast_stay_within_their_bounds():
    images = noise(200, 8, 8)
    changed = PlaceAugmentation(brightness=0.2, contrast=0, shift=0)(images, np.arange(200), 0).float()
    ratio = torch.log(changed.mean((1, 2, 3)) / images.float().mean((1, 2, 3)))
    assert ratio.abs().max() < 0.21
    assert ratio.min() < -0.15
    assert ratio.max() > 0.15
    changed = PlaceAugmentation(brightness=0, contrast=0.3, shift=0)(images, np.arange(200), 0).float()
    ratio = torch.log(changed.std((1, 2, 3)) / images.float().std((1, 2, 3)))
    assert 0.25 < ratio.abs().max() < 0.32


def test_shifts_move_and_never_mirror():
    images = noise(3)
    moved = shifted(images, torch.tensor([0, 2, -3]), torch.tensor([0, -4, 5]))
    assert torch.equal(moved[0], images[0])
    assert torch.equal(moved[1][:, 2:, :-4], images[1][:, :-2, 4:])
    assert torch.equal(moved[2][:, :-3, 5:], images[2][:, 3:, :-5])
    assert torch.equal(moved[1][:, :2, 0], images[1][:, :1, 4].expand(3, 2))
    with pytest.raises(ValueError, match="shift"):
        PlaceAugmentation(shift=0.6)


# -- the data module ---------------------------------------------------------------------------------------------------


def test_the_data_module_serves_all_splits(tmp_path):
    for k, season in enumerate(("summer", "winter")):
        write_pictures(tmp_path / "nordland" / season, [f"{n:03d}.png" for n in range(40)], first=100 * k)
    source = Nordland(
        frames={"train": (0, 25), "val": (25, 30), "test": (30, 40)}, height=16, width=24, roots=[tmp_path]
    )
    data = PlaceData(
        source, TOLERANCE, batch_places=4, batch_conditions=2, eval_batch_size=7, seed=1,
        augmentation=PlaceAugmentation(),
    )  # fmt: skip
    data.setup("fit")
    batches = list(data.train_dataloader())
    assert [len(batch.rows) for batch in batches] == [8] * 6
    assert all(torch.equal(a.images, b.images) for a, b in zip(batches, data.train_dataloader(), strict=True))
    assert torch.cat([batch.rows for batch in data.val_dataloader()]).tolist() == list(range(10))
    with pytest.raises(KeyError):
        data.split("test")
    data.setup("test")
    images = torch.cat([batch.images for batch in data.test_dataloader()])
    assert np.array_equal(images.permute(0, 2, 3, 1).numpy(), data.split("test").images[:])
    assert len(list(data.in_order("train"))) == 8
