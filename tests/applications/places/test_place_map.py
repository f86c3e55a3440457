"""A map of photos from Python: filled, saved, opened and asked."""

import json
import pickle
import shutil
from fractions import Fraction

import numpy as np
import pytest
import torch
from PIL import Image
from support import imported_anew
from test_imports import HEAVY
from tiny_places import Pixels, ride, scene, tiny_checkpoint

import sextant
from sextant import PlaceMap
from sextant.applications import FailedPhoto, FailedPhotosError
from sextant.atomic_files import write_sealed_json
from sextant.baselines import Hog, PatchNormalised, WhitenedPCA
from sextant.baselines import Pixels as PixelBaseline
from sextant.baselines.network_layer import NetworkLayer
from sextant.chapters.places import described_map
from sextant.chapters.places.data.decoded_images import ImageSize
from sextant.chapters.places.data.tolerance import PlaceTolerance
from sextant.chapters.places.describing import describe
from sextant.chapters.places.match_confidence import UNSEEN
from sextant.chapters.places.saved_descriptor import kept_network
from sextant.chapters.places.saved_map import FITTED, TOLERANCES, Temperature
from sextant.errors import ArgumentError, UserError
from sextant.runs.checkpoint import KEY
from sextant.zoo import write_model

SURE = Temperature(0.1)


@pytest.fixture
def rides(tmp_path):
    return ride(tmp_path / "day", range(6)), ride(tmp_path / "night", range(6), night=True)


@pytest.fixture
def places(rides):
    """Six places by day."""
    found = PlaceMap(Pixels(), temperature=SURE)
    found.add(rides[0])
    return found


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    return tiny_checkpoint(tmp_path_factory.mktemp("network") / "last.ckpt")


def cosine(first, second):
    a, b = (image.astype(float).ravel() - image.mean() for image in (first, second))
    return a @ b / np.linalg.norm(a) / np.linalg.norm(b)


def pixels(number, night=False):
    return np.asarray(scene(number, night).resize((24, 16), 1, reducing_gap=3.0))


# --- looking up ------------------------------------------------------------------------------------------------------


def test_each_place_is_found_with_similarity_margin_and_confidence(rides, places, capfd):
    assert len(places) == 6
    for k in range(6):
        found = places.look_up(rides[1] / f"{k:03d}.png", k=6)
        assert found.best.photo == rides[0] / f"{k:03d}.png"
        assert found.name == str(rides[1] / f"{k:03d}.png")
        similar = [each.similarity for each in found.matches]
        expected = sorted((cosine(pixels(k, True), pixels(j)) for j in range(6)), reverse=True)
        assert similar == pytest.approx(expected, abs=1e-5)
        assert found.margin == pytest.approx(similar[0] - similar[1], abs=1e-6)
        weights = np.exp(np.array(similar) / SURE.value)
        assert [each.confidence for each in found.matches] == pytest.approx(weights / weights.sum(), abs=1e-6)
    assert capfd.readouterr() == ("", "")


