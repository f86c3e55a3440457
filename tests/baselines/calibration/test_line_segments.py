import cv2
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from sextant.baselines.calibration import count_long, detect_bent_segments, detect_chains, detect_segments
from sextant.baselines.calibration.lens import apparent_k2, undistort_points


def rectangle(width=256, height=192, left=60, right=200, top=50, bottom=120):
    image = np.full((height, width, 3), 30, np.uint8)
    image[top:bottom, left:right] = 200
    return image


@pytest.mark.parametrize("size", [(256, 192), (512, 384), (1280, 960), (100, 75)])
def test_sides_of_a_rectangle_lie_where_they_are_to_a_tenth_of_a_pixel(size):
    width, height = size
    left, right, top, bottom = (
        round(share * side) for share, side in ((0.2, width), (0.8, width), (0.25, height), (0.6, height))
    )
    found = detect_segments(rectangle(width, height, left, right, top, bottom), shortest=0.2)
    pixels = found * height + [width / 2, height / 2]
    for axis, places in ((0, (left, right)), (1, (top, bottom))):
        for place in places:
            off = np.abs(pixels[:, :, axis] - place).max(axis=1)
            assert off.min() < 0.12 * max(1, height / 512), (axis, place)  # it works on at most 512 rows


def test_segments_come_longest_first_and_are_counted():
    found = detect_segments(rectangle())
    lengths = np.linalg.norm(found[:, 1] - found[:, 0], axis=-1)
    assert (np.diff(lengths) <= 0).all()
    assert count_long(found) == (lengths > 0.1).sum() >= 4


@pytest.mark.parametrize("detect", [detect_segments, detect_chains])
def test_the_frame_of_a_scan_is_no_line(detect):
    image = np.full((192, 256, 3), 120, np.uint8)
    image[:1], image[-1:], image[:, :1], image[:, -1:] = 0, 0, 0, 0
    assert len(detect(image)) == 0


@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 40, 3), (40, 1, 3), (3, 900, 3), (192, 256, 3)])
@pytest.mark.parametrize(
    "detect", [detect_segments, detect_chains, lambda image: detect_bent_segments(image, -0.3, 0.9)]
)
def test_nothing_is_found_in_an_empty_image_of_any_size(shape, detect):
    assert len(detect(np.full(shape, 77, np.uint8))) == 0


@pytest.mark.parametrize("image", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8)])
def test_what_is_no_image_is_refused(image):
    with pytest.raises((ValueError, TypeCheckError), match=r"need a uint8 RGB image|Type-check error"):
        detect_segments(image)


def test_chains_follow_an_edge_to_a_tenth_of_a_pixel():
    rows, columns = np.mgrid[: 4 * 192, : 4 * 256]
    inside = (columns / 4 < 100 + 0.2 * (rows / 4)).astype(np.float32) * 170 + 40  # column = 100 + 0.2 row
    grey = cv2.resize(inside, (256, 192), interpolation=cv2.INTER_AREA).round().astype(np.uint8)
    chains = detect_chains(np.repeat(grey[..., None], 3, axis=2))
    assert len(chains) == 1
    u, v = np.moveaxis(chains[0], -1, 0)
    column, row = u * 192 + 128, v * 192 + 96
    assert np.abs(column - (100 + 0.2 * row)).max() < 0.15


@pytest.mark.parametrize("k1_hat", [-0.4, -0.2, -0.05, 0.1])
def test_lines_from_border_to_border_are_found_whole(k1_hat):
    v, u = (np.mgrid[:512, :512] + 0.5) / 512 - 0.5
    x = undistort_points(np.stack([u, v], axis=-1), k1_hat, apparent_k2(k1_hat, 0.87))[..., 0]
    bar = np.uint8(255 * (abs(x - 0.05) < 0.1))[..., None].repeat(3, axis=-1)
    found = detect_bent_segments(bar, k1_hat, 0.87)
    assert len(found) == 2
    assert abs(found[:, :, 1]).ravel() == pytest.approx(0.5, abs=0.015)


@pytest.mark.parametrize("k1_hat", [-0.6, -0.4, -0.2, -0.05, 0.1, 0.2])
@pytest.mark.parametrize("width", [512, 683])
def test_the_border_of_a_picture_is_no_line(k1_hat, width):
    bright = np.full((512, width, 3), 250, np.uint8)
    bright[100:412, 100:-100] = 0
    found = detect_bent_segments(bright, k1_hat, 0.87)
    from_border = np.array([width / 512, 1.0]) / 2 - abs(found.mean(axis=1))
    assert from_border.min(initial=1) > 0.1
