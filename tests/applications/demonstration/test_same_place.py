import numpy as np
import pytest
from PIL import Image
from tiny_places import scene

from sextant import zoo
from sextant.applications.demonstration import same_place
from sextant.applications.demonstration.same_place import SamePlace
from sextant.applications.places.place_map import PlaceMap
from sextant.errors import UserError


@pytest.fixture
def untrained():
    return SamePlace(PlaceMap("Hog"), "histograms of oriented gradients", trained=False)


@pytest.fixture
def photos(tmp_path):
    for name, place, night in (("day", 3, False), ("night", 3, True), ("elsewhere", 9, False)):
        picture = scene(place, night).resize((96, 64))
        picture.save(tmp_path / f"{name}.png")
    return tmp_path


def test_a_photo_is_a_copy_of_itself(untrained, photos):
    found = untrained.answer(photos / "day.png", photos / "day.png")
    assert found["similarity"] == pytest.approx(1, abs=1e-5)
    assert found["known"]["less_alike_of_one"] == 1
    assert found["known"]["more_alike_of_two"] == 0


def test_one_place_by_night_is_more_alike_than_another(untrained, photos):
    night, elsewhere = (untrained.answer(photos / "day.png", photos / f"{n}.png") for n in ("night", "elsewhere"))
    assert night["similarity"] > elsewhere["similarity"]
    assert night["known"]["less_alike_of_one"] >= elsewhere["known"]["less_alike_of_one"]


def test_shares_are_those_of_known_pairs(untrained):
    known = untrained._known(0.785)
    assert known["less_alike_of_one"] == pytest.approx(0.5)  # the median of pairs of one place
    low, high = known["middle_80"]["same"]
    assert untrained._known(low)["less_alike_of_one"] == pytest.approx(0.1)
    assert untrained._known(high)["less_alike_of_one"] == pytest.approx(0.9)


def test_a_descriptor_that_was_not_measured_says_so(photos):
    found = SamePlace(PlaceMap("PatchNormalised"), "patches", trained=False).answer(
        photos / "day.png", photos / "night.png"
    )
    assert found["known"] is None


def test_the_network_of_the_zoo_is_taken_if_there_is_one(monkeypatch):
    loaded = []
    monkeypatch.setattr(zoo, "names", lambda: ["calibration", "places"])
    monkeypatch.setattr(PlaceMap, "load", lambda run: loaded.append(run) or PlaceMap("Hog"))
    assert SamePlace.load().name == "zoo:places"
    assert loaded == ["zoo:places"]
    monkeypatch.setattr(zoo, "names", lambda: ["calibration"])
    chosen = SamePlace.load()
    assert (chosen.name, chosen.trained) == ("histograms of oriented gradients", False)
    assert chosen._known(0.7) is not None


def test_what_the_demo_compares_by_was_measured():
    assert SamePlace.load().name in same_place.read_json(same_place.ALIKE)


def test_a_blank_photo_and_a_strip(untrained, photos, tmp_path):
    Image.fromarray(np.full((64, 96, 3), 90, np.uint8)).save(tmp_path / "blank.png")
    for chosen in (untrained, SamePlace.load()):
        for pair in (("day.png", "blank.png"), ("blank.png", "day.png")):
            with pytest.raises(UserError, match=r"blank\.png shows nothing to compare"):
                chosen.answer(*(tmp_path / name for name in pair))
    Image.fromarray(np.asarray(Image.open(photos / "day.png").resize((800, 40)))).save(tmp_path / "strip.png")
    assert untrained.answer(photos / "day.png", tmp_path / "strip.png")["stretched"] == [False, True]


def test_what_is_measured_is_written_in_order():
    known = same_place.read_json(same_place.ALIKE)
    for each in known.values():
        assert all(len(each[kind]) == len(same_place.SHARES) == 21 for kind in ("same", "other"))
        assert all(each[kind] == sorted(each[kind]) for kind in ("same", "other"))