def test_a_photo_of_more_than_8_bits_is_described_alike_alone_and_among_others(tmp_path):
    for k, top in enumerate((300, 900, 4000, 3000)):
        deep = np.asarray(scene(k).convert("L")).astype(np.uint16) * (top // 255)
        Image.fromarray(deep).save(tmp_path / f"{k}.png")
    photos = sorted(tmp_path.iterdir())
    alone = [describe(Pixels(), Pixels.size, [photo]).rows[0] for photo in photos]
    np.testing.assert_array_equal(describe(Pixels(), Pixels.size, photos).rows, alone)
    parts = [tmp_path / "part" / photos[0].name, tmp_path / "other" / photos[2].name]
    for photo, part in zip((photos[0], photos[2]), parts, strict=True):
        part.parent.mkdir()
        photo.rename(part)
    together = describe(Pixels(), Pixels.size, parts).rows
    np.testing.assert_array_equal(together, [alone[0], alone[2]])  # folders of one map share it
    np.testing.assert_array_equal(describe(Pixels(), Pixels.size, parts[:1], among=parts).rows[0], together[0])
    assert (describe(Pixels(), Pixels.size, parts[:1]).rows[0] != together[0]).any()


def test_an_array_is_found_as_its_file_is(rides, places):
    by_array, by_file = places.look_up_many([pixels(2, True), str(rides[1] / "002.png")])
    assert by_array.matches == by_file.matches
    assert (by_array.name, by_array.stretched) == ("photo 0", False)


def test_a_photo_may_be_a_file_a_picture_an_array_or_lists_of_any_size(rides, places):
    file, picture = rides[1] / "003.png", scene(3, night=True)
    asked = [file, str(file), picture, np.asarray(picture), np.asarray(picture).tolist()]
    found = places.look_up_many(asked)
    assert {each.best.photo.name for each in found} == {"003.png"}
    assert {each.best.similarity for each in found} == {found[0].best.similarity}
    assert places.look_up(picture.convert("L")).best.similarity > 0  # grey becomes colour


def test_a_network_says_how_probable_it_is_that_its_match_is_right(rides, checkpoint):
    network, baseline = PlaceMap.load(checkpoint), PlaceMap("Pixels", ImageSize(16, 24))
    for places in (network, baseline):
        places.add(rides[0])
    found = network.look_up(rides[1] / "002.png")
    assert found.found == pytest.approx(float(UNSEEN.probability(np.array([found.margin]))[0]))
    assert baseline.look_up(rides[1] / "002.png").found is None
    assert all(each.found is None for each in network.look_up_sequence(sorted(rides[1].iterdir()), length=3))


def test_a_network_of_the_zoo_brings_the_confidences_that_were_fitted_for_it(rides, checkpoint, tmp_path):
    content = torch.load(checkpoint, weights_only=True)
    content[KEY]["spec"][FITTED] = {"temperature": 0.2, "slope": 3.0, "offset": 0.5}
    path = write_model("own", content[KEY], content["state_dict"], {}, tmp_path)
    places = PlaceMap.load(path)
    places.add(rides[0])
    places.save(tmp_path / "map")
    assert kept_network(path).identity == places.descriptor.identity
    for each in (places, PlaceMap.open(tmp_path / "map")):
        found = each.look_up(rides[1] / "002.png")
        assert each.temperature.value == 0.2
        assert found.found == pytest.approx(1 / (1 + np.exp(-(3 * found.margin + 0.5))))


def test_a_descriptor_may_be_named(rides):
    named, built = PlaceMap("patch-normalised", ImageSize(16, 24)), PlaceMap(PatchNormalised(), ImageSize(16, 24))
    for places in (named, built):
        places.add(rides[0])
    assert named.model == built.model
    assert named.look_up(rides[1] / "002.png") == built.look_up(rides[1] / "002.png")


def test_of_a_small_map_there_are_no_more_matches_than_photos(rides, places):
    assert len(places.look_up(rides[1] / "000.png", k=50).matches) == 6
    alone = PlaceMap(Pixels())
    alone.add(rides[0] / "000.png")
    found = alone.look_up(rides[1] / "000.png")
    assert (len(found.matches), found.margin, found.best.confidence, found.best.position) == (1, None, None, None)


def test_a_photo_of_another_shape_is_known_as_stretched(rides, places):
    scene(1, True).resize((30, 90)).save(rides[1] / "tall.png")
    assert places.look_up(rides[1] / "tall.png").stretched
    assert not places.look_up(rides[1] / "001.png").stretched


def test_sequences_find_what_single_photos_miss(tmp_path):
    day, night = ride(tmp_path / "day", range(12)), ride(tmp_path / "night", range(12), night=True)
    scene(3).save(night / "008.png")  # one photo that looks like another place
    places = PlaceMap(Pixels(), temperature=SURE)
    places.add(day)
    photos = sorted(night.iterdir())
    assert places.look_up(photos[8]).best.photo.name == "003.png"
    found = places.look_up_sequence(photos, length=5)
    assert [each.best.photo.name for each in found] == [path.name for path in photos]
    assert {(each.best.confidence, each.margin) for each in found} == {(None, None)}
    (night / "004.png").write_bytes(b"nothing")
    with pytest.raises(
        FailedPhotosError, match=r"1 of 12 photos could not be looked up\n.*004\.png: cannot be decoded"
    ):
        places.look_up_sequence(photos, length=5)
    rest = places.look_up_sequence(photos, length=5, errors="return")
    assert isinstance(rest[4], FailedPhoto)
    assert rest[8].best.photo.name == "008.png"


# --- what one place is -----------------------------------------------------------------------------------------------


def test_photos_at_near_positions_share_their_confidence(rides, tmp_path):
    places = PlaceMap(Pixels(), temperature=1.0)
    places.add(rides[0], [(0, 0), (3, 0), (6, 0), (100, 0), (np.nan, np.nan), (np.nan, np.nan)])
    photo = rides[1] / "001.png"

    def confidence(tolerance):
        places.tolerance = tolerance
        return {each.photo.name: each.confidence for each in places.look_up(photo, k=6).matches}

    alone = confidence(0)
    assert sum(alone.values()) == pytest.approx(1)
    near = {
        "000.png": (0, 1),
        "001.png": (0, 1, 2),
        "002.png": (1, 2),
        "003.png": (3,),
        "004.png": (4,),
        "005.png": (5,),
    }
    together = {name: sum(alone[f"{j:03d}.png"] for j in near[name]) for name in alone}
    for tolerance in (3, None):  # None: that of the run, or 5 m
        assert confidence(tolerance) == pytest.approx(together)
    assert places.look_up(photo).best.position == (3.0, 0.0)
    found = {each.photo.name: each.position for each in places.look_up(photo, k=6).matches}
    assert found["004.png"] is None
    places.save(tmp_path / "map")
    again = PlaceMap.open(tmp_path / "map", descriptor=Pixels())
    assert again.look_up(photo, k=6).best.position == (3.0, 0.0)


def test_positions_may_be_a_tensor_with_a_gradient(rides):
    places = PlaceMap(Pixels())
    places.add(rides[0], torch.arange(12.0).reshape(6, 2).requires_grad_())
    assert places.look_up(rides[0] / "002.png").best.position == (4.0, 5.0)


def test_photos_of_a_ride_share_their_confidence_if_so_wished(rides, places):
    alone = {each.photo.name: each.confidence for each in places.look_up(rides[1] / "001.png", k=6).matches}
    places.tolerance = 1
    found = {each.photo.name: each.confidence for each in places.look_up(rides[1] / "001.png", k=6).matches}
    assert found["001.png"] == pytest.approx(sum(alone[f"00{j}.png"] for j in (0, 1, 2)))


def test_what_one_place_is_is_worked_out_once_for_a_map(rides, places, monkeypatch):
    asked = []
    worked_out = described_map.same_place
    monkeypatch.setattr(described_map, "same_place", lambda *given: asked.append(given) or worked_out(*given))
    photo = rides[1] / "001.png"
    for _ in range(3):
        places.look_up(photo)
    assert len(asked) == 1
    places.tolerance = 1
    first = places.look_up(photo).best.confidence
    assert len(asked) == 2
    places.add(ride(rides[0].parent / "more", [1]))
    assert places.look_up(photo).best.confidence != first
    assert len(asked) == 3


# --- adding ----------------------------------------------------------------------------------------------------------


def test_a_map_may_grow_photo_by_photo_and_from_several_folders(rides, places, tmp_path):
    second = ride(tmp_path / "elsewhere" / "more", range(6, 9))
    grown = PlaceMap(Pixels(), temperature=SURE)
    for path in sorted(rides[0].iterdir()):
        grown.add(path)
        assert grown.look_up(path).best.photo == path
    for found in (grown, places):
        found.add(sorted(second.iterdir()), np.arange(6).reshape(3, 2))
    assert [grown.look_up(rides[1] / f"{k:03d}.png", k=9) for k in range(6)] == [
        places.look_up(rides[1] / f"{k:03d}.png", k=9) for k in range(6)
    ]
    best = places.look_up(np.asarray(scene(7, True).resize((24, 16)))).best
    assert (best.photo, best.position) == (second / "001.png", (2.0, 3.0))
    assert places.look_up(rides[1] / "001.png").best.position is None


def test_photos_that_fail_are_named_and_the_others_are_in_the_map(rides):
    places, bad = PlaceMap(Pixels()), (rides[0] / "001.png", rides[0] / "004.png")
    good = [path.read_bytes() for path in bad]
    for path in bad:
        path.write_bytes(b"nothing")
    with pytest.raises(FailedPhotosError, match="2 of 6 photos could not be described") as raised:
        places.add(rides[0])
    assert [each.name for each in raised.value.failed] == [str(path) for path in bad]
    assert all(f"{path}: cannot be decoded (7 bytes)" in raised.value.problem for path in bad)
    assert "the others are in the map" in raised.value.fix
    assert len(places) == 4
    assert places.look_up(rides[1] / "005.png").best.photo.name == "005.png"
    bad[0].write_bytes(good[0])
    (failed,) = places.add(bad, errors="return")
    assert failed.name == str(bad[1])
    assert len(places) == 5
    assert places.look_up(rides[1] / "001.png").best.photo == bad[0]
    with pytest.raises(FailedPhotosError, match="none of 1 photo could be described"):
        places.add(bad[1])
    assert len(places) == 5


def test_photos_that_failed_are_named_in_another_process_too(rides):
    for path in (rides[0] / "001.png", rides[0] / "004.png"):
        path.write_bytes(b"nothing")
    with pytest.raises(FailedPhotosError) as raised:
        PlaceMap(Pixels()).add(rides[0])
    again = pickle.loads(pickle.dumps(raised.value))
    assert (again.problem, again.fix) == (raised.value.problem, raised.value.fix)
    assert [each.row() for each in again.failed] == [each.row() for each in raised.value.failed]
    assert [each.name for each in again.failed] == [str(rides[0] / "001.png"), str(rides[0] / "004.png")]


@pytest.mark.parametrize("given", ["day", "day/002.png"])
def test_photos_given_relatively_stay_where_they_are(rides, tmp_path, monkeypatch, given):
    monkeypatch.chdir(tmp_path)
    places = PlaceMap(Pixels())
    places.add(given)
    monkeypatch.chdir(rides[1])
    places.save(tmp_path / "map")
    for each in (places, PlaceMap.open(tmp_path / "map", descriptor=Pixels())):
        assert each.look_up(scene(2)).best.photo == rides[0] / "002.png"


@pytest.mark.parametrize(
    "kind",
    [np.float64, np.uint8, list, lambda rows: torch.tensor(rows).requires_grad_()],
    ids=["float64", "uint8", "list", "tensor"],
)
def test_a_descriptor_of_the_user_may_return_numbers_of_any_kind(rides, kind):
    def describing(made):
        describer = Pixels()
        describer.describe = lambda images: made(images.reshape(len(images), -1).astype(np.float32))
        found = PlaceMap(describer)
        found.add(rides[0])
        return found.look_up(rides[1] / "002.png")

    assert describing(kind) == describing(lambda rows: rows)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda rows: rows[0], r"of the shape \(1152,\) for 6 images"),
        (lambda rows: rows[1:], r"of the shape \(5, 1152\) for 6 images"),
        (lambda rows: [[1.0], [1.0, 2.0]], r"\[\[1\.0\], \[1\.0, 2\.0\]\] for 6 images"),
        (lambda rows: None, r"of the shape \(\) for 6 images"),
    ],
)
def test_a_descriptor_of_the_user_that_returns_no_row_for_each_image_is_told(rides, made, said):
    describer = Pixels()
    describer.describe = lambda images: made(images.reshape(len(images), -1))
    with pytest.raises(ArgumentError, match=rf"descriptor: Pixels\.describe returned .*{said}"):
        PlaceMap(describer).add(rides[0])


