"""The sequences of CIFAR-10-P: what each frame is, and what changes between them."""

import itertools

import cv2
import numpy as np
import pytest
import torch

from sextant.corruptions import Condition, PerturbationSuite
from sextant.corruptions.perturbations import cifar10_p
from sextant.errors import ArgumentError

LENGTHS = {"motion_blur": 21, "translate": 16}
#: the frame that is the image itself, where there is one
STILL = {"zoom_blur": 0, "brightness": 15, "translate": 7, "rotate": 15, "scale": 15}


@pytest.fixture
def images():
    """Smooth colour images of bytes, with detail in the middle."""
    bytes_ = torch.randint(0, 256, (2, 3, 9, 9), generator=torch.Generator().manual_seed(0)).float()
    smooth = torch.nn.functional.interpolate(bytes_, (32, 32), mode="bilinear")
    return smooth.round() / 255


def frames(suite, name, images, indices=(4, 7)):
    return [suite.corrupt(images, torch.tensor(indices), condition) for condition in suite.sequence(name)]


@pytest.mark.parametrize("name", list(cifar10_p()))
def test_a_sequence_has_as_many_frames_of_bytes_as_the_published_one(name, images):
    made = frames(PerturbationSuite(), name, images)
    assert len(made) == LENGTHS.get(name, 31)
    for frame in made:
        assert frame.shape == images.shape
        torch.testing.assert_close(frame * 255, (frame * 255).round(), rtol=0, atol=1e-4)
    changes = sum(not torch.equal(*pair) for pair in itertools.pairwise(made))
    assert changes == len(made) - 1 or (name == "snow" and changes > 15)  # 4 degrees may move no flake by a pixel


@pytest.mark.parametrize(("name", "frame"), STILL.items())
def test_a_sequence_passes_through_the_image_where_it_should(name, frame, images):
    torch.testing.assert_close(frames(PerturbationSuite(), name, images)[frame], images, rtol=0, atol=1e-6)


def test_sequences_with_noise_start_with_the_image_and_draw_every_frame_anew(images):
    for name, sd in (("gaussian_noise", 0.02), ("shot_noise", None)):
        made = frames(PerturbationSuite(), name, images)
        assert torch.equal(made[0], images)
        noise = torch.stack(made[1:]) - images
        assert abs(float(torch.corrcoef(noise[:2].flatten(1))[0, 1])) < 0.1
        if sd is not None:
            away = (images > 0.1) & (images < 0.9)
            assert float(noise[:, away].std()) == pytest.approx(sd, rel=0.05)


def test_snow_keeps_its_flakes_while_the_wind_turns(images):
    dark = torch.zeros_like(images)
    first, next_, last = (frames(PerturbationSuite(), "snow", dark)[i] for i in (0, 1, 30))

    def alike(one, another):
        return float(torch.corrcoef(torch.stack([one.flatten(), another.flatten()]))[0, 1])

    assert alike(first, next_) > 0.7 > alike(first, last)
    again = frames(PerturbationSuite(), "snow", dark[:1], indices=(7,))[0]
    assert torch.equal(again[0], first[1])


def test_translation_moves_to_the_right_and_black_comes_in(images):
    last = frames(PerturbationSuite(), "translate", images)[15]
    assert torch.equal(last[..., 8:], images[..., :-8])
    assert not last[..., :8].any()


def opencv_tilt(image, degrees):
    """As the benchmark's authors have it, from matrices of homogeneous coordinates in space."""
    height, width = image.shape[:2]
    turn, far = np.deg2rad(degrees), np.hypot(width, height)
    c, s = np.cos(turn), np.sin(turn)
    lift = np.array([[1, 0, -width / 2], [0, 1, -height / 2], [0, 0, 1], [0, 0, 1]])
    about_x = np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
    about_y = np.array([[c, 0, -s, 0], [0, 1, 0, 0], [s, 0, c, 0], [0, 0, 0, 1]])
    away = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, far], [0, 0, 0, 1]])
    onto = np.array([[far, 0, width / 2, 0], [0, far, height / 2, 0], [0, 0, 1, 0]])
    return cv2.warpPerspective(image, onto @ away @ about_x @ about_y @ lift, (width, height))


@pytest.mark.parametrize("frame", [0, 10, 15, 30])
def test_a_tilt_is_that_of_opencv(frame, images):
    made = PerturbationSuite().corrupt(images, torch.arange(2), Condition("tilt", frame))
    for one, image in zip(made, images, strict=True):
        expected = opencv_tilt(image.permute(1, 2, 0).numpy(), 0.75 * (frame - 15))
        difference = np.abs(one.permute(1, 2, 0).numpy() - expected)
        assert np.quantile(difference, 0.98) < 0.01
        assert difference.mean() < 0.004


def test_a_rotation_turns_clockwise():
    corner = torch.zeros(1, 1, 33, 33)
    corner[..., 16, 28] = 1  # right of the middle
    row, column = divmod(int(frames(PerturbationSuite(), "rotate", corner, (0,))[30].argmax()), 33)
    assert row > 17
    assert column < 29


@pytest.mark.parametrize("names", [[], ["rotate", "fog"]])
def test_a_perturbation_that_is_not_there_is_refused(names):
    with pytest.raises(ArgumentError, match=r"(?s)names=\[.*There are: gaussian_noise, shot_noise"):
        PerturbationSuite(names)


def test_a_sequence_that_is_not_there_is_refused():
    with pytest.raises(ArgumentError, match=r"(?s)corruption=fog is not in the suite.*There are: rotate"):
        PerturbationSuite(["rotate"]).sequence("fog")
