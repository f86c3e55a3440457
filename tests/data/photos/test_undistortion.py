import cv2
import numpy as np
import pytest
import torch
from data.photos.pictures import scene

from sextant.data.photos import straight_focal, undistort_photo
from sextant.geometry import undistort_radius


def lopez(k1):
    return 0.019 * k1 + 0.805 * k1 * k1


def waves(x, y):
    return 128 + 60 * np.sin(x / 9) + 50 * np.cos(y / 7)


@pytest.mark.parametrize("keep", ["crop", "all"])
@pytest.mark.parametrize(("k1", "k2"), [(-0.3, lopez(-0.3)), (0.1, lopez(0.1)), (-0.1, 0.0), (0.0, 0.0)])
def test_a_distorted_picture_of_a_plane_is_made_straight(keep, k1, k2):
    width, height, focal = 240, 180, 150.0
    rows, columns = np.indices((height, width)) + 0.5
    u, v = (columns - width / 2) / focal, (rows - height / 2) / focal
    distorted = torch.from_numpy(np.hypot(u, v))
    radius = undistort_radius(distorted, torch.tensor(k1).double(), torch.tensor(k2).double())
    factor = (radius / distorted.clamp(min=1e-12)).numpy()
    image = np.repeat(waves(80 * u * factor, 80 * v * factor)[..., None], 3, 2).round().astype(np.uint8)
    straight, new = undistort_photo(image, focal, k1, k2, keep)
    expected = waves(80 * (columns - width / 2) / new, 80 * (rows - height / 2) / new)
    inside = straight[..., 0] > 5 if keep == "all" else np.ones((height, width), bool)
    inside[[0, -1]] = inside[:, [0, -1]] = False
    inner = cv2.erode(inside.astype(np.uint8), np.ones((7, 7))) > 0
    assert inner.mean() > 0.5
    assert np.abs(straight[..., 0] - expected)[inner].max() < 4


@pytest.mark.parametrize("k1", [-0.4, -0.1, -0.04, 0.15])
@pytest.mark.parametrize("size", [(160, 120), (90, 160), (200, 60)])
def test_crop_has_no_borders_and_is_the_largest_such_picture(k1, size):
    width, height = size
    white = np.full((height, width, 3), 255, np.uint8)
    focal = 0.6 * max(size)  # wide, but before any fold
    crop = straight_focal(width, height, focal, k1, lopez(k1), "crop")
    every = straight_focal(width, height, focal, k1, lopez(k1), "all")
    assert every < crop

    def border(straight):  # source coordinates of the picture's outline, in half sides
        t = np.linspace(-1, 1, 401)
        edge = np.concatenate([np.stack([t, 0 * t + 1], 1), np.stack([0 * t + 1, t], 1)]) * [width / 2, height / 2]
        r = np.hypot(*edge.T) / straight
        return np.abs(edge / straight * (focal * (1 + k1 * r**2 + lopez(k1) * r**4))[:, None] / [width / 2, height / 2])

    assert border(crop).max() <= 1 + 1e-6
    assert border(crop / 1.01).max() > 1  # a little wider and a corner is empty
    assert border(every).max(1).min() >= 1 - 1e-6  # everything is in
    assert border(every * 1.01).max(1).min() < 1
    image, new = undistort_photo(white, focal, k1, lopez(k1), "crop")
    assert new == crop
    assert (image == 255).all()


def test_beyond_the_fold_there_is_no_picture():
    white = np.full((120, 160, 3), 255, np.uint8)
    image, _ = undistort_photo(white, 60.0, -0.3, 0.0, "all")  # folds at r = 1.05, seen at 0.70 of 60 px
    assert image[60, 80].tolist() == [255] * 3
    assert (image[:4, :4] == 0).all()
    crop, _ = undistort_photo(white, 60.0, -0.3, 0.0, "crop")
    assert (crop == 255).all()


def test_without_distortion_the_picture_is_the_same():
    image, focal = undistort_photo(scene(), 77.0, 0.0, 0.0)
    assert focal == pytest.approx(77, rel=1e-12)
    np.testing.assert_array_equal(image, scene())


def test_it_agrees_with_opencvs_own_undistortion():
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(256, size=(180, 240, 3), dtype=np.uint8), (0, 0), 2)
    straight, new = undistort_photo(image, 200.0, -0.2, lopez(-0.2))
    centre = np.array([[1, 0, 119.5], [0, 1, 89.5], [0, 0, 1.0]])
    camera, target = centre * [[200.0, 1, 1], [1, 200.0, 1], [1, 1, 1]], centre * [[new, 1, 1], [1, new, 1], [1, 1, 1]]
    maps = cv2.initUndistortRectifyMap(
        camera, np.array([-0.2, lopez(-0.2), 0, 0]), None, target, (240, 180), cv2.CV_32FC1
    )
    theirs = cv2.remap(image, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    assert np.abs(straight.astype(int) - theirs).max() <= 2