def test_a_folder_is_not_photos_to_look_up(rides, places):
    for look_up in (places.look_up_many, places.look_up_sequence):
        with pytest.raises(UserError, match="is one path; several photos are expected"):
            look_up(str(rides[1]))
    for call in (places.look_up_many, places.look_up_sequence, places.add):
        with pytest.raises(UserError, match="errors=ignore must be one of raise, return"):
            call(sorted(rides[1].iterdir()), errors="ignore")


def test_photos_that_cannot_be_looked_up(rides, places):
    (rides[1] / "001.png").write_bytes(b"nothing")
    photos = [rides[1] / "000.png", rides[1] / "001.png", "gone.jpg"]
    with pytest.raises(UserError, match=r"001\.png: cannot be decoded \(7 bytes\)"):
        places.look_up(photos[1])
    with pytest.raises(UserError, match="is a folder, not a file"):
        places.look_up(rides[1])
    with pytest.raises(UserError, match=r"gone\.jpg: there is no such file"):
        places.look_up(photos[2])
    (rides[1] / "link.png").symlink_to("gone.png")
    with pytest.raises(UserError, match=r"link\.png: is a broken link"):
        places.look_up(rides[1] / "link.png")
    Image.new("RGB", (50, 1)).save(rides[1] / "line.png")
    with pytest.raises(UserError, match=r"line\.png: has 50x1 pixels; the shorter side must have at least 4"):
        places.look_up(rides[1] / "line.png")
    with pytest.raises(UserError, match=r"of type bytes; .*\n.*PIL\.Image\.open\(io\.BytesIO"):
        places.look_up(b"\x89PNG")
    with pytest.raises(FailedPhotosError, match="2 of 3 photos could not be looked up"):
        places.look_up_many(photos)
    found = places.look_up_many(photos, errors="return")
    assert [isinstance(each, FailedPhoto) for each in found] == [False, True, True]
    assert found[0].best.photo.name == "000.png"
    assert all(isinstance(each, FailedPhoto) for each in places.look_up_many(photos[1:], errors="return"))


