import numpy as np
import pytest

from sextant.data.photos.odd_pictures import check_no_panorama, closed_around, odd_picture
from sextant.errors import UserError


def noisy(shape, mean=128, spread=25, seed=0):
    """What a camera takes: no two pixels alike."""
    smooth = np.random.default_rng(seed).normal(mean, spread, (*shape, 3))
    return np.clip(smooth, 0, 255).astype(np.uint8)


def fisheye():
    v, u = np.mgrid[-1:1:300j, -1:1:400j]
    image = noisy((300, 400))
    image[np.hypot(u * 4 / 3, v) > 0.95] = 2
    return image


def screenshot():
    image = np.full((300, 400, 3), 240, np.uint8)
    image[40:44, 20:300] = image[100:110, 50:200] = 30
    image[::25, 30:380] = 90
    return image


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (noisy((300, 400)), None),
        (noisy((400, 300)), None),
        (np.full((300, 400, 3), 150, np.uint8), "almost nothing: a blank wall"),
        (noisy((300, 400), mean=180, spread=0.8), "almost nothing"),
        (noisy((40, 800)), "a strip of 20:1"),
        (screenshot(), "a screenshot, drawing or page"),
        (fisheye(), "a fisheye picture"),
    ],
)
def test_what_no_lens_of_the_model_took_is_named(image, says):
    found = odd_picture(image)
    assert found is None if says is None else says in found


def test_a_panorama_is_refused_and_a_photo_of_its_shape_is_not():
    angle = np.linspace(0, 2 * np.pi, 512, endpoint=False)[None, :, None]
    around = 120 + 50 * np.sin(angle) + 30 * np.cos(3 * angle) + np.random.default_rng(0).normal(0, 3, (256, 512, 3))
    around[:20] = 200  # the zenith
    around = around.astype(np.uint8)
    with pytest.raises(UserError, match=r"hall\.jpg is a panorama of 360 degrees \(512x256, closed around\)"):
        check_no_panorama(around, "hall.jpg")
    ramp = np.linspace(20, 230, 512)[None, :, None] + np.random.default_rng(0).normal(0, 3, (256, 512, 3))
    check_no_panorama(ramp.astype(np.uint8), "a wide photo")
    check_no_panorama(around[:, :400], "cut")


def test_a_wide_photo_before_a_plain_backdrop_is_no_panorama():
    """Its two edges are alike because they show nothing."""
    image = noisy((256, 512), mean=200, spread=2)
    v, u = np.mgrid[-1:1:256j, -2:2:512j]
    thing = np.hypot(u / 1.5, v) < 0.6
    image[thing] = noisy((256, 512), mean=90, spread=40)[thing]
    check_no_panorama(image, "a vase")
    assert closed_around(image)  # a reason to doubt, not to refuse


def test_what_stands_before_black_is_no_fisheyes_picture():
    v, u = np.mgrid[-1:1:400j, -1:1:300j]
    portrait = noisy((400, 300))
    portrait[(np.hypot(u * 2, (v + 0.2) * 1.5) > 1) & ((v < 0.3) | (np.abs(u) > 0.8))] = 3
    assert odd_picture(portrait) is None
