import base64
import io

import numpy as np
import pytest
from PIL import Image, ImageDraw

from sextant.errors import UserError
from sextant.tools.demonstration.digit import SIDE, DigitTrial, digit_of


def drawn_seven(size=280, ink=0, paper=255, at=(0, 0)):
    picture = Image.new("RGB", (size, size), (paper,) * 3)
    x, y = at
    corners = [(x + 90, y + 70), (x + 190, y + 70), (x + 130, y + 210)]
    ImageDraw.Draw(picture).line(corners, fill=(ink,) * 3, width=20, joint="curve")
    return np.asarray(picture)


@pytest.fixture(scope="module")
def trial():
    return DigitTrial.load()


def test_a_digit_is_framed_as_those_of_mnist():
    digit = digit_of(drawn_seven())
    assert digit.shape == (SIDE, SIDE)
    rows, columns = np.nonzero(digit > 20)
    assert max(np.ptp(rows), np.ptp(columns)) + 1 == pytest.approx(20, abs=1)
    weight = digit / digit.sum()
    centre = (weight.sum(1) @ np.arange(SIDE), weight.sum(0) @ np.arange(SIDE))
    np.testing.assert_allclose(centre, [13.5, 13.5], atol=0.6)


@pytest.mark.parametrize(
    "other", [drawn_seven(at=(40, 30)), drawn_seven(ink=255, paper=0), drawn_seven(ink=60, paper=200)]
)
def test_place_paper_and_ink_do_not_matter(other):
    assert np.abs(digit_of(other).astype(int) - digit_of(drawn_seven())).mean() < 3


def test_an_empty_sheet_is_named():
    with pytest.raises(UserError, match="the picture is blank"):
        digit_of(np.full((280, 280, 3), 255, np.uint8))


@pytest.mark.parametrize("shape", [(30, 600, 3), (200, 400, 3)])
def test_a_strip_or_panorama_is_no_digit(shape):
    street = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    with pytest.raises(UserError, match="times as wide as high, which no digit is"):
        digit_of(street)


@pytest.mark.slow
def test_both_networks_read_a_drawn_digit_clean_and_under_every_corruption(trial, tmp_path):
    Image.fromarray(drawn_seven()).save(tmp_path / "7.png")
    found = trial.answer(tmp_path / "7.png")
    assert {name: digit for name, (digit, _) in found["clean"].items()} == {"convolution": 7, "push_pull": 7}
    assert (len(found["names"]), found["severities"]) == (19, [1, 2, 3, 4, 5])
    assert [len(row) for row in found["answers"]] == [5] * 19
    probabilities = [p for row in found["answers"] for cell in row for _, p in cell.values()]
    assert all(0.1 <= p <= 1 for p in probabilities)
    assert len(set(probabilities)) > 100  # the corruptions are different ones


@pytest.mark.slow
def test_each_cell_of_the_sheet_is_the_picture_that_was_read(trial, tmp_path):
    found = trial.of(digit_of(drawn_seven()))
    sheet = np.asarray(Image.open(io.BytesIO(base64.b64decode(found["pictures"].partition(",")[2]))))
    assert sheet.shape == (19 * SIDE, 5 * SIDE)
    for name, severity in (("fog", 3), ("gaussian_noise", 5)):
        row, column = found["names"].index(name), severity - 1
        cell = sheet[row * SIDE :][:SIDE, column * SIDE :][:, :SIDE]
        classifier = trial.networks["convolution"]
        digit, probability = found["answers"][row][column]["convolution"]
        seen = classifier.classify(cell[..., None].copy())
        assert (int(seen.label), seen.probability) == (digit, pytest.approx(probability, abs=1e-4))


def test_somebodys_handwriting_and_what_the_cards_say(trial):
    found = trial.of_scan(0)
    assert found["clean"]["convolution"][0] == 0
    assert found["on_test_digits"]["push_pull"]["error"]["corrupted"] == pytest.approx(0.0207)
    with pytest.raises(UserError, match="digit=12 must be"):
        trial.of_scan(12)