def test_arrays_that_cannot_be_looked_up_are_named_and_the_others_are_not_lost(rides, places):
    scene(1, True).resize((30, 90)).save(rides[1] / "tall.png")
    photos = [None, pixels(2) / 255, rides[1] / "tall.png", "gone.jpg", pixels(3)]
    with pytest.raises(FailedPhotosError, match=r"3 of 5 photos could not be looked up\n.*photo 0: .* type NoneType"):
        places.look_up_many(photos)
    found = places.look_up_many(photos, errors="return")
    assert [each.name for each in found if isinstance(each, FailedPhoto)] == ["photo 0", "photo 1", "gone.jpg"]
    assert "float64 16x24x3; the network takes uint8" in found[1].error.problem
    looked_up = [(i, found[i].name, found[i].best.photo.name, found[i].stretched) for i in (2, 4)]
    assert looked_up == [(2, str(photos[2]), "001.png", True), (4, "photo 4", "003.png", False)]
    assert all(isinstance(each, FailedPhoto) for each in places.look_up_many([None, 3], errors="return"))


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda places, day: PlaceMap(Pixels()).look_up(day / "000.png"), "the map is empty"),
        (lambda places, day: PlaceMap(Pixels()).save(day), "the map is empty"),
        (lambda places, day: places.add(day), r"photos: .*000\.png is in the map already"),
        (lambda places, day: places.add([day / "x.png", day / "x.png"]), r"x\.png is in the map already"),
        (lambda places, day: places.add([]), "there is no photo"),
        (lambda places, day: places.add(day / "none"), "photos=.*does not exist"),
        (lambda places, day: places.add(day, [(0, 0)]), r"positions has shape \(1, 2\) for 6 photos"),
        (lambda places, day: places.look_up(day / "000.png", k=0), "k=0 must be a whole number, at least 1"),
        (lambda places, day: places.look_up_sequence([day / "000.png"], length=1), "length=1 must be a whole"),
        (lambda places, day: places.look_up(np.zeros((16, 24, 3))), "float64 16x24x3; the network takes uint8 16x24x3"),
        (lambda places, day: places.look_up(np.full((16, 24, 3), 256)), "int64 16x24x3"),
        (lambda places, day: places.look_up([[1, 2], [3]]), "the network takes uint8 16x24x3"),
        (lambda places, day: places.look_up(torch.ones(16, 24, 3, requires_grad=True)), "float32 16x24x3; the network"),
        (lambda places, day: places.look_up(list(torch.ones(9, 9, 3, requires_grad=True))), "the network takes uint8"),
        (lambda places, day: places.add([scene(9)]), "the names of files, and a value of type Image is not a file"),
        (lambda places, day: places.add([pixels(9), pixels(8)]), "a value of type ndarray is not a file"),
        (lambda places, day: places.add(pixels(9)), "a value of type ndarray is not a file"),
        (lambda places, day: places.add(None), "a value of type NoneType is not a file"),
        (lambda places, day: places.add([None]), "a value of type NoneType is not a file"),
        (lambda places, day: places.add(day, "here"), "positions='here' must be numbers"),
        (lambda places, day: places.add(day, list(torch.ones(6, 2, requires_grad=True))), "positions=.* must be numb"),
        (lambda places, day: places.add(day, [["a", "b"]] * 6), r"positions=\[\['a', 'b'\], .* must be numbers"),
        (lambda places, day: places.add(day, [(0, 0), (0, np.inf)] * 3), "position of photo 1 is infinite"),
        (lambda places, day: places.look_up(None), "of type NoneType; the network takes uint8 16x24x3"),
        (lambda places, day: places.look_up_many(3), "photos is of type int; several photos are expected"),
        (lambda places, day: PlaceMap("Hog", (64, 64)), r"size=\(64, 64\) must be of the class ImageSize"),
        (lambda places, day: PlaceMap("Hog", "big"), "size='big' must be of the class ImageSize"),
        (lambda places, day: PlaceMap.open(None), "None is not a saved map of photos"),
        (lambda places, day: PlaceMap("Hogg"), "descriptor='Hogg' must be one of Hog, PatchNormalised, Pixels, Whit"),
        (lambda places, day: PlaceMap("whitened PCA"), "WhitenedPCA has not been fitted to images"),
        (lambda places, day: PlaceMap(Pixels(), temperature=0), "temperature=0 must be a finite number above 0"),
        (lambda places, day: PlaceMap(Pixels(), temperature="hot"), "temperature='hot' must be a finite number"),
        (lambda places, day: PlaceMap(lambda images: images), "size=None: this descriptor does not state"),
    ],
)
def test_mistakes(rides, places, ask, says):
    with pytest.raises(UserError, match=says):
        ask(places, rides[0])


