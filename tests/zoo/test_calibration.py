"""The network that comes with the package: what its card says, and that it does not read the lens off sharpness."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from sextant.chapters.calibration.network import trained_camera_network
from sextant.data.photos import Photo, network_view, photo_of_array, read_photo
from sextant.geometry import vfov_from_focal
from sextant.kit.trained import read_trained
from sextant.reports.model_card import model_card
from sextant.runs.resolve import resolve_run
from sextant.zoo import model_file, names, read_card

REFERENCE = "zoo:calibration"
#: what every card tells
TOLD = {"about", "licence", "data", "command", "metrics", "hardware", "date", "seed"}
PICTURES = Path(__file__).parents[2] / "docs/worlds"


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    path = resolve_run(REFERENCE, tmp_path_factory.mktemp("outputs")).checkpoint
    return trained_camera_network(read_trained(path), path)


def blurred(photo, lines):
    """Made so many lines high, and as high as before again."""
    rows, columns = photo.image.shape[:2]
    small = cv2.resize(photo.image, (round(columns * lines / rows), lines), interpolation=cv2.INTER_AREA)
    return Photo(cv2.resize(small, (columns, rows), interpolation=cv2.INTER_CUBIC), photo.width, photo.height, 1, None)


def fields_of_view(network, photos):
    """Vertical ones, degrees, and half their 68 % intervals."""
    spec = network.spec
    views = [network_view(photo, spec.aspects, spec.width, spec.height, canvas=spec.canvas) for photo in photos]
    images = torch.from_numpy(np.stack([view.image for view in views]).transpose(0, 3, 1, 2).copy())
    said = network.predict(images, torch.tensor([view.aspect for view in views]))
    half = (said.scale * said.quantile(0.68))[:, 2]
    return torch.rad2deg(vfov_from_focal(said.parameters.focal)), torch.rad2deg(half)


def test_every_model_has_a_card_and_is_small():
    for name in names():
        path = model_file(f"zoo:{name}")
        card = read_card(path)
        assert card.keys() >= TOLD | ({"intervals"} if card["model"]["task"] == "calibration" else set())
        assert card["bytes"] == path.stat().st_size < 20e6


@pytest.mark.parametrize("name", names())
def test_nothing_in_the_card_says_where_it_was_trained(name):
    text = model_file(f"zoo:{name}").with_suffix(".json").read_text()
    for place in ("/tmp", "/home", "/work", "/root"):
        assert place not in text


def test_it_serves_photos_of_all_shapes_by_all_usual_lenses(network):
    assert (min(network.spec.aspects), max(network.spec.aspects)) == pytest.approx((9 / 16, 16 / 9))
    sides = 0.5 / np.tan(np.array([network.spec.low[2], network.spec.high[2]]) / 2) * 36
    assert sides[0] >= 115
    assert sides[1] <= 12.5
    assert network.spec.canvas


def test_95_in_100_intervals_have_an_end(network):
    _, half = fields_of_view(network, [photo_of_array(np.full((60, 80, 3), 90, np.uint8), "grey")])
    assert half.isfinite().all()
    scores = network.scores
    assert scores.isfinite().all()
    assert len(scores) >= 400


def test_a_picture_of_a_street_is_blurred_and_its_field_of_view_stays(network):
    streets = [photo_of_array(np.asarray(Image.open(path).convert("RGB")), path.name) for path in streets_of_docs()]
    sharp, half = fields_of_view(network, streets)
    soft, _ = fields_of_view(network, [blurred(street, 84) for street in streets])
    assert ((soft - sharp).abs() <= torch.minimum(half, torch.tensor(2.0))).all()


def streets_of_docs():
    found = sorted(PICTURES.glob("street_*.png"))
    assert found
    return found


@pytest.mark.real_data
def test_photos_of_york_urban_are_blurred_and_their_fields_of_view_stay(network, real_data):
    folder = real_data / "york_urban"
    with open(folder / "york_urban.csv", newline="") as table:
        photos = [read_photo(folder / row["file"]) for row in csv.DictReader(table)]
    sharp, half = fields_of_view(network, photos)
    moved = (fields_of_view(network, [blurred(photo, 84) for photo in photos])[0] - sharp).abs()
    assert float(moved.median()) < 1
    assert float(moved.quantile(0.95)) <= 2
    assert (moved <= half).all()


@pytest.mark.parametrize("name", names())
def test_a_model_card_tells_how_each_was_measured(name, tmp_path):
    card = read_card(model_file(f"zoo:{name}"))
    page = model_card(name, [("image", "what is seen")], card["model"], None, tmp_path, card=card)
    assert card["metrics"]["command"] in page
    assert card["licence"] in page
