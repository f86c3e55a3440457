import numpy as np
import torch
from calibration_toy import ToyPanoramas, distribution

from sextant.chapters.calibration.data.batches import Crops, augmented, relit


def crops(augment):
    return Crops(ToyPanoramas().read("train"), distribution(), 64, 48, seed=3, augment=augment)


def test_a_crop_is_changed_the_same_way_whatever_comes_with_it():
    alone, together = crops(True)[[7]], crops(True)[[3, 7, 9]]
    assert torch.equal(alone.images[0], together.images[1])
    assert alone.cameras.roll[0] == together.cameras.roll[1]


def test_half_the_crops_are_mirrored_with_the_opposite_roll():
    numbers = list(range(200))
    plain, changed = crops(False)[numbers], crops(True)[numbers]
    opposite = changed.cameras.roll == -plain.cameras.roll
    assert 70 < opposite.sum() < 130
    assert torch.equal(changed.cameras.roll[~opposite], plain.cameras.roll[~opposite])
    assert torch.equal(changed.cameras.tilt, plain.cameras.tilt)
    flipped = torch.where(opposite[:, None, None, None], plain.images.flip(-1), plain.images)
    grey, expected = (i.float().mean(1).flatten(1) for i in (changed.images, flipped))
    likeness = [np.corrcoef(a, b)[0, 1] for a, b in zip(grey.numpy(), expected.numpy(), strict=True)]
    assert np.median(likeness) > 0.9


def test_the_mirror_is_what_a_camera_of_opposite_roll_would_see():
    from dataclasses import replace

    from sextant.chapters.calibration.data.crops import crop_batch
    from sextant.chapters.calibration.data.panoramas import Panoramas

    panorama = ToyPanoramas().read("test")[0]
    draw = distribution().draw(4, 1)
    there = np.zeros(4, np.int64)
    seen = crop_batch(Panoramas([panorama], ["a"]), there, draw, 64, 48)
    other = replace(draw, cameras=draw.cameras._replace(roll=-draw.cameras.roll), yaw=-draw.yaw)
    mirror = crop_batch(Panoramas([np.ascontiguousarray(panorama[:, ::-1])], ["a"]), there, other, 64, 48)
    difference = np.abs(mirror[..., ::-1].astype(float) - seen)
    assert difference.mean() < 1.0


def test_numbers_in_the_middle_change_little():
    images = crops(False)[[0, 1]].images
    middle = np.full((9, 2), 0.5)
    middle[0], middle[6] = 0.4 / 1.4, 1e-9  # no blur, no noise
    changed = relit(images, middle).float()
    mean = images.float().mean((1, 2, 3), keepdim=True)
    torch.testing.assert_close(changed, 0.9 * (images - mean) + mean, atol=1.5, rtol=0)


def test_other_numbers_give_other_light():
    batch = crops(False)[list(range(20))]
    assert len({round(float(image.float().mean()), 1) for image in augmented(batch, 0).images}) > 10