@pytest.mark.parametrize("number", [1.5, "3", None, True])
def test_numbers_of_matches_and_of_a_sequence_are_whole(rides, places, number):
    photo = rides[1] / "000.png"
    for ask in (lambda: places.look_up(photo, number), lambda: places.pairs(number)):
        with pytest.raises(ArgumentError, match=f"k={number!r} must be a whole number, at least 1"):
            ask()
    with pytest.raises(ArgumentError, match=f"length={number!r} must be a whole number, at least 2"):
        places.look_up_sequence([photo], length=number)
    with pytest.raises(ArgumentError, match="k=0 must be a whole number"):
        places.pairs(0)
    assert len(places.look_up(photo, np.int64(2)).matches) == 2


@pytest.mark.parametrize("tolerance", [-1, np.nan, np.inf, "5", True])
def test_a_tolerance_that_is_none_is_refused_when_it_is_set(places, tolerance):
    with pytest.raises(ArgumentError, match=f"tolerance={tolerance!r} must be a finite number, at least 0, or None"):
        places.tolerance = tolerance
    assert places.tolerance is None


# --- saving ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("descriptor", "size"),
    [(PixelBaseline(16, 24), None), (Hog(32, 48), ImageSize(40, 60, 1)), ("fitted", None)],
    ids=["pixels", "hog", "whitened"],
)
def test_a_saved_map_opens_by_itself_and_answers_as_before(rides, tmp_path, descriptor, size):
    if descriptor == "fitted":
        descriptor = WhitenedPCA(16, 24, 4).fit(np.stack([pixels(k) for k in range(6)]))
    places = PlaceMap(descriptor, size, temperature=SURE)
    places.tolerance = 2.0
    places.add(rides[0])
    places.save(tmp_path / "map")
    shutil.rmtree(rides[0])
    shutil.move(tmp_path / "map", tmp_path / "moved")
    again = PlaceMap.open(tmp_path / "moved")
    photos = sorted(rides[1].iterdir())
    assert again.look_up_many(photos) == places.look_up_many(photos)
    assert (again.temperature, again.tolerance, again.tolerances) == (SURE, 2.0, places.tolerances)
    again.add(ride(tmp_path / "more", [7]))
    again.save(tmp_path / "moved")
    assert len(PlaceMap.open(tmp_path / "moved")) == 7


