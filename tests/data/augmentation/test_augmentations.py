"""What an image gets depends on (seed, epoch, index) alone; shifts and mirror images are what they say."""

import numpy as np
import pytest
import torch

from sextant.data.augmentation import AugmentedBatches, AugMix, NoAugmentation, PadCropFlip
from sextant.data.batches import ImageBatches
from sextant.errors import UserError

IMAGES = torch.from_numpy(np.random.default_rng(0).integers(0, 256, (12, 3, 16, 20), np.uint8))
INDICES = torch.arange(12)
ALL = [NoAugmentation(), PadCropFlip(), PadCropFlip(2, "constant", flip=False), AugMix()]


@pytest.mark.parametrize("augmentation", ALL, ids=lambda a: type(a).__name__)
def test_an_image_is_changed_alike_alone_and_in_any_batch(augmentation):
    whole = augmentation(IMAGES, INDICES, 3, seed=5)
    assert whole.shape == IMAGES.shape
    assert whole.dtype == torch.uint8
    some = torch.tensor([7, 2, 11])
    assert torch.equal(augmentation(IMAGES[some], some, 3, seed=5), whole[some])
    changed = not isinstance(augmentation, NoAugmentation)
    for other in (augmentation(IMAGES, INDICES, 4, seed=5), augmentation(IMAGES, INDICES, 3, seed=6)):
        assert torch.equal(other, whole) != changed


@pytest.mark.parametrize("augmentation", ALL, ids=lambda a: type(a).__name__)
def test_global_streams_are_left_alone(augmentation):
    torch.manual_seed(1)
    before = torch.random.get_rng_state()
    augmentation(IMAGES, INDICES, 0, seed=0)
    assert torch.equal(torch.random.get_rng_state(), before)


def test_an_image_is_a_shifted_window_of_itself_with_its_border_or_of_its_mirror_image():
    shown = PadCropFlip(pad=3)(IMAGES, INDICES, 0, seed=0)
    seen = set()
    for image, result in zip(IMAGES.numpy(), shown.numpy(), strict=True):
        padded = np.pad(image, ((0, 0), (3, 3), (3, 3)), mode="reflect")
        windows = {
            (top, left, mirrored): padded[:, top : top + 16, left : left + 20][..., :: -1 if mirrored else 1]
            for top in range(7)
            for left in range(7)
            for mirrored in (False, True)
        }
        found = [key for key, window in windows.items() if np.array_equal(window, result)]
        assert len(found) == 1
        seen.add(found[0])
    assert len(seen) > 8


def test_shifts_and_mirror_images_are_even():
    ramp = torch.arange(20, dtype=torch.uint8).expand(4000, 1, 20, 20).contiguous()
    shown = PadCropFlip(pad=2, mode="replicate")(ramp, torch.arange(4000), 0, seed=0)[:, 0, 0].float()
    mirrored = shown[:, 5] > shown[:, 10]
    assert mirrored.float().mean().item() == pytest.approx(0.5, abs=0.03)
    shifts = shown[~mirrored][:, 10] - 10
    counts = torch.stack([(shifts == s).float().mean() for s in range(-2, 3)])
    assert counts.sum() == 1
    assert counts.min() > 0.16


def test_images_too_small_to_be_reflected_are_named():
    with pytest.raises(UserError, match=r"augmentation\.pad=16: images of 16x20"):
        PadCropFlip(pad=16)(IMAGES, INDICES, 0, seed=0)


def test_batches_are_numbered_through_the_epochs():
    batches = AugmentedBatches(ImageBatches(IMAGES, torch.arange(12) * 2), PadCropFlip(), seed=4)
    batch = batches[[12 + 3, 12 + 9]]
    assert batch.indices.tolist() == [3, 9]
    assert batch.labels.tolist() == [6, 18]
    expected = PadCropFlip()(IMAGES[[3, 9]], torch.tensor([3, 9]), 1, seed=4)
    assert torch.equal(batch.images, expected)
    assert not torch.equal(batches[[3, 9]].images, expected)
