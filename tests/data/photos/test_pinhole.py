"""Pictures by two cameras become pictures by one."""

import numpy as np
import pytest
import torch

from sextant.data.photos import Pinhole, through_pinhole
from sextant.errors import UserError
from sextant.geometry import PerspectiveCamera, k2_of_k1, rotation_from_tilt_roll


def photo(width, height, focal, k1, tilt, roll):
    """A picture of where each of its pixels looks, in the frame of gravity: smooth, and known everywhere."""
    camera = PerspectiveCamera.from_focal_pixels(focal, width, height, k1=torch.tensor(k1, dtype=torch.float64))
    turn = rotation_from_tilt_roll(*torch.tensor([tilt, roll], dtype=torch.float64))
    rays = (camera.bearings(camera.pixel_centres(dtype=torch.float64)) @ turn.mT).numpy()
    return coloured(rays)


def coloured(rays):
    """Bytes of directions."""
    return (127.5 + 120 * rays / np.linalg.norm(rays, axis=-1, keepdims=True)).round().astype(np.uint8)


def seen(view):
    """What a view looks at, in the frame of gravity."""
    x, y = np.meshgrid(np.arange(view.width) + 0.5 - view.width / 2, np.arange(view.height) + 0.5 - view.height / 2)
    rays = np.stack([x / view.focal, y / view.focal, np.ones_like(x)], axis=-1)
    turn = rotation_from_tilt_roll(*torch.tensor([view.tilt, 0.0], dtype=torch.float64)).numpy()
    return coloured(rays @ turn.T)


@pytest.mark.parametrize(
    ("k1", "tilt", "roll", "aim"),
    [(0.0, 0.0, 0.0, 0.0), (-0.3, 0.0, 0.0, 0.0), (0.1, 0.1, 0.0, 0.0), (-0.2, -0.08, 0.15, 0.03)],
)
@pytest.mark.parametrize("size", [1, 4])
def test_every_pixel_sees_what_lies_in_its_direction(k1, tilt, roll, aim, size):
    width, height, focal = 160 * size, 120 * size, 110.0 * size
    view = Pinhole(60, 44, 60.0, aim)
    k2 = float(k2_of_k1(torch.tensor(k1, dtype=torch.float64), "lopez"))
    image = photo(width, height, focal, k1, tilt, roll)
    picture, unseen = through_pinhole(image, view, focal=focal, k1=k1, k2=k2, tilt=tilt, roll=roll)
    assert unseen == 0
    assert np.abs(picture.astype(int) - seen(view)).max() <= 2  # of 255: rounded twice


def test_what_is_beyond_the_photo_is_counted_and_takes_the_colour_of_its_edge():
    image = np.zeros((100, 100, 3), np.uint8)
    image[:, -1] = 200
    picture, unseen = through_pinhole(image, Pinhole(200, 100, 100.0), focal=100.0)
    assert unseen == pytest.approx(0.5)
    assert (picture[:, 160:] == 200).all()
    assert not picture[:, :140].any()


def test_a_fold_of_the_lens_and_rays_from_behind_are_not_seen():
    image = np.full((100, 100, 3), 9, np.uint8)
    for view, lens in ((Pinhole(400, 100, 50.0), {"k1": -0.5}), (Pinhole(100, 100, 20.0, 1.5), {"tilt": -1.5})):
        picture, unseen = through_pinhole(image, view, focal=100.0, **lens)
        assert unseen > 0.5
        assert (picture == 9).all()


@pytest.mark.parametrize("wrong", [{"width": 0}, {"focal": 0.0}, {"focal": np.inf}, {"tilt": 2.0}])
def test_a_view_that_is_none_is_refused(wrong):
    with pytest.raises(UserError, match="above 0"):
        Pinhole(**{"width": 10, "height": 10, "focal": 10.0} | wrong)