def test_numbers_of_numpy_are_saved_as_plain_ones(rides, tmp_path):
    one, two = np.int64(16), np.int64(24)
    tolerances = TOLERANCES | {"m": PlaceTolerance("m", np.float32(4), np.int64(20))}
    places = PlaceMap(
        Hog(one, two), ImageSize(one, two, np.int64(3)), temperature=np.float32(0.25), tolerances=tolerances
    )
    places.tolerance = np.float32(2.5)
    places.add(rides[0])
    places.save(tmp_path)
    again = PlaceMap.open(tmp_path)
    assert (again.temperature.value, again.tolerance, again.size) == (0.25, 2.5, ImageSize(16, 24, 3))
    assert (again.tolerances, again.model) == (tolerances, PlaceMap(Hog(16, 24)).model)
    assert again.look_up(rides[1] / "002.png") == places.look_up(rides[1] / "002.png")


def test_a_setting_that_cannot_be_saved_keeps_the_former_map(rides, tmp_path):
    places = PlaceMap("Hog", ImageSize(16, 24))
    places.add(rides[0])
    places.save(tmp_path / "map")
    former = {path: path.read_bytes() for path in (tmp_path / "map").rglob("*.*")}
    other = PlaceMap("Pixels", ImageSize(16, 24))
    other.add(rides[1])
    other.tolerance = Fraction(5, 2)
    with pytest.raises(ArgumentError, match=r"tolerance=Fraction\(5, 2\) cannot be written as JSON"):
        other.save(tmp_path / "map")
    assert {path: path.read_bytes() for path in former} == former
    assert len(former) == 5


