import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sextant.errors import UserError
from sextant.tools.demonstration.same_place import KNOWN_PAIRS, SHARES, SamePlace, known_pairs

PICTURES = Path(__file__).parents[3] / "docs/worlds"


@pytest.fixture(scope="module")
def comparing():
    return SamePlace.load()


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    for name, picture in (("day", "street_01_centre_summer_noon"), ("elsewhere", "street_08_suburb_summer_noon")):
        Image.open(PICTURES / f"{picture}.png").convert("RGB").resize((480, 270)).save(folder / f"{name}.png")
    dark = 0.25 * np.asarray(Image.open(folder / "day.png"))[:, 24:]  # a step to the side
    noise = np.random.default_rng(0).normal(scale=8, size=dark.shape)
    Image.fromarray((dark + noise).clip(0, 255).astype(np.uint8)).save(folder / "night.png")
    return folder


def test_a_photo_is_a_copy_of_itself(comparing, photos):
    found = comparing.answer(photos / "day.png", photos / "day.png")
    assert found["similarity"] == pytest.approx(1, abs=1e-5)
    assert found["known"]["same_below"] == 1
    assert found["known"]["other_above"] == 0


def test_one_place_by_night_is_more_similar_than_another(comparing, photos):
    night, elsewhere = (comparing.answer(photos / "day.png", photos / f"{n}.png") for n in ("night", "elsewhere"))
    assert night["similarity"] > elsewhere["similarity"]
    assert night["known"]["same_below"] > elsewhere["known"]["same_below"]
    assert night["known"]["other_above"] < elsewhere["known"]["other_above"]


def test_shares_are_those_of_known_pairs():
    known = known_pairs(0.623)
    assert known["same_below"] == pytest.approx(0.5)  # the median of pairs of one place
    low, high = known["middle_80"]["same"]
    assert known_pairs(low)["same_below"] == pytest.approx(0.1)
    assert known_pairs(high)["same_below"] == pytest.approx(0.9)


def test_a_blank_photo_and_a_strip(comparing, photos):
    Image.fromarray(np.full((64, 96, 3), 90, np.uint8)).save(photos / "blank.png")
    for pair in (("day.png", "blank.png"), ("blank.png", "day.png")):
        with pytest.raises(UserError, match=r"blank\.png is blank"):
            comparing.answer(*(photos / name for name in pair))
    Image.fromarray(np.asarray(Image.open(photos / "day.png").resize((800, 40)))).save(photos / "strip.png")
    assert comparing.answer(photos / "day.png", photos / "strip.png")["stretched"] == [False, True]


def test_what_is_measured_is_written_in_order():
    known = json.loads(KNOWN_PAIRS.read_text("utf-8"))
    assert all(len(known[kind]) == len(SHARES) == 21 for kind in ("same", "other"))
    assert all(known[kind] == sorted(known[kind]) for kind in ("same", "other"))