def test_a_network_goes_with_the_map_and_a_run_opens_what_was_saved_without(rides, checkpoint, tmp_path):
    other = shutil.copy(checkpoint, tmp_path / "other.ckpt")
    places = PlaceMap.load(other)
    assert places.temperature.value is None
    places.add(rides[0])
    places.save(tmp_path / "whole")
    places.save(tmp_path / "bare", descriptor=False)
    assert {path.name for path in (tmp_path / "bare").iterdir()} == {"map.json", "index.json", "descriptors.npy"}
    other.unlink()
    photos = sorted(rides[1].iterdir())
    found = places.look_up_many(photos)
    assert PlaceMap.open(tmp_path / "whole").look_up_many(photos) == found
    assert PlaceMap.open(tmp_path / "bare", run=checkpoint).look_up_many(photos) == found
    with pytest.raises(UserError, match=r"saved without its descriptor\nName the run"):
        PlaceMap.open(tmp_path / "bare")
    content = torch.load(checkpoint, weights_only=True)
    content["state_dict"] = {name: tensor + 1 for name, tensor in content["state_dict"].items()}
    torch.save(content, tmp_path / "other.ckpt")
    for folder in ("bare", "whole"):
        with pytest.raises(UserError, match="is of another network"):
            PlaceMap.open(tmp_path / folder, run=tmp_path / "other.ckpt")


def test_a_map_of_before_positions_and_temperatures_were_kept(rides, checkpoint, tmp_path):
    places = PlaceMap.load(checkpoint)
    places.add(rides[0])
    places.save(tmp_path / "map", descriptor=False)
    header = json.loads((tmp_path / "map" / "map.json").read_text())
    new = {"descriptor", "temperature", "tolerance", "tolerances", "positions", "size"}
    write_sealed_json(tmp_path / "map" / "map.json", {key: header[key] for key in header if key not in new})
    again = PlaceMap.open(tmp_path / "map", run=checkpoint)
    assert again.look_up(rides[1] / "002.png") == places.look_up(rides[1] / "002.png")


def test_a_descriptor_that_cannot_be_kept_is_given_again(rides, tmp_path):
    layer = NetworkLayer(torch.nn.Conv2d(3, 4, 3), 16, 24, grid=(2, 3))
    places = PlaceMap(layer, ImageSize(20, 30), temperature=0.2)
    places.tolerance = 1
    places.add(rides[0])
    places.save(tmp_path)
    with pytest.raises(UserError, match="without its descriptor"):
        PlaceMap.open(tmp_path)
    again = PlaceMap.open(tmp_path, descriptor=layer)
    assert again.look_up(rides[1] / "003.png") == places.look_up(rides[1] / "003.png")
    with pytest.raises(UserError, match="is of another network"):
        PlaceMap.open(tmp_path, descriptor=PixelBaseline(16, 24))


@pytest.mark.parametrize(
    "name",
    ["map.json", "index.json", "descriptors.npy", "descriptor/descriptor.json", "descriptor/descriptor.safetensors"],
)
@pytest.mark.parametrize("harm", ["missing", "cut", "changed"])
def test_a_damaged_map_is_refused(rides, tmp_path, name, harm):
    descriptor = WhitenedPCA(16, 24, 4).fit(np.stack([pixels(k) for k in range(6)]))
    places = PlaceMap(descriptor)
    places.add(rides[0])
    places.save(tmp_path / "map")
    path = tmp_path / "map" / name
    content = bytearray(path.read_bytes())
    if harm == "missing":
        path.unlink()
    elif harm == "cut":
        path.write_bytes(content[: len(content) // 2])
    else:
        content[-len(content) // 3] ^= 1
        path.write_bytes(content)
    with pytest.raises(UserError, match=r"damaged|is not|cannot be read"):
        PlaceMap.open(tmp_path / "map")


@pytest.mark.parametrize(
    "change", [{"temperature": 3}, {"tolerances": {}}, {"positions": [[1, 2]]}, {"tolerance": "x"}, {"size": 3}]
)
def test_a_header_of_values_that_are_none_is_refused(rides, places, tmp_path, change):
    places.save(tmp_path)
    header = json.loads((tmp_path / "map.json").read_text())
    write_sealed_json(tmp_path / "map.json", header | change)
    with pytest.raises(UserError, match=r"is damaged: map\.json does not"):
        PlaceMap.open(tmp_path, descriptor=Pixels())


# --- from a run ------------------------------------------------------------------------------------------------------


def test_models_of_other_tasks_are_refused(checkpoint, tmp_path):
    content = torch.load(checkpoint, weights_only=True)
    content[KEY]["task"] = "calibration"
    torch.save(content, tmp_path / "other.ckpt")
    with pytest.raises(UserError, match=r"other\.ckpt is a model of calibration, not of place_recognition"):
        PlaceMap.load(tmp_path / "other.ckpt")


def test_it_needs_neither_hydra_nor_lightning_nor_mlflow_and_prints_nothing(rides, checkpoint, tmp_path, capfd):
    with imported_anew(*HEAVY) as anew:
        assert anew.PlaceMap is not PlaceMap
        places = anew.PlaceMap.load(checkpoint)
        places.add(rides[0])
        places.save(tmp_path / "map")
        assert len(anew.PlaceMap.open(tmp_path / "map").look_up(rides[1] / "000.png").matches) == 5
    assert capfd.readouterr() == ("", "")


def test_it_is_where_users_look_for_it():
    assert sextant.PlaceMap is PlaceMap
    assert issubclass(ArgumentError, UserError)
